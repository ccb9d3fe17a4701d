"""One cell of a text table: a number, a date, a missing value, or neither."""

import math
import re
from datetime import date

import numpy as np

from dynid.core import Array

_CLOCK = r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,:]\d+)?))?(?:\s*([ap])\.?m\.?)?"
_TIME = re.compile(_CLOCK, re.IGNORECASE)
_ISO = re.compile(
    rf"(\d{{4}})[-/.](\d{{1,2}})[-/.](\d{{1,2}})[T_\s]+{_CLOCK}\s*(Z|UTC|[+-]\d{{2}}:?\d{{2}})?",
    re.IGNORECASE,
)
_DAY_FIRST = re.compile(rf"(\d{{1,2}})\.(\d{{1,2}})\.(\d{{4}})[T_,\s]+{_CLOCK}", re.IGNORECASE)
_MONTH_FIRST = re.compile(rf"(\d{{1,2}})/(\d{{1,2}})/(\d{{4}})[,\s]+{_CLOCK}", re.IGNORECASE)
"""Taken with AM or PM alone: of other dates with slashes nobody knows which comes first."""
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
    if match := _ISO.fullmatch(text):
        year, month, day, *clock, zone = match.groups()
        return _epoch(year, month, day) + _of_day(clock) - _zone(zone)
    if match := _DAY_FIRST.fullmatch(text):
        day, month, year, *clock = match.groups()
        return _epoch(year, month, day) + _of_day(clock)
    if (match := _MONTH_FIRST.fullmatch(text)) and match.group(7):
        month, day, year, *clock = match.groups()
        return _epoch(year, month, day) + _of_day(clock)
    if (match := _TIME.fullmatch(text)) and match.group(3):
        return _of_day(list(match.groups()))
    raise ValueError(cell)


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


def _epoch(year: str, month: str, day: str) -> float:
    return (date(int(year), int(month), int(day)).toordinal() - 719163) * _DAY


def _of_day(clock: list[str | None]) -> float:
    hours, minutes, seconds, half = (part or "0" for part in clock)
    if half != "0":
        hours = int(hours) % 12 + 12 * (half in "pP")
    # 12:00:00:123 has milliseconds behind its last colon.
    whole, _, rest = re.sub("[,:]", ".", seconds).partition(".")
    return int(hours) * 3600.0 + int(minutes) * 60.0 + float(f"{whole}.{rest or 0}")


def _zone(zone: str | None) -> float:
    if not zone or zone[0] not in "+-":
        return 0.0
    seconds = int(zone[1:3]) * 3600.0 + int(zone[-2:]) * 60.0
    return seconds if zone[0] == "+" else -seconds


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
