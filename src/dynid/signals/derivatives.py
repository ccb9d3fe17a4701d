"""Derivatives of uniform samples."""

from __future__ import annotations

import numpy as np
from scipy.signal import (  # pyright: ignore[reportMissingTypeStubs]
    savgol_filter,  # pyright: ignore[reportUnknownVariableType]
)

from dynid.core.arrays import Array
from dynid.core.errors import InputError

METHODS = ("central", "savgol")


def derivative(values: Array, rate_hz: float, method: str, cutoff_hz: float) -> Array:
    """First derivative along the first axis [unit/s].

    Args:
        values: (N, n) uniform samples.
        rate_hz: Sampling rate.
        method: `central` differences of fourth order, or `savgol`, a cubic over one period
            of the cut-off.
        cutoff_hz: Sets the window of `savgol`.

    Raises:
        InputError: An unknown method.
    """
    if method == "central":
        return _central(values, rate_hz)
    if method == "savgol":
        half = max(2, int(0.5 * rate_hz / cutoff_hz))
        width = min(2 * half + 1, len(values) - 1 + len(values) % 2)
        return np.asarray(
            savgol_filter(values, width, 3, deriv=1, delta=1.0 / rate_hz, axis=0),
            dtype=np.float64,
        )
    raise InputError("unknown derivative", value=method, limit=METHODS)


def _central(values: Array, rate_hz: float) -> Array:
    """Fourth-order differences: second-order ones lose 0.3 % of a 2.5 Hz motion at 125 Hz."""
    slope = np.gradient(values, 1.0 / rate_hz, axis=0, edge_order=2)
    if len(values) >= 5:
        inner = 8 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])
        slope[2:-2] = inner * (rate_hz / 12)
    return slope


def fourier_derivative(values: Array, rate_hz: float, cutoff_hz: float) -> tuple[Array, Array]:
    """Harmonics up to the cut-off, and their exact derivative (Swevers et al. 1997).

    Args:
        values: (N, n) samples of whole periods.
        rate_hz: Sampling rate.
        cutoff_hz: Highest harmonic kept.

    Returns:
        (N, n) smoothed values and (N, n) derivative.
    """
    count = len(values)
    spectrum = np.fft.rfft(values, axis=0)
    frequency = np.fft.rfftfreq(count, 1.0 / rate_hz)
    spectrum[frequency > cutoff_hz] = 0.0
    slope = spectrum * (2j * np.pi * frequency)[:, None]
    return np.fft.irfft(spectrum, count, axis=0), np.fft.irfft(slope, count, axis=0)
