"""From recorded stamps to a uniform grid; periods and repetitions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dynid.core import Array, InputError, scipy_part
from dynid.recording import AnyRecording, ExperimentRecord

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


def stretches(t: Array, apart_s: float) -> list[slice]:
    """The parts of some samples between which stamps t (N) are farther apart [s]."""
    cuts = (np.flatnonzero(np.diff(t) > apart_s) + 1).tolist()
    return [slice(a, b) for a, b in pairwise([0, *cuts, len(t)])]


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


MARK = 4096
"""Rows from one known stamp to the next."""
MOST_STEPS = 1_000_000
"""Steps whose median is the step of the grid: of longer recordings every so manieth."""
BESIDE = 8
"""Rows beside a part that interpolation looks at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamGrid:
    """The uniform grid of a recording, at its median rate."""

    first_row: int
    last_row: int
    """One behind the last row of the window."""
    start_s: float
    """Its first stamp [s]."""
    step_s: float
    count: int
    """Points of the grid."""
    uniform: bool
    """Whether the rows are the grid."""
    marks: Array
    """Stamps of every `MARK`-th row of the recording [s]."""
    gaps: tuple[tuple[int, int], ...]
    """First point, and one behind the last, of the grid in each gap."""

    @property
    def rate_hz(self) -> float:
        """Samples a second."""
        return 1.0 / self.step_s

    def times(self, first: int, last: int) -> Array:
        """Stamps of some points [s]."""
        return self.start_s + self.step_s * np.arange(first, last, dtype=np.float64)

    def rows(self, first: int, last: int) -> tuple[int, int]:
        """Rows that some points lie between, and a few beside them."""
        if self.uniform:
            return self.first_row + first, self.first_row + last
        a, b = self.start_s + self.step_s * first, self.start_s + self.step_s * last
        low = (int(np.searchsorted(self.marks, a)) - 1) * MARK - BESIDE
        high = int(np.searchsorted(self.marks, b, side="right")) * MARK + BESIDE
        return max(low, self.first_row), min(high, self.last_row)


def survey(
    recording: AnyRecording, start_s: float | None = None, stop_s: float | None = None
) -> StreamGrid:
    """Find the grid of the window of a recording by its stamps alone.

    A recording that is uniform already is its own grid.

    Raises:
        InputError: An empty window, or stamps so irregular that the grid would have `MAX_GROWTH`
            times as many points as rows.
    """
    marks, steps, first, last, start, stop = _stamps(recording, start_s, stop_s)
    count = last - first
    step = float(np.median(steps))
    away, gaps, row, before = 0.0, list[tuple[float, float]](), 0, start
    slope = (stop - start) / (count - 1)
    for t in _blocks(recording):
        inside = t[max(first - row, 0) : max(last - row, 0)]
        begin = max(row - first, 0)
        row += len(t)
        if not len(inside):
            continue
        line = start + np.arange(begin, begin + len(inside)) * slope
        away = max(away, float(np.abs(inside - line).max()))
        ends = np.concatenate([[before], inside])
        wide = np.flatnonzero(np.diff(ends) > GAP_STEPS * step)
        gaps += zip(ends[wide].tolist(), ends[wide + 1].tolist(), strict=True)
        before = float(inside[-1])
    # Stamps with few digits jitter in their last one; only the distance from the grid matters.
    uniform = away <= UNIFORM_WITHIN * step
    points = count if uniform else int((stop - start) / step * (1 + 1e-12)) + 1
    if points > MAX_GROWTH * count:
        raise InputError(
            "the time stamps are too irregular for a uniform grid",
            value=f"{points} points for {count} rows",
            next_step="Cut the recording at its gaps, or pass --rate at import.",
        )
    grid = StreamGrid(
        first_row=first,
        last_row=last,
        start_s=start,
        step_s=slope if uniform else step,
        count=points,
        uniform=uniform,
        marks=np.array(marks),
        gaps=(),
    )
    if uniform:
        return grid
    return replace(grid, gaps=tuple((_at(grid, a), _at(grid, b)) for a, b in gaps))


def _at(grid: StreamGrid, time_s: float) -> int:
    """The first point of the grid that is not before a time."""
    near = max(int((time_s - grid.start_s) / grid.step_s) - 1, 0)
    # Rounding: the point is one of the next few.
    while grid.start_s + grid.step_s * near < time_s:
        near += 1
    return near


def _blocks(recording: AnyRecording) -> Iterator[Array]:
    return iter([recording.t]) if isinstance(recording, ExperimentRecord) else recording.stamps()


def _stamps(
    recording: AnyRecording, start_s: float | None, stop_s: float | None
) -> tuple[list[float], Array, int, int, float, float]:
    """Marks, steps of the window, its first row and the one behind its last, and their stamps."""
    marks: list[float] = []
    steps: list[Array] = []
    every = -(-recording.samples // MOST_STEPS)
    row = first = last = 0
    origin = start = stop = np.nan
    elapsed = np.zeros(1)
    for number, t in enumerate(_blocks(recording)):
        origin = float(t[0]) if row == 0 else origin
        elapsed = t - origin
        marks += t[-row % MARK :: MARK].tolist()
        a, b = rows_between(elapsed, start_s, stop_s)
        first += a
        last += b
        row += len(t)
        if b > a:
            if number % every == 0:
                steps.append(np.diff(t[a:b], prepend=t[a] if np.isnan(stop) else stop))
            start = float(t[a]) if np.isnan(start) else start
            stop = float(t[b - 1])
    require_window(last - first, start_s, stop_s, elapsed)
    # The first stamp has no step before it.
    return marks, np.concatenate(steps)[1:], first, last, start, stop


def onto(
    grid: Array, rate_hz: float, t: Array, q: Array, qd: Array | None, torque: Array, valid: Array
) -> UniformSignals:
    """Signals at stamps t (N) put onto a grid (M); see `UniformSignals`.

    Positions and velocities follow a shape-preserving cubic, torques straight lines.
    """
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
