"""The least value of a quantity over all time, found so that nothing lower can hide.

An interval whose middle value minus (greatest rate x half width) stays above the least value
seen is settled; the others are halved (branch and bound).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array

Judge = Callable[[Array, float], tuple[Array, Array]]
"""Takes middles (N) [s] and half a width [s]; gives values (N, K) there, and rates (N, K) that
hold anywhere within half a width [1/s]."""

_CHUNK = 8192
_NARROWEST = 1e-6
"""Intervals are not halved below this half width [s]."""
_MOST = 2_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Least:
    """The least value over all time."""

    bound: float
    """Nothing is lower than this."""
    value: float
    """The least value seen."""
    t: float
    """Where it was seen [s]."""
    index: int
    """Which of the K quantities it is."""


def least_value(
    judge: Judge, duration: float, *, first: int, threshold: float, tolerance: float
) -> Least:
    """The least of K quantities over 0 to `duration`.

    Args:
        judge: Values and rates.
        duration: The end [s].
        first: Number of intervals to begin with.
        threshold: The limit in question: far above it the bound may be coarser.
        tolerance: How far below the least value seen the bound may lie, at the limit.
    """
    half = duration / first / 2
    middles: Array = (2.0 * np.arange(first, dtype=np.float64) + 1.0) * half
    best, place, index, bound = np.inf, 0.0, 0, np.inf
    spent = 0
    while True:
        lows = np.empty(len(middles))
        for start in range(0, len(middles), _CHUNK):
            part = slice(start, start + _CHUNK)
            values, rates = judge(middles[part], half)
            lows[part] = (values - half * rates).min(axis=1)
            k, column = divmod(int(np.argmin(values)), values.shape[1])
            if values[k, column] < best:
                best, place, index = float(values[k, column]), float(middles[start + k]), column
        spent += len(middles)
        slack = tolerance + 0.1 * max(best - threshold, 0.0)
        open_ = lows < best - slack
        bound = min(bound, float(lows[~open_].min(initial=np.inf)))
        if not open_.any():
            break
        # A limit that is broken at a sample is broken: only the bound's digits are left.
        if best < threshold or half < _NARROWEST or spent > _MOST:
            bound = min(bound, float(lows[open_].min()))
            break
        half /= 2
        middles = np.concatenate([middles[open_] - half, middles[open_] + half])
    return Least(bound=min(bound, best), value=best, t=place, index=index)
