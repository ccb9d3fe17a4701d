"""From recorded stamps to a uniform grid; periods and repetitions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, InputError, scipy_part

UNIFORM_WITHIN = 0.05
"""Stamps within this share of a step of a uniform grid count as uniform."""
GAP_STEPS = 6
"""A step longer than this many medians is a gap: nothing is invented inside it."""
SAME_RATE = 1e-3
"""Share by which rates may differ that count as one."""
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
    changed: Array | None = None
    """(n) standard deviation of what else differs between repetitions: not noise, a change of the
    arm or its load [N.m or N]."""
    periods: float = 1.0
    """Repetitions of which torques are means."""


def window(t: Array, start_s: float | None, stop_s: float | None) -> slice:
    """The samples between two times, counted from the record's start.

    Raises:
        InputError: The window is empty or holds fewer than 32 samples.
    """
    elapsed = t - t[0]
    first, last = rows_between(elapsed, start_s, stop_s)
    require_window(last - first, start_s, stop_s, elapsed)
    return slice(first, last)


def rows_between(elapsed: Array, start_s: float | None, stop_s: float | None) -> tuple[int, int]:
    """The first row and the one behind the last between two times, of ascending times (N) [s]."""
    first = 0 if start_s is None else int(np.searchsorted(elapsed, start_s - 1e-9))
    last = len(elapsed) if stop_s is None else int(np.searchsorted(elapsed, stop_s - 1e-9))
    return first, last


def require_window(rows: int, start_s: float | None, stop_s: float | None, elapsed: Array) -> None:
    """Refuse a window of fewer than 32 rows of all times from the record's start [s]."""
    if rows < 32:
        raise InputError(
            "the window holds too few samples",
            where=f"--from {start_s if start_s is not None else 0:g} "
            f"--to {stop_s if stop_s is not None else elapsed[-1]:g}",
            value=max(rows, 0),
            limit=f"at least 32; the record lasts {elapsed[-1]:.3f} s with {len(elapsed)} samples",
        )


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
    count = grid_points(float(t[0]), float(t[-1]), step, len(t))
    grid: Array = float(t[0]) + step * np.arange(count, dtype=np.float64)
    before = np.clip(np.searchsorted(t, grid, side="right") - 1, 0, len(t) - 2)
    valid: Array = np.where(gaps[before], 0.0, 1.0)
    return onto(grid, 1.0 / step, t, q, qd, torque, valid)


def grid_points(start_s: float, stop_s: float, step_s: float, rows: int) -> int:
    """Points of a uniform grid for some rows.

    Raises:
        InputError: More than `MAX_GROWTH` times as many points as rows.
    """
    count = int((stop_s - start_s) / step_s * (1 + 1e-12)) + 1
    if count > MAX_GROWTH * rows:
        raise InputError(
            "the time stamps are too irregular for a uniform grid",
            value=f"{count} points for {rows} rows",
            next_step="Cut the recording at its gaps, or pass --rate at import.",
        )
    return count


def onto(
    grid: Array, rate_hz: float, t: Array, q: Array, qd: Array | None, torque: Array, valid: Array
) -> UniformSignals:
    """Signals at stamps t (N) put onto a grid (M); see `resample` and `UniformSignals`."""
    return UniformSignals(
        t=grid,
        rate_hz=rate_hz,
        q=_cubic(t, q, grid),
        qd=None if qd is None else _cubic(t, qd, grid),
        torque=linear(t, torque, grid),
        valid=valid,
    )


def at_one_rate(recordings: Sequence[UniformSignals]) -> list[UniformSignals]:
    """Recordings, each on a grid of the fastest one's rate.

    A step in time is then so many whole samples in all of them: a torque between two samples has
    less noise than one on a sample, which looks like a better fit.
    """
    rate = max(signals.rate_hz for signals in recordings)
    out: list[UniformSignals] = []
    for signals in recordings:
        if signals.rate_hz < rate * (1 - SAME_RATE):
            t = signals.t
            grid = t[0] + np.arange(int((t[-1] - t[0]) * rate + 1e-6) + 1) / rate
            between = linear(t, signals.valid[:, None], grid)[:, 0]
            valid = np.floor(between + 1e-9)
            signals = onto(grid, rate, t, signals.q, signals.qd, signals.torque, valid)
        out.append(signals)
    return out


def linear(t: Array, values: Array, grid: Array) -> Array:
    """Columns (N, n) at stamps t (N), on straight lines at other times (M); (M, n)."""
    out = np.empty((len(grid), values.shape[1]))
    for j, column in enumerate(values.T):
        out[:, j] = np.interp(grid, t, column)
    return out


def _cubic(t: Array, values: Array, grid: Array) -> Array:
    between: Array = scipy_part("interpolate").PchipInterpolator(t, values, axis=0)(grid)
    return between


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
    # A part of a sample too much adds up over repetitions.
    last = first * (count // 2 // first)
    if max(difference[first], difference[last]) > REPEAT_TOLERANCE**2:
        return None
    return float(first / rate_hz)


CORRELATED_S = 0.05
"""Means over so long share no noise, but what another load or warmer friction adds."""
FORGOTTEN = 0.06
"""Friction knows nothing of what was before a movement so long: three times the longest
displacement over which it may build up [rad or m]."""


def fold_periods(signals: UniformSignals, period_s: float) -> UniformSignals:
    """Average whole repetitions into one period; their scatter is the noise of the torque.

    What neighbouring means over `CORRELATED_S` share is none: the arm or its load has changed.

    What lies in gaps does not count; where every repetition has a gap, nothing is valid. Nor does
    the torque of a joint at the beginning, until it has moved by `FORGOTTEN` or half as far as it
    ever does, where another repetition shows it: friction there depends on what was before.

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

    torques = _stacked(signals.torque, repetitions, length)
    known = np.repeat(counts, torques.shape[2], axis=2)
    away = np.maximum.accumulate(np.abs(signals.q[:length] - signals.q[0]), axis=0)
    settled = away >= np.minimum(FORGOTTEN, away[-1] / 2)
    known[0] *= settled
    many = known.sum(axis=0)
    torque = (torques * np.where(many > 0, known / np.maximum(many, 1), weights)).sum(axis=0)
    noise, changed, freedom = signals.noise, signals.changed, np.maximum(many - 1, 0).sum(axis=0)
    if freedom.all():
        errors = known * (torques - torque)
        rows = min(max(1, round(CORRELATED_S * signals.rate_hz)), length // 2)
        spans = errors[:, : length - length % rows].reshape(repetitions, -1, rows, errors.shape[2])
        means = spans.mean(axis=2)
        slow = rows * (means * np.roll(means, 1, axis=1)).sum(axis=(0, 1)) / freedom
        changed = np.sqrt(np.maximum(slow, 0.0))
        # The mean of R repetitions is less noisy than each by 1/sqrt(R).
        scatter = np.square(errors).sum(axis=(0, 1)) / freedom
        noise = np.sqrt(np.maximum(scatter - np.square(changed), 0.0) / many.mean(axis=0))
    return replace(
        signals,
        t=signals.t[:length],
        q=mean(signals.q),
        qd=None if signals.qd is None else mean(signals.qd),
        torque=torque,
        valid=np.where(total[:, 0] > 0, 1.0, 0.0),
        noise=noise,
        changed=changed,
        periods=max(1.0, float(many.mean())),
    )


def _stacked(values: Array, repetitions: int, length: int) -> Array:
    return values[: repetitions * length].reshape(repetitions, length, -1)
