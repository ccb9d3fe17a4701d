"""One cell of a text table: a number, a date, a missing value, or neither; and units of headers.

Known units are converted, others are refused, never ignored.
"""

import math
import re
from collections.abc import Sequence
from datetime import date

import numpy as np

from dynid.core import Array, Finding, RecordError, UnclearRecordError, printable

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
_ASCII = str.maketrans({"\u00a0": " ", "\u202f": " ", "\u2019": "'", "\u2212": "-"})
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
    cell = cell.translate(_ASCII) if not cell.isascii() else cell
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
    return bool(_NAME.match(cell)) and not (is_missing(cell) or is_number(cell) or is_stamp(cell))


def split(line: str, delimiter: str) -> list[str]:
    """The cells of a line; a blank delimiter stands for any run of blanks."""
    return line.split(None if delimiter == " " else delimiter)


def decimals(cell: str) -> int:
    """Digits after the decimal point (or comma), 0 without one."""
    mantissa = cell.strip().lower().partition("e")[0].replace(",", ".")
    return len(mantissa.partition(".")[2])


_DEG = math.pi / 180
_REV = 2 * math.pi
_LENGTH = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6}
_ANGLE = {
    **{"rad": 1.0, "rads": 1.0, "radian": 1.0, "radians": 1.0, "mrad": 1e-3, "urad": 1e-6},
    **{"deg": _DEG, "degs": _DEG, "degree": _DEG, "degrees": _DEG, "°": _DEG},
    **{"mdeg": 1e-3 * _DEG, "cdeg": 1e-2 * _DEG, "\ufffd": _DEG, "grad": _DEG},
    **{"rev": _REV, "revs": _REV, "turn": _REV, "turns": _REV, "revolutions": _REV},
    **_LENGTH,
}
_RATE = {
    **dict.fromkeys(("rpm", "1/min", "rev/min", "revmin"), _REV / 60),
    **dict.fromkeys(("r/min", "u/min", "turn/min", "turns/min"), _REV / 60),
    **{"rps": _REV, "dps": _DEG, "mdps": 1e-3 * _DEG},
    **{"degs": _DEG, "rads": 1.0, "degps": _DEG, "radps": 1.0},
}
_TIME = {
    **{"s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "min": 60.0, "h": 3600.0},
    **{"ms": 1e-3, "msec": 1e-3, "msecs": 1e-3, "millis": 1e-3, "milliseconds": 1e-3},
    **{"us": 1e-6, "usec": 1e-6, "µs": 1e-6, "μs": 1e-6, "micros": 1e-6, "microseconds": 1e-6},
    **{"ns": 1e-9, "nsec": 1e-9, "nsecs": 1e-9, "nanosec": 1e-9, "nanoseconds": 1e-9},
}
_TORQUE = {
    **{"nm": 1.0, "n": 1.0, "mnm": 1e-3, "mn": 1e-3, "unm": 1e-6, "knm": 1e3, "kn": 1e3},
    **{"ncm": 1e-2, "nmm": 1e-3, "newtonmeter": 1.0, "newtonmeters": 1.0},
    **{"kgfm": 9.80665, "kgfcm": 9.80665e-2, "kgcm": 9.80665e-2, "kgm": 9.80665},
    **{"lbfft": 1.3558179483, "ftlb": 1.3558179483, "lbft": 1.3558179483},
    **{"lbfin": 0.1129848290, "inlb": 0.1129848290, "lbin": 0.1129848290, "ozin": 7.0615518e-3},
}
_CURRENT = {
    **{"a": 1.0, "amp": 1.0, "amps": 1.0, "ampere": 1.0, "amperes": 1.0, "arms": 1.0},
    **{"ma": 1e-3, "milliamp": 1e-3, "milliamps": 1e-3, "ua": 1e-6, "ka": 1e3, "ca": 1e-2},
}
_DEGC = {"c": 1.0, "degc": 1.0, "celsius": 1.0, "°c": 1.0, "\ufffdc": 1.0}
_DIMENSION = {
    **{"q": "angle", "target_q": "angle", "qd": "rate", "target_qd": "rate"},
    **{"qdd": "slope", "target_qdd": "slope", "current": "current", "target_current": "current"},
    **{"effort": "torque", "target_moment": "torque", "temperature": "degc", "t": "time"},
}
_TABLES = {"time": _TIME, "angle": _ANGLE, "torque": _TORQUE, "current": _CURRENT, "degc": _DEGC}
_PER = re.compile(r"\s*(?:/|\bper\b|_per_|\s|_|\*|·|\.)\s*(s|sec|second)\s*(?:(\^|\*\*)?-?(\d))?$")
_NOT_SI = {"effort": "N.m", "current": "A", "q": "rad", "qd": "rad/s", "qdd": "rad/s^2", "t": "s"}


def factor_of(quantity: str, unit: str) -> float | None:
    """What values in a unit are multiplied by to be in SI units.

    Args:
        quantity: What the column holds; `t` for time.
        unit: The unit as the header has it, any case; empty for none.

    Returns:
        The factor (1 without a unit), or None where the unit is not one of the quantity's.
    """
    text = unit.strip().lower()
    if not text or text in ("-", "si"):
        return 1.0
    dimension = _DIMENSION.get(quantity)
    if dimension is None:
        return None
    if dimension in ("rate", "slope"):
        return _per_second(text, dimension)
    table = _TABLES[dimension]
    # `q_m_deg` is a motor's angle, not in thousandths.
    bare = re.sub(r"(?<!^[a-mo-z])[\s.*·_\-⋅]", "", text)
    return table.get(text, table.get(bare))


def factors_of(quantity: str, units: Sequence[str]) -> tuple[tuple[float, ...], int | None]:
    """`factor_of` of each column of a quantity, 1 for all where one unit is none of its; which."""
    known = [factor_of(quantity, unit) for unit in units]
    if None in known:
        return (1.0,) * len(known), known.index(None)
    return tuple(value for value in known if value is not None), None


def _per_second(text: str, dimension: str) -> float | None:
    if dimension == "rate" and (factor := _RATE.get(text.replace(" ", "").replace("_", "/"))):
        return factor
    seconds = 1 if dimension == "rate" else 2
    stem, left = text.replace("²", "2").replace("⁻¹", "-1").replace("^-", "^"), 0
    while left < seconds and (match := _PER.search(stem)):
        left += int(match.group(3) or 1)
        stem = stem[: match.start()].strip()
    # `dq [rad]` is a slip of the pen: a rate in radians is meant a second.
    return _ANGLE.get(stem) if left in (0, seconds) else None


def example_columns(joints: int, *, velocity: bool = False) -> str:
    """A `--columns` option for so many joints, six where none are known, with currents."""
    q, qd, current, end = range(1, 2 + 3 * (joints or 6), joints or 6)
    given = f"qd={qd}:{current}," if velocity else ""
    return f"t=0,q={q}:{qd},{given}current={current}:{end}"


def refuse_unit(quantity: str, unit: str, column: str, joints: int) -> RecordError:
    """The error for the unit of a column, of so many, that would be read as another."""
    si = _NOT_SI.get(quantity, "SI units")
    hint = f"Convert the column to {si}, or leave its quantity out of --columns."
    if quantity in ("effort", "current"):
        hint = (
            "Map the columns as a current, for example --columns "
            f"{example_columns(joints)}, and give the torque of one unit "
            f"[N.m/{unit[:10]}] a joint with --gains g1,..,gn."
        )
    return UnclearRecordError(
        f"column '{column[:60]}' is in a unit that dynid does not convert",
        value=unit[:20],
        limit=", ".join(sorted(known_units(quantity))),
        next_step=hint,
    )


def taken_as_it_is(quantity: str, column: str, unit: str) -> Finding:
    """The finding for a unit that is not converted in a column that the user names."""
    said, own = printable(column), printable(unit, 20)
    text = f"{quantity} is taken as it is from {said!r}, though {own!r} is no unit of it"
    return Finding("unit_suspect", text)


def known_units(quantity: str) -> frozenset[str]:
    """The units of a quantity that are converted, as people write them."""
    dimension = _DIMENSION.get(quantity, "")
    if dimension in ("rate", "slope"):
        return frozenset({"rad/s", "deg/s", "rev/s", "rpm", "m/s"})
    return frozenset(unit for unit in _TABLES.get(dimension, {}) if unit.isascii())


def is_unit(text: str) -> bool:
    """Whether a text is a unit of some quantity."""
    return bool(text.strip()) and (
        text.strip() in ("%", "-")
        or any(factor_of(quantity, text) is not None for quantity in _DIMENSION)
    )
