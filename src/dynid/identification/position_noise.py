"""How noisy the measured motion is, read off its spectrum above the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.identification.smoothing import segments, smooth_cutoff
from dynid.signals.samples import Samples

UPPER_SHARE = 0.7
"""Of the cut-off: above it the filter falls."""
LEAST_STEP = 1e-7
"""Steps of differences are no smaller [rad, rad/s, rad/s^2]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionNoise:
    """White position noise that a low-pass let through up to its cut-off."""

    density: Array
    """(n) one-sided power density of the position noise [rad^2/Hz]."""
    cutoff_hz: float
    """Cut-off [Hz]."""

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "density", frozen(self.density, shape=(None,), name="noise density")
        )

    def covariance(self) -> Array:
        """(3n, 3n) of q, dq, ddq at one instant: velocities are independent of the others."""
        turn = 2 * np.pi
        q, dq, ddq = (
            turn ** (2 * k) * self.cutoff_hz ** (2 * k + 1) / (2 * k + 1) for k in range(3)
        )
        one = np.array([[q, 0, -dq], [0, dq, 0], [-dq, 0, ddq]])
        return np.asarray(np.kron(one, np.diag(self.density)), dtype=np.float64)

    def steps(self) -> Array:
        """(3, n) standard deviations of q, dq, ddq."""
        deviation = np.sqrt(np.diag(self.covariance())).reshape(3, -1)
        return np.maximum(deviation, LEAST_STEP)


def motion_noise(samples: Samples) -> MotionNoise:
    """The noise of a motion: the level of the acceleration's spectrum between motion and cut-off.

    Args:
        samples: The samples; the longest record counts.
    """
    rate = samples.rate_hz
    part = max(segments(samples.t, rate), key=lambda s: s.stop - s.start)
    ddq = samples.ddq[part]
    taper = np.hanning(len(ddq))
    spectrum = np.abs(np.fft.rfft(ddq * taper[:, None], axis=0)) ** 2
    power = 2 * spectrum / (rate * np.square(taper).sum())
    frequency = np.fft.rfftfreq(len(ddq), 1 / rate)
    lower = 2 * smooth_cutoff(samples.q[part], rate)
    band = (frequency > lower) & (frequency < UPPER_SHARE * samples.cutoff_hz)
    if band.sum() < 5:
        # No room above the motion: nothing to be seen there.
        return MotionNoise(density=np.zeros(samples.joints), cutoff_hz=samples.cutoff_hz)
    level = power[band] / (2 * np.pi * frequency[band, None]) ** 4
    # A periodogram's median lies below its mean by log 2.
    return MotionNoise(
        density=np.asarray(np.median(level, axis=0), dtype=np.float64) / np.log(2.0),
        cutoff_hz=samples.cutoff_hz,
    )
