"""Axes: ranges, ticks at round numbers, and numbers as people read them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError

MINUS = "\N{MINUS SIGN}"
_STEPS = (1.0, 2.0, 5.0, 10.0)
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 3) -> str:
    """A number for people, with a true minus sign; a dash where there is none.

    Args:
        value: The number, or None or NaN.
        digits: Significant digits.
    """
    if value is None or not math.isfinite(value):
        return "\N{EN DASH}"
    # Hundreds of percent are read as such, not as powers of ten.
    whole = 10.0**digits <= abs(value) < 1e5
    text = f"{value:.0f}" if whole else f"{value:#.{digits}g}".rstrip(".") if value else "0"
    return text.replace("-", MINUS)


def units(text: str) -> str:
    """A unit as it is printed: `N.m.s/rad` becomes N\N{MIDDLE DOT}m\N{MIDDLE DOT}s/rad."""
    for plain, printed in (("N.m.s", "N·m·s"), ("N.m", "N·m"), ("kg.m", "kg·m"), ("N.s", "N·s")):
        text = text.replace(plain, printed)
    return text.replace("m^2", "m²").replace("s^2", "s²")


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """The range of one axis.

    Attributes:
        low: Value at its start.
        high: Value at its end; above `low`.
        label: What it shows, with its unit in brackets.
        log: Whether it is logarithmic; both ends are positive then.
        names: Names of the values 0, 1, 2...: an axis of categories.
        bounds: One tick with plus and minus, for a narrow strip around zero.
    """

    low: float
    high: float
    label: str = ""
    log: bool = False
    names: tuple[str, ...] = ()
    bounds: bool = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise InputError("range of an axis", value=(self.low, self.high), where=self.label)
        if self.log and self.low <= 0:
            raise InputError("start of a logarithmic axis", value=self.low, limit="above 0")

    def share(self, values: ArrayLike) -> Array:
        """Where values lie: 0 at the start, 1 at the end, NaN where not known."""
        given = np.asarray(values, dtype=np.float64)
        low, high = self.low, self.high
        if self.log:
            given = np.log10(np.maximum(given, low * 1e-6))
            low, high = math.log10(low), math.log10(high)
        placed: Array = (given - low) / (high - low)
        return placed

    def ticks(self, most: int) -> tuple[tuple[float, str], ...]:
        """Values with their texts, about as many at most as there is room for."""
        if self.names:
            return tuple((float(k), name) for k, name in enumerate(self.names))
        if self.bounds:
            reach = max(abs(self.low), abs(self.high))
            return ((0.0, f"±{reach:.2g}"),)
        if self.log:
            return _decades(self.low, self.high, most)
        step = _round_step((self.high - self.low) / max(most, 1))
        first, last = self._within(step)
        if last - first < 2:
            step = _round_step(step / 2.5)
            first, last = self._within(step)
        digits = max(0, -math.floor(math.log10(step) + 1e-9))
        return tuple((k * step, _tick(k * step, digits)) for k in range(first, last + 1))

    def _within(self, step: float) -> tuple[int, int]:
        return math.ceil(self.low / step - 1e-6), math.floor(self.high / step + 1e-6)


_ROOM = 0.06
"""Left free at each end of an axis, as a share of its range."""


def axis_around(
    *values: ArrayLike,
    label: str = "",
    log: bool = False,
    zero: bool = False,
    even: bool = False,
) -> Axis:
    """An axis that holds values.

    Args:
        values: Arrays; what is not finite does not count.
        label: What it shows, with its unit.
        log: Logarithmic; only positive values count.
        zero: Zero is on it.
        even: As far below zero as above.
    """
    flat = np.concatenate([np.ravel(np.asarray(v, dtype=np.float64)) for v in values])
    flat = flat[np.isfinite(flat) & ((flat > 0) if log else True)]
    if flat.size == 0:
        flat = np.array([1.0, 10.0] if log else [0.0, 1.0])
    low, high = float(flat.min()), float(flat.max())
    if zero:
        low, high = min(low, 0.0), max(high, 0.0)
    if even:
        low, high = -max(-low, high), max(-low, high)
    if log:
        grow = max((high / low) ** _ROOM, 1.1)
        return Axis(low=low / grow, high=high * grow, label=label, log=True)
    spread = high - low or abs(high) or 1.0
    return Axis(
        low=low if zero and low == 0 else low - _ROOM * spread,
        high=high if zero and high == 0 else high + _ROOM * spread,
        label=label,
    )


def category_axis(names: Sequence[str]) -> Axis:
    """An axis with a place for each name."""
    return Axis(low=-0.5, high=len(names) - 0.5, names=tuple(names))


def _round_step(least: float) -> float:
    decade = 10.0 ** math.floor(math.log10(least))
    return next(decade * step for step in _STEPS if decade * step >= least * (1 - 1e-9))


def _tick(value: float, digits: int) -> str:
    if abs(value) >= 1e5:
        return f"{value:.0e}".replace("e+0", "e").replace("e+", "e").replace("-", MINUS)
    return f"{value:.{digits}f}".replace("-", MINUS) if abs(value) > 1e-12 else "0"


def _decades(low: float, high: float, most: int) -> tuple[tuple[float, str], ...]:
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    if last - first < 2:
        steps = [m * 10.0**k for k in range(first - 1, last + 1) for m in (1, 2, 5)]
        return tuple((v, f"{v:g}") for v in steps if low <= v <= high)
    every = max(1, math.ceil((last - first + 1) / max(most, 1)))
    return tuple(
        (10.0**k, f"{10.0**k:g}" if -3 <= k <= 4 else f"10{str(k).translate(_RAISED)}")
        for k in range(first, last + 1, every)
    )
