"""Periodic recordings: find the period, average over repetitions, keep the scatter."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.signals.resample import UniformSignals

REPEAT_TOLERANCE = 0.01
"""Repetitions may differ by this share of the motion's standard deviation."""


def find_period(q: Array, rate_hz: float) -> float | None:
    """The period [s] of a motion that repeats at least twice, or None.

    The lag at which the motion comes back onto itself, everywhere and in every joint, within
    `REPEAT_TOLERANCE`. Lags are whole samples: exact averaging needs them to be.
    """
    count = len(q)
    centred = q - q.mean(axis=0)
    scale = centred.std(axis=0)
    moving = scale > max(1e-3, 0.02 * scale.max(initial=0.0))
    if count < 64 or not moving.any():
        return None
    normal = centred[:, moving] / scale[moving]
    size = 1 << (2 * count - 1).bit_length()
    spectrum = np.fft.rfft(normal, size, axis=0)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2, size, axis=0)[: count // 2 + 1].sum(axis=1)
    squares = np.square(normal).sum(axis=1)
    head = np.concatenate([[0.0], np.cumsum(squares)])
    lags = np.arange(count // 2 + 1)
    energy = head[count - lags] + (head[count] - head[lags])
    difference = (energy - 2 * correlation) / ((count - lags) * moving.sum())
    away = np.flatnonzero(difference > 0.5)
    if not len(away):
        return None
    candidates = lags[away[0] :]
    best = candidates[int(np.argmin(difference[candidates]))]
    near = candidates[difference[candidates] < 4 * difference[best] + REPEAT_TOLERANCE**2]
    # The shortest lag that repeats is the period; its neighbours repeat almost as well.
    together = near[near - near[0] == np.arange(len(near))]
    first = together[int(np.argmin(difference[together]))]
    if difference[first] > REPEAT_TOLERANCE**2:
        return None
    return float(first / rate_hz)


def fold_periods(signals: UniformSignals, period_s: float) -> UniformSignals:
    """Average whole repetitions into one period; their scatter is the noise of the torque.

    What lies in gaps does not count; where every repetition has a gap, nothing is valid.

    Args:
        signals: Signals on a uniform grid.
        period_s: Period [s].

    Raises:
        InputError: The period is not a whole number of samples (to 1e-3 of one, or to 1e-6 of
            itself), or is longer than the record.
    """
    exact = period_s * signals.rate_hz
    length = round(exact)
    if length < 2 or abs(exact - length) > 1e-3 * max(1.0, exact / 1000):
        raise InputError("the period is not a whole number of samples", value=exact)
    repetitions = len(signals.t) // length
    if repetitions < 1:
        raise InputError("the record is shorter than its period", value=period_s)

    counts = _stacked(signals.valid[:, None], repetitions, length)
    total = counts.sum(axis=0)
    # Without any repetition, what the gaps were bridged with keeps the period whole.
    weights = np.where(total > 0, counts / np.maximum(total, 1), 1.0 / repetitions)

    def mean(values: Array) -> Array:
        return (_stacked(values, repetitions, length) * weights).sum(axis=0)

    noise = signals.noise
    torque = mean(signals.torque)
    freedom = np.maximum(total - 1, 0).sum()
    if freedom > 0:
        errors = counts * (_stacked(signals.torque, repetitions, length) - torque)
        # The mean of R repetitions is less noisy than each by 1/sqrt(R).
        noise = np.sqrt(np.square(errors).sum(axis=(0, 1)) / freedom / total.mean())
    return UniformSignals(
        t=signals.t[:length],
        rate_hz=signals.rate_hz,
        q=mean(signals.q),
        qd=None if signals.qd is None else mean(signals.qd),
        torque=torque,
        valid=np.where(total[:, 0] > 0, 1.0, 0.0),
        noise=noise,
    )


def _stacked(values: Array, repetitions: int, length: int) -> Array:
    return values[: repetitions * length].reshape(repetitions, length, -1)
