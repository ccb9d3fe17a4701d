"""Units that a header gives in brackets: known ones pass, others are refused, never ignored."""

from __future__ import annotations

from dynid.core.errors import RecordError

_ANGLE = frozenset({"rad", "rads", "m", "deg", "degs", "degree", "degrees", "°"})
_TORQUE = frozenset({"nm", "n.m", "n*m", "n m", "n·m", "n"})
_CURRENT = frozenset({"a", "amp", "amps", "ampere"})
_KNOWN: dict[str, frozenset[str]] = {
    "t": frozenset({"s", "sec", "seconds", "ms", "msec", "us", "usec", "ns", "nsec", "nanosec"}),
    "q": _ANGLE,
    "target_q": _ANGLE,
    "current": _CURRENT,
    "target_current": _CURRENT,
    "effort": _TORQUE,
    "target_moment": _TORQUE,
    "temperature": frozenset({"c", "°c", "degc", "deg c", "celsius"}),
}
_PER_SECOND = frozenset({"qd", "qdd", "target_qd", "target_qdd"})


def check_unit(quantity: str, unit: str, column: str, where: str) -> None:
    """Refuse a unit that would be read as another.

    Args:
        quantity: What the column holds.
        unit: The text in brackets, lower case; empty for none.
        column: The column's name, for the message.
        where: The file, for the message.

    Raises:
        RecordError: A unit that is not known for this quantity.
    """
    if quantity in _PER_SECOND:
        known = unit.split("/")[0].strip() in _ANGLE
        allowed = "rad/s, m/s, deg/s (and per s^2)"
    else:
        units = _KNOWN.get(quantity, frozenset())
        known = unit in units or not units
        allowed = ", ".join(sorted(units))
    if unit and not known:
        raise RecordError(
            f"column '{column[:60]}' is in a unit that dynid does not convert",
            where=where,
            value=unit[:20],
            limit=allowed,
            next_step="Convert the column to SI units, or name it without its unit.",
        )
