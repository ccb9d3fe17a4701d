"""Zero-phase low-pass filtering and the cut-off that a motion suggests."""

from __future__ import annotations

import numpy as np
from scipy.signal import (  # pyright: ignore[reportMissingTypeStubs]
    butter,  # pyright: ignore[reportUnknownVariableType]
    sosfiltfilt,  # pyright: ignore[reportUnknownVariableType]
)

from dynid.core.arrays import Array

ORDER = 4
NYQUIST_SHARE = 0.8
"""Cut-offs stay below this share of half the sampling rate."""
HARMONIC_FACTOR = 10.0
"""Default cut-off over the highest frequency of the motion (5 to 10 in methods.md 3)."""
HIGHEST_MOTION_HZ = 25.0
"""No arm is excited by design above this."""
LOWEST_DEFAULT_HZ = 5.0
"""Friction turns over faster than the slowest motions."""


def low_pass(values: Array, rate_hz: float, cutoff_hz: float) -> Array:
    """Butterworth of order 4, forward and backward, along the first axis.

    At the cut-off, at most `NYQUIST_SHARE` of half the rate, half the amplitude remains.
    """
    share = min(cutoff_hz / (rate_hz / 2), NYQUIST_SHARE)
    sections = np.asarray(butter(ORDER, share, output="sos"), dtype=np.float64)
    # The natural length of the tail, as far as short records have it.
    padding = min(int(6 / share) + 1, len(values) - 2)
    return np.asarray(
        sosfiltfilt(sections, values, axis=0, padlen=max(padding, 0)), dtype=np.float64
    )


def motion_bandwidth(q: Array, rate_hz: float, share: float = 0.99) -> float:
    """The frequency [Hz] below which `share` of the velocity's power lies, median joint.

    Only the band in which arms are driven counts: above it lies noise, which differentiation
    makes large.
    """
    taper = np.hanning(len(q))[:, None]
    spectrum = np.fft.rfft((q - q.mean(axis=0)) * taper, axis=0)
    frequency = np.fft.rfftfreq(len(q), 1.0 / rate_hz)
    driven = frequency <= max(HIGHEST_MOTION_HZ, frequency[1])
    frequency = frequency[driven]
    power = np.square(np.abs(spectrum[driven]) * frequency[:, None])
    total = power.sum(axis=0)
    moving = total > 1e-4 * total.max(initial=0.0)
    if total.max(initial=0.0) == 0:
        return float(frequency[1])
    cumulative = np.cumsum(power[:, moving], axis=0) / total[moving]
    edges = frequency[np.argmax(cumulative >= share, axis=0)]
    return float(max(np.median(edges), frequency[1]))


def default_cutoff(q: Array, rate_hz: float) -> float:
    """A cut-off [Hz] from the motion's spectrum, at most 0.8 of half the rate."""
    wanted = max(HARMONIC_FACTOR * motion_bandwidth(q, rate_hz), LOWEST_DEFAULT_HZ)
    return float(min(wanted, NYQUIST_SHARE * rate_hz / 2))
