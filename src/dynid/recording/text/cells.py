"""One cell of a text table: a number, a missing value, or neither."""

from __future__ import annotations

import math
import re

from dynid.recording.text.stamps import is_stamp

_MISSING = frozenset(
    {"", "nan", "+nan", "-nan", "na", "n/a", "#n/a", "null", "none", "nil", "-", "--", "nat"}
)
_WINDOWS_NAN = ("1.#", "-1.#", "nan(", "-nan(")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
_DOUBLE = re.compile(r"(?<=\d)(\.?)[dD](?=[+-]?\d+$)")
_NAME = re.compile(r"[\"'#%/\s]*[A-Za-z_]")


def is_missing(cell: str) -> bool:
    """Whether a cell says that there is no value."""
    text = cell.strip().strip("\"'").lower()
    return text in _MISSING or text.startswith(_WINDOWS_NAN)


def number(cell: str, decimal: str = ".") -> float:
    """The number in a cell, NaN where the value is missing.

    Raises:
        ValueError: The cell is neither a number nor a sign for a missing value.
    """
    # float() takes 1_000 and digits of other scripts; no recorder writes them.
    if not cell.isascii() or "_" in cell:
        raise ValueError(cell)
    try:
        return float(cell)
    except ValueError:
        if is_missing(cell):
            return math.nan
        text = cell.strip().strip("\"'")
        if decimal == "," and _DECIMAL_COMMA.fullmatch(text):
            text = text.replace(",", ".")
        # Fortran writes 1.5D-03.
        return float(_DOUBLE.sub(r"\1E", text))


def is_number(cell: str, decimal: str = ".") -> bool:
    """Whether a cell holds a number (missing values are not numbers)."""
    try:
        return not math.isnan(number(cell, decimal))
    except ValueError:
        return False


def count(cells: list[str], decimal: str = ".") -> tuple[int, int]:
    """How many cells hold numbers, and how many hold something else than a missing value."""
    numbers = others = 0
    for cell in cells:
        if is_number(cell, decimal) or is_stamp(cell):
            numbers += 1
        elif not is_missing(cell):
            others += 1
    return numbers, numbers + others


def is_name(cell: str) -> bool:
    """Whether a cell can be a column name: it starts with a letter and is no number."""
    return (
        bool(_NAME.match(cell))
        and not is_missing(cell)
        and not is_number(cell)
        and not is_stamp(cell)
    )


def split(line: str, delimiter: str) -> list[str]:
    """The cells of a line; a blank delimiter stands for any run of blanks."""
    if delimiter == " ":
        return line.split()
    return line.split(delimiter)


def decimals(cell: str) -> int:
    """Digits after the decimal point (or comma), 0 without one."""
    mantissa = cell.strip().lower().partition("e")[0].replace(",", ".")
    return len(mantissa.partition(".")[2])
