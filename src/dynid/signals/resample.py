"""From recorded stamps to a uniform grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator  # pyright: ignore[reportMissingTypeStubs]

from dynid.core.arrays import Array
from dynid.core.errors import InputError

UNIFORM_WITHIN = 0.05
"""Stamps within this share of a step of a uniform grid count as uniform."""
GAP_STEPS = 6
"""A step longer than this many medians is a gap: nothing is invented inside it."""
MAX_GROWTH = 4
"""A grid may hold at most this many times the recorded samples."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UniformSignals:
    """Signals on a uniform grid."""

    t: Array
    """(N) time [s]."""
    rate_hz: float
    q: Array
    """(N, n) positions [rad or m]."""
    qd: Array | None
    """(N, n) measured velocities, if recorded."""
    torque: Array
    """(N, n) measured joint torques [N.m or N]."""
    valid: Array
    """(N) 1.0 where the grid lies between recorded neighbours, 0.0 inside gaps."""
    noise: Array | None = None
    """(n) torque noise known from repetitions [N.m or N]."""


def window(t: Array, start_s: float | None, stop_s: float | None) -> slice:
    """The samples between two times, counted from the record's start.

    Raises:
        InputError: The window is empty or holds fewer than 32 samples.
    """
    elapsed = t - t[0]
    first = 0 if start_s is None else int(np.searchsorted(elapsed, start_s - 1e-9))
    last = len(t) if stop_s is None else int(np.searchsorted(elapsed, stop_s - 1e-9))
    if last - first < 32:
        raise InputError(
            "the window holds too few samples",
            where=f"--from {start_s if start_s is not None else 0:g} "
            f"--to {stop_s if stop_s is not None else elapsed[-1]:g}",
            value=max(last - first, 0),
            limit=f"at least 32; the record lasts {elapsed[-1]:.3f} s with {len(t)} samples",
        )
    return slice(first, last)


def resample(t: Array, q: Array, qd: Array | None, torque: Array) -> UniformSignals:
    """Put signals on a uniform grid at their median rate.

    Positions and velocities follow a shape-preserving cubic, torques straight lines. A
    recording that is uniform already passes through untouched.

    Raises:
        InputError: Stamps so irregular that the grid would be `MAX_GROWTH` times as long.
    """
    steps = np.diff(t)
    step = float(np.median(steps))
    gaps = steps > GAP_STEPS * step
    # Stamps with few digits jitter in their last one; only the distance from the grid matters.
    away = np.abs(t - (t[0] + np.arange(len(t)) * (t[-1] - t[0]) / (len(t) - 1)))
    if away.max() <= UNIFORM_WITHIN * step:
        step = float((t[-1] - t[0]) / (len(t) - 1))
        return UniformSignals(
            t=t, rate_hz=1.0 / step, q=q, qd=qd, torque=torque, valid=np.ones(len(t))
        )
    count = int((t[-1] - t[0]) / step * (1 + 1e-12)) + 1
    if count > MAX_GROWTH * len(t):
        raise InputError(
            "the time stamps are too irregular for a uniform grid",
            value=f"steps from {steps.min():.2g} to {steps.max():.2g} s",
            next_step="Cut the recording at its gaps, or pass --rate at import.",
        )
    grid: Array = float(t[0]) + step * np.arange(count, dtype=np.float64)
    before = np.clip(np.searchsorted(t, grid, side="right") - 1, 0, len(t) - 2)
    return UniformSignals(
        t=grid,
        rate_hz=1.0 / step,
        q=_cubic(t, q, grid),
        qd=None if qd is None else _cubic(t, qd, grid),
        torque=linear(t, torque, grid),
        valid=np.where(gaps[before], 0.0, 1.0),
    )


def linear(t: Array, values: Array, grid: Array) -> Array:
    """Columns (N, n) at stamps t (N), on straight lines at other times (M); (M, n)."""
    out = np.empty((len(grid), values.shape[1]))
    for j, column in enumerate(values.T):
        out[:, j] = np.interp(grid, t, column)
    return out


def _cubic(t: Array, values: Array, grid: Array) -> Array:
    return np.asarray(PchipInterpolator(t, values, axis=0)(grid), dtype=np.float64)
