"""Samples of recordings that are too long to be held: processed part by part, as in one piece.

Each part is filtered with so much beside it that nothing of its ends is left (`SETTLED`); its
samples equal those that `process` gives of the whole recording to rounding. Periods are not
folded.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from dynid.core import Array
from dynid.recording import AnyRecording, ExperimentRecord, StoredRecording
from dynid.robot import RobotModel
from dynid.signals import resample
from dynid.signals.filters import SETTLED, without_noise
from dynid.signals.process import (
    ProcessingSettings,
    Samples,
    block_length,
    delayed,
    filtered_motion,
    measured_torque,
    require_samples,
    unsettled,
    used_rows,
)

MARK = 4096
"""Rows from one known stamp to the next."""
MOST_STEPS = 1_000_000
"""Steps whose median is the step of the grid: of longer recordings every so manieth."""
BESIDE = 8
"""Rows beside a part that interpolation looks at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamGrid:
    """The uniform grid of a recording; the one that `resample` would give."""

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


def survey(recording: AnyRecording, settings: ProcessingSettings) -> StreamGrid:
    """Find the grid of the window of a recording by its stamps alone.

    Raises:
        InputError: An empty window, or stamps too irregular for a grid.
    """
    marks, steps, first, last, start, stop = _stamps(recording, settings)
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
        wide = np.flatnonzero(np.diff(ends) > resample.GAP_STEPS * step)
        gaps += zip(ends[wide].tolist(), ends[wide + 1].tolist(), strict=True)
        before = float(inside[-1])
    uniform = away <= resample.UNIFORM_WITHIN * step
    grid = StreamGrid(
        first_row=first,
        last_row=last,
        start_s=start,
        step_s=slope if uniform else step,
        count=count if uniform else resample.grid_points(start, stop, step, count),
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
    recording: AnyRecording, settings: ProcessingSettings
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
        a, b = resample.rows_between(elapsed, settings.start_s, settings.stop_s)
        first += a
        last += b
        row += len(t)
        if b > a:
            if number % every == 0:
                steps.append(np.diff(t[a:b], prepend=t[a] if np.isnan(stop) else stop))
            start = float(t[a]) if np.isnan(start) else start
            stop = float(t[b - 1])
    resample.require_window(last - first, settings.start_s, settings.stop_s, elapsed)
    # The first stamp has no step before it.
    return marks, np.concatenate(steps)[1:], first, last, start, stop


@dataclass(frozen=True, slots=True, kw_only=True)
class LongSignals:
    """A recording and how it is processed, part by part.

    Samples are counted as `process` would keep them.

    Raises:
        InputError: Too few samples.
    """

    recording: AnyRecording
    robot: RobotModel
    settings: ProcessingSettings
    """With a cut-off; without a period; data are thinned."""
    grid: StreamGrid
    encoder_noise: Array | None
    """(n) see `Samples`."""
    runs: tuple[tuple[int, int], ...] = field(init=False)
    """Points of the grid that are kept: the first, and one behind the last, of each run."""

    def __post_init__(self) -> None:
        count = self.grid.count
        edge = min(unsettled(self.grid.rate_hz, self.settings, self.cutoff_hz), count // 4)
        runs: list[tuple[int, int]] = []
        begin = edge
        for a, b in self.grid.gaps:
            if b > a:
                runs.append((begin, a - edge))
                begin = b + edge
        runs.append((begin, count - edge))
        object.__setattr__(self, "runs", tuple((a, b) for a, b in runs if b > a))
        require_samples(self.count)

    @property
    def cutoff_hz(self) -> float:
        """The cut-off of the motion [Hz]."""
        return float(self.settings.cutoff_hz or 0.0)

    @property
    def count(self) -> int:
        """Samples that are kept."""
        return sum(b - a for a, b in self.runs)

    @property
    def block(self) -> int:
        """Samples that identification averages over."""
        return block_length(self.grid.rate_hz)

    @property
    def used(self) -> slice:
        """The samples whose torques are used, see `Samples.rows`."""
        return used_rows(self.count, self.settings.torque_filter, self.grid.rate_hz)

    def samples(self, first: int, last: int) -> Samples:
        """The kept samples from the first to the one before the last.

        Raises:
            InputError: A recording without the torques or velocities that are needed.
        """
        beside = int(np.ceil(SETTLED * self.grid.rate_hz / self.cutoff_hz))
        beside += unsettled(self.grid.rate_hz, self.settings, self.cutoff_hz)
        pieces: list[list[Array]] = []
        for near in _together(self._points(first, last), 4 * beside):
            low, high = near[0][0] - beside, near[-1][1] + beside
            signals = self._signals(max(low, 0), min(high, self.grid.count))
            motion = filtered_motion(signals, self.settings, self.cutoff_hz)
            noise = self.encoder_noise
            held = signals.q if noise is None else without_noise(signals.q, noise)
            torque = delayed(signals.torque, signals.rate_hz, self.settings.delays_s)
            kept = np.concatenate([np.arange(a, b) for a, b in near]) - max(low, 0)
            pieces.append([values[kept] for values in (signals.t, *motion, held, torque)])
        t, q, dq, ddq, held, tau = (np.concatenate(values) for values in zip(*pieces, strict=True))
        return Samples(
            t=t - self.grid.start_s,
            q=q,
            dq=dq,
            ddq=ddq,
            tau=tau,
            unfiltered_q=held,
            encoder_noise=self.encoder_noise,
            block=self.block,
            rate_hz=self.grid.rate_hz,
            cutoff_hz=self.cutoff_hz,
            torque_filter=self.settings.torque_filter,
        )

    def _points(self, first: int, last: int) -> list[tuple[int, int]]:
        """Runs of the grid that hold the samples from first to last."""
        found: list[tuple[int, int]] = []
        before = 0
        for a, b in self.runs:
            low, high = max(first - before, 0) + a, min(last - before, b - a) + a
            if high > low:
                found.append((low, high))
            before += b - a
        return found

    def _signals(self, first: int, last: int) -> resample.UniformSignals:
        """The signals at some points of the grid."""
        low, high = self.grid.rows(first, last)
        part = rows_of(self.recording, low, high, self.settings)
        torque = measured_torque(part, self.robot)
        qd, rate = part.signals.get("qd"), self.grid.rate_hz
        valid = np.ones(last - first)
        for a, b in self.grid.gaps:
            valid[max(a - first, 0) : max(b - first, 0)] = 0.0
        if self.grid.uniform:
            return resample.UniformSignals(
                t=part.t, rate_hz=rate, q=part.signals["q"], qd=qd, torque=torque, valid=valid
            )
        times = self.grid.times(first, last)
        return resample.onto(times, rate, part.t, part.signals["q"], qd, torque, valid)


def rows_of(
    recording: AnyRecording,
    first: int,
    last: int,
    settings: ProcessingSettings | None = None,
    *,
    positions: bool = False,
) -> ExperimentRecord:
    """Rows from the first to the one before the last, as a recording of their own.

    Only signals that settings ask for are read, None for all that are processed; or only positions.
    """
    if isinstance(recording, StoredRecording) and positions:
        return recording.part(first, last, ())
    if isinstance(recording, StoredRecording):
        source = "effort" if "effort" in recording.quantities else "current"
        measured = settings is None or settings.velocity == "measured"
        return recording.part(first, last, (source, "qd") if measured else (source,))
    rows = slice(first, last)
    return ExperimentRecord(
        t=recording.t[rows],
        signals={name: values[rows] for name, values in recording.signals.items()},
        metadata=replace(recording.metadata, input_hash=""),
    )


def _together(runs: Sequence[tuple[int, int]], apart: int) -> list[list[tuple[int, int]]]:
    """Runs in groups that lie more than `apart` points from each other."""
    groups = [[runs[0]]]
    for before, run in pairwise(runs):
        if run[0] - before[1] > apart:
            groups.append([])
        groups[-1].append(run)
    return groups
