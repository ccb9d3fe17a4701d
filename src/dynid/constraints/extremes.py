"""Bounds of a motion between its samples, and the least value of a quantity over time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dynid.core import Array, InputError
from dynid.trajectory import (
    BSpline,
    Extremes,
    FourierQuintic,
    FourierSeries,
    MotionSequence,
    Piece,
    PointToPoint,
    Repetition,
    Trajectory,
    peaks,
    pieces,
)

_RATE_HZ = 1000.0
_FEWEST, _MOST = 2000, 60_000
_MOST_OF_ALL = 20 * _MOST
"""Of all parts together: some 1 GB of memory. Beyond that long parts have fewer."""
_WAVE, _SPAN = 64, 32
"""Fewest samples of a harmonic, and of a polynomial."""
_STEPS, _WAVE_STEPS = 256, 128
"""Intervals of a polynomial, and of a harmonic, whose derivatives are bounded."""
_DOUBT = 2.0
"""Jerk between samples over the largest jerk seen across one sample."""
_BESIDE = 1e-7
"""How far from a jump of the acceleration samples lie, over the time of the leg."""
BEYOND = 0.01
"""The same at most, over the time to the next sample, of which there are `_MOST` in a leg."""


def dense_times(trajectory: Trajectory) -> list[Array]:
    """Times from 0 to the end at 1 kHz, and closer where a part is short or waves are.

    One array for each part in which the acceleration does not jump; what is known of both sides of
    a jump is nearly at it. Of a repetition the first period, which is all of it.

    Raises:
        InputError: More parts than can be judged in the memory that a check may take.
    """
    leaves = list(_leaves(trajectory, 0.0))
    fewest = sum(_fewest(leaf) for _, leaf in leaves)
    if fewest > _MOST_OF_ALL:
        raise InputError(
            "the motion has too many parts to be judged",
            value=len(leaves),
            limit=f"{_MOST_OF_ALL} samples, of which they need {fewest}",
            next_step="Check it in several files.",
        )
    most = _MOST
    while sum(counts := [_samples(leaf, most) for _, leaf in leaves]) > _MOST_OF_ALL + fewest:
        most //= 2
    more = max(1.0, _FEWEST / sum(counts))
    parts: list[Array] = []
    for (start, leaf), count in zip(leaves, counts, strict=True):
        ends, beside = np.array([0.0, leaf.duration]), 0.0
        if isinstance(leaf, PointToPoint):
            ends = np.cumsum([0.0, *(time for time, _ in leaf.polynomials())])
            beside = _BESIDE * leaf.duration
        edges: list[float] = (start + ends).tolist()
        for first, last in pairwise(edges):
            share = (last - first) / leaf.duration
            steps = int(np.ceil(more * count * share))
            parts.append(np.linspace(first + beside, last - beside, steps + 1))
    return parts


def _fewest(leaf: Trajectory) -> int:
    match leaf:
        case FourierSeries() | FourierQuintic():
            return _WAVE * leaf.harmonics
        case BSpline():
            return _SPAN * (leaf.control.shape[1] - leaf.degree)
        case _:
            return _SPAN


def _samples(leaf: Trajectory, most: int) -> int:
    return max(_fewest(leaf), int(np.clip(np.ceil(leaf.duration * _RATE_HZ), 1, most)))


def _leaves(trajectory: Trajectory, start: float) -> Iterator[tuple[float, Trajectory]]:
    """The motions that a motion is put together from, and when they begin."""
    if isinstance(trajectory, MotionSequence):
        for part, begin in zip(trajectory.parts, trajectory.starts, strict=True):
            yield from _leaves(part, start + float(begin))
    elif isinstance(trajectory, Repetition):
        yield from _leaves(trajectory.part, start)
    else:
        yield start, trajectory


def extremes(trajectory: Trajectory) -> Extremes:
    """The bounds of any trajectory; proven for every kind of this package."""
    found = [_of_leaf(leaf) for _, leaf in _leaves(trajectory, 0.0)]
    return Extremes(
        lower=np.min([item.lower for item in found], axis=0),
        upper=np.max([item.upper for item in found], axis=0),
        velocity=np.max([item.velocity for item in found], axis=0),
        acceleration=np.max([item.acceleration for item in found], axis=0),
        proven=all(item.proven for item in found),
    )


def _of_leaf(trajectory: Trajectory) -> Extremes:
    if type(trajectory) is FourierSeries:
        return peaks(trajectory)
    try:
        parts = pieces(trajectory)
    except InputError:
        return _from_samples(trajectory)
    bounds = np.array([_of_piece(piece) for piece in parts])
    lower, upper = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    most = np.maximum(np.abs(lower), np.abs(upper))
    return Extremes(lower=lower[0], upper=upper[0], velocity=most[1], acceleration=most[2])


def _of_piece(piece: Piece) -> Array:
    """(2, 3, n) what q, dq and ddq of a formula are not below and not above.

    Between samples h apart a function leaves the larger of both by at most h^2 / 8 of its second
    derivative, and that one its own samples by h^2 / 8 of the fourth, which is at most the sum of
    its coefficients' sizes.
    """
    count = max(_STEPS, _WAVE_STEPS * piece.harmonics)
    s: Array = np.linspace(0.0, 1.0, count + 1)
    eighth = 1.0 / (8.0 * count**2)
    values: list[Array] = []
    steepest: list[Array] = []
    slope = piece
    for _ in range(7):
        values.append(slope.values(s))
        waves = np.abs(slope.a) + np.abs(slope.b)
        steepest.append(np.abs(slope.polynomial).sum(axis=1) + waves.sum(axis=1))
        slope = slope.slope()
    bounds = np.empty((2, 3, len(piece.polynomial)))
    for order in range(3):
        value, bend = values[order], np.abs(values[order + 2])
        room = eighth * (np.maximum(bend[:-1], bend[1:]) + eighth * steepest[order + 4])
        bounds[0, order] = (np.minimum(value[:-1], value[1:]) - room).min(axis=0)
        bounds[1, order] = (np.maximum(value[:-1], value[1:]) + room).max(axis=0)
        bounds[:, order] /= piece.duration**order
    return bounds


def _from_samples(trajectory: Trajectory) -> Extremes:
    """Of samples, with the jerk between them taken as twice what neighbouring ones show.

    Differences count as well: by the mean value theorem no motion is slower than its way, whatever
    its class says of derivatives.
    """
    times = np.concatenate(dense_times(trajectory))
    motion = trajectory.evaluate(times)
    step = trajectory.duration / (len(times) - 1)
    jerk = _DOUBT * np.abs(np.diff(motion.ddq, axis=0)).max(axis=0) / step
    velocity, most = (
        np.maximum(np.abs(slope).max(axis=0), np.abs(np.diff(value, axis=0)).max(axis=0) / step)
        for value, slope in ((motion.q, motion.dq), (motion.dq, motion.ddq))
    )
    acceleration = most + jerk * step / 2
    # Between samples a smooth curve leaves its chord by at most h^2 / 8 of its curvature.
    bow = acceleration * step**2 / 8
    return Extremes(
        lower=motion.q.min(axis=0) - bow,
        upper=motion.q.max(axis=0) + bow,
        velocity=velocity + jerk * step**2 / 8,
        acceleration=acceleration,
        proven=False,
    )


Judge = Callable[[Array, float], tuple[Array, Array]]
"""Takes middles (N) [s] and half a width [s]; gives values (N) there, and what the quantity is
nowhere below within half a width (N)."""

_CHUNK = 8192
_NARROWEST = 1e-6
"""Intervals are not halved below this half width [s]."""
_SEARCH_MOST = 2_000_000


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
    """The least value over 0 to `duration`, with `first` intervals to begin with.

    The bound may lie `tolerance` below the least value seen, and more where that is far above
    `threshold`, the limit in question.
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
        if half < _NARROWEST or spent > _SEARCH_MOST:
            bound = min(bound, float(lows[open_].min()))
            break
        half /= 2
        middles = np.concatenate([middles[open_] - half, middles[open_] + half])
    return Least(bound=min(bound, best), value=best, t=place)
