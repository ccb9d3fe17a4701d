"""Bounds of a motion's positions, velocities and accelerations over all time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.trajectory.fourier import FourierSeries
from dynid.trajectory.scaling import peaks
from dynid.trajectory.trajectory import Trajectory

_RATE_HZ = 1000.0
_FEWEST, _MOST = 2000, 60_000
_DOUBT = 2.0
"""Jerk between samples over the largest jerk seen across one sample."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Extremes:
    """Nothing of the motion is beyond these."""

    lower: Array
    """(n) [rad or m]"""
    upper: Array
    """(n) [rad or m]"""
    velocity: Array
    """(n) [rad/s or m/s]"""
    acceleration: Array
    """(n) [rad/s^2 or m/s^2]"""
    proven: bool
    """Whether they follow from the motion's formula; else from its samples, with the jerk
    between samples taken as twice what neighbouring samples show."""


def dense_times(duration: float) -> Array:
    """Regular times from 0 to `duration`, at 1 kHz, both ends included."""
    count = int(np.clip(np.ceil(duration * _RATE_HZ), _FEWEST, _MOST))
    return np.linspace(0.0, duration, count + 1)


def extremes(trajectory: Trajectory) -> Extremes:
    """The bounds of any trajectory; proven for Fourier series (`scaling.peaks`)."""
    if isinstance(trajectory, FourierSeries):
        peak = peaks(trajectory)
        return Extremes(
            lower=trajectory.offset + peak.below,
            upper=trajectory.offset + peak.above,
            velocity=peak.velocity,
            acceleration=peak.acceleration,
            proven=True,
        )
    times = dense_times(trajectory.duration)
    motion = trajectory.evaluate(times)
    step = trajectory.duration / (len(times) - 1)
    jerk = _DOUBT * np.abs(np.diff(motion.ddq, axis=0)).max(axis=0) / step
    acceleration = np.abs(motion.ddq).max(axis=0) + jerk * step / 2
    # Between samples a smooth curve leaves its chord by at most h^2 / 8 of its curvature.
    bow = acceleration * step**2 / 8
    return Extremes(
        lower=motion.q.min(axis=0) - bow,
        upper=motion.q.max(axis=0) + bow,
        velocity=np.abs(motion.dq).max(axis=0) + jerk * step**2 / 8,
        acceleration=acceleration,
        proven=False,
    )
