"""One cell of a text table: a number, a date, a missing value, or neither."""

import math
import re
from datetime import date

import numpy as np

from dynid.core import Array

_CLOCK = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2})(?::(?P<second>\d{2}(?:[.,:]\d+)?))?"
    r"(?:\s*(?P<half>[ap])\.?m\.?)?\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?"
)
_FORMS = tuple(
    (re.compile(form + _CLOCK, re.IGNORECASE), needed)
    for form, needed in (
        (r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})[T_\s]+", "hour"),
        (r"(?P<day>\d{1,2})\.(?P<month>\d{1,2})\.(?P<year>\d{4})[T_,\s]+", "hour"),
        # Of other dates with slashes nobody knows which comes first.
        (r"(?P<month>\d{1,2})/(?P<day>\d{1,2})/(?P<year>\d{4})[,\s]+", "half"),
        ("", "second"),
    )
)
"""Dates with a time, and times of day; and the part that each must have."""
_DAY = 86400.0


def stamp(cell: str) -> float:
    """Seconds since 1970 of a date with its time, or since midnight of a time of day.

    Args:
        cell: `2024-03-01T12:00:00.008Z`, `1.3.2024 12:00:00,008`, `3/1/2024 1:00:00 PM` or
            `12:00:00.008`.

    Raises:
        ValueError: The cell is none of them.
    """
    text = cell.strip().strip("\"'").strip()
    matches = ((form.fullmatch(text), needed) for form, needed in _FORMS)
    part = next((m.groupdict("") for m, needed in matches if m and m[needed]), None)
    if part is None:
        raise ValueError(cell)
    days, hours = 0, int(part["hour"])
    if "year" in part:
        days = date(*(int(part[name]) for name in ("year", "month", "day"))).toordinal() - 719163
    if part["half"]:
        hours = hours % 12 + 12 * (part["half"] in "pP")
    # 12:00:00:123 has milliseconds behind its last colon.
    whole, _, rest = re.sub("[,:]", ".", part["second"] or "0").partition(".")
    east, zone = 0, part["zone"]
    if zone[:1] in ("+", "-"):
        east = int(f"{zone[0]}1") * (60 * int(zone[1:3]) + int(zone[-2:]))
    minutes = 60 * hours + int(part["minute"]) - east
    return days * _DAY + 60.0 * minutes + float(f"{whole}.{rest or 0}")


def is_stamp(cell: str) -> bool:
    """Whether a cell holds a date with its time, or a time of day."""
    if ":" not in cell:
        return False
    try:
        stamp(cell)
    except ValueError:
        return False
    return True


def past_midnight(t: Array) -> Array:
    """(N) seconds since midnight that go on where a day ends; any other time as it is."""
    if np.nanmax(t, initial=0.0) > _DAY:
        return t
    there = np.isfinite(t)
    days = np.zeros(len(t))
    days[np.flatnonzero(there)[1:]] = np.diff(t[there]) < -0.9 * _DAY
    return t + _DAY * np.cumsum(days)


_MISSING = frozenset(
    {"", "nan", "+nan", "-nan", "na", "n/a", "#n/a", "null", "none", "nil", "-", "--", "nat"}
)
_WINDOWS_NAN = ("1.#", "-1.#", "nan(", "-nan(")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
_GROUPED = {
    dot: re.compile(rf"[+-]?\d{{1,3}}((?:[{a}]\d{{3}})+[{dot}]?|(?:[{b}]\d{{3}})+[{dot}])\d*")
    for dot, a, b in ((".", "'", ", "), (",", " '", "."))
}
"""Decimal sign to numbers in groups of three digits; nobody knows whether `1,234` alone is one."""
_BLANKS = str.maketrans({"\u00a0": " ", "\u202f": " ", "\u2019": "'"})
_DOUBLE = re.compile(r"(?<=\d)(\.?)[dD](?=[+-]?\d+$)")
_NAME = re.compile(r"[\"'#%/$\s]*[A-Za-z_]")


def is_missing(cell: str) -> bool:
    """Whether a cell says that there is no value."""
    text = cell.strip().strip("\"'").lower()
    return text in _MISSING or text.startswith(_WINDOWS_NAN)


def number(cell: str, decimal: str = ".") -> float:
    """The number in a cell, NaN where the value is missing.

    Raises:
        ValueError: The cell is neither a number nor a sign for a missing value.
    """
    cell = cell.translate(_BLANKS) if not cell.isascii() else cell
    # float() takes 1_000 and digits of other scripts; no recorder writes them.
    if not cell.isascii() or "_" in cell:
        raise ValueError(cell)
    try:
        return float(cell)
    except ValueError:
        if is_missing(cell):
            return math.nan
        text = cell.strip().strip("\"'")
        if _GROUPED[decimal].fullmatch(text):
            text = re.sub(f"[^0-9+{decimal}-]", "", text)
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
