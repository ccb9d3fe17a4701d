"""The least value of a quantity over all time, found so that nothing lower can hide.

An interval that cannot hold less than the least value seen is settled; the others are halved
(branch and bound).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array

Judge = Callable[[Array, float], tuple[Array, Array]]
"""Takes middles (N) [s] and half a width [s]; gives values (N) there, and what the quantity is
nowhere below within half a width (N)."""

_CHUNK = 8192
_NARROWEST = 1e-6
"""Intervals are not halved below this half width [s]."""
_MOST = 2_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Least:
    """The least value over all time."""

    bound: float
    """Nothing is lower than this; where the limit is broken, the least value seen."""
    value: float
    """The least value seen."""
    t: float
    """Where it was seen [s]."""


def least_value(
    judge: Judge, duration: float, *, first: int, threshold: float, tolerance: float
) -> Least:
    """The least value over 0 to `duration`.

    Args:
        judge: Values and bounds.
        duration: The end [s].
        first: Number of intervals to begin with.
        threshold: The limit in question: far above it the bound may be coarser.
        tolerance: How far below the least value seen the bound may lie, at the limit.
    """
    half = duration / first / 2
    middles: Array = (2.0 * np.arange(first, dtype=np.float64) + 1.0) * half
    best, place, bound = np.inf, 0.0, np.inf
    spent = 0
    while True:
        lows = np.empty(len(middles))
        for start in range(0, len(middles), _CHUNK):
            part = slice(start, start + _CHUNK)
            values, lows[part] = judge(middles[part], half)
            k = int(np.argmin(values))
            if values[k] < best:
                best, place = float(values[k]), float(middles[start + k])
        spent += len(middles)
        slack = tolerance + 0.1 * max(best - threshold, 0.0)
        open_ = lows < best - slack
        bound = min(bound, float(lows[~open_].min(initial=np.inf)))
        if not open_.any():
            break
        if best < threshold:
            # Broken is broken: nothing is left to prove.
            return Least(bound=best, value=best, t=place)
        if half < _NARROWEST or spent > _MOST:
            bound = min(bound, float(lows[open_].min()))
            break
        half /= 2
        middles = np.concatenate([middles[open_] - half, middles[open_] + half])
    return Least(bound=min(bound, best), value=best, t=place)
