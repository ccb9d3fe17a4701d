"""Recordings whose torque was low-passed before it was written: the model passes the same filter.

A published torque that has been smoothed shows every step of friction as a slope. Compared with
columns that keep their steps, it makes friction too wide, motor inertias negative and delays
where none are. Regressor and torque must pass the same filter (Gautier 1997, parallel filtering).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import (  # pyright: ignore[reportMissingTypeStubs]
    butter,  # pyright: ignore[reportUnknownVariableType]
    sosfiltfilt,  # pyright: ignore[reportUnknownVariableType]
)

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.signals.resample import GAP_STEPS, UniformSignals, linear

REACH = 6.0
"""Periods of the cut-off after which the response has decayed to 1e-6 (order 4)."""
SETTLED = 0.5
"""Periods of the cut-off beside the ends of a record that are not used."""
ORDERS = (1, 2, 3, 4)
SMOOTHED_DB = -110.0
"""Power of the torque in the upper half of the band, over its strongest line, below which no
current or torque sensor can have written it: their noise is 40 dB and more above."""

END_DB = -60.0
"""Power over the strongest line below which a smoothed torque has ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueFilter:
    """A Butterworth low-pass, forward and backward.

    Raises:
        InputError: A cut-off that is not positive, or an order that is not in `ORDERS`.
    """

    cutoff_hz: float
    order: int

    def __post_init__(self) -> None:
        if not 0 < self.cutoff_hz < 1e6:
            raise InputError("the torque filter's cut-off must be positive", value=self.cutoff_hz)
        if self.order not in ORDERS:
            raise InputError("the torque filter's order", value=self.order, limit=ORDERS)

    def reach(self, rate_hz: float) -> int:
        """Samples to either side that an output still depends on."""
        return int(np.ceil(REACH * rate_hz / self.cutoff_hz))

    def settled(self, rate_hz: float) -> int:
        """Samples at an end that what lies beyond it has shaped."""
        return int(np.ceil(SETTLED * rate_hz / self.cutoff_hz))

    def passed(self, values: Array, t: Array, rate_hz: float) -> Array:
        """What the filter makes of signals along the last axis.

        Args:
            values: (..., N) signals.
            t: (N) their stamps [s]; each stretch between gaps passes on its own.
            rate_hz: Rate of the grid that they pass on.
        """
        sections = np.asarray(
            butter(self.order, self.cutoff_hz, fs=rate_hz, output="sos"), dtype=np.float64
        )
        out = np.array(values)
        breaks = np.flatnonzero(np.diff(t) > GAP_STEPS / rate_hz) + 1
        for first, last in zip([0, *breaks], [*breaks, len(t)], strict=True):
            if last - first > 2:
                part = slice(int(first), int(last))
                padding = int(2 * rate_hz / self.cutoff_hz)
                out[..., part] = _stretch(sections, values[..., part], t[part], rate_hz, padding)
        return out

    def describe(self) -> str:
        """In words."""
        return (
            f"the record's torque was low-passed at {self.cutoff_hz:.3g} Hz "
            f"(order {self.order}, both ways): the model passes the same filter"
        )


def _stretch(sections: Array, values: Array, t: Array, rate_hz: float, padding: int) -> Array:
    count = round((t[-1] - t[0]) * rate_hz) + 1
    grid: Array = float(t[0]) + np.arange(count, dtype=np.float64) / rate_hz
    uniform = count == len(t) and np.abs(grid - t).max() < 1e-3 / rate_hz
    flat = values.reshape(-1, len(t))
    if not uniform:
        flat = linear(t, flat.T, grid).T
    padding = min(len(grid) - 2, padding)
    passed = np.asarray(sosfiltfilt(sections, flat, axis=-1, padlen=padding), dtype=np.float64)
    if not uniform:
        passed = linear(grid, passed.T, t).T
    return passed.reshape(values.shape)


def was_smoothed(signals: UniformSignals) -> bool:
    """Whether the torque has nothing left in the upper half of its band, noise included."""
    level = _levels(signals.torque)
    return bool((level[len(level) // 2 :].mean(axis=0) < 10 ** (SMOOTHED_DB / 10)).all())


def torque_end(signals: UniformSignals) -> float:
    """The frequency [Hz] above which no joint's torque has more than `END_DB` left."""
    level = _levels(signals.torque)
    last = int(np.flatnonzero((level > 10 ** (END_DB / 10)).any(axis=1))[-1])
    return max(last, 1) / len(level) * signals.rate_hz / 2


def _levels(torque: Array) -> Array:
    """(f, n) power of each line over the strongest line of its joint; ones where it has none."""
    share = np.arange(len(torque), dtype=np.float64)[:, None] / max(len(torque) - 1, 1)
    level = (torque - torque[0] - share * (torque[-1] - torque[0])) * np.hanning(len(torque))[
        :, None
    ]
    power = np.square(np.abs(np.fft.rfft(level, axis=0)))
    strongest = power.max(axis=0)
    return np.divide(power, strongest, out=np.ones_like(power), where=strongest > 0)
