"""Samples of recordings that are too long to be held: processed part by part, as in one piece.

Each part is filtered with so much beside it that nothing of its ends is left (`SETTLED`); its
samples equal those that `process` gives of the whole recording to rounding. Periods are not
folded.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from dynid.core import Array, InputError
from dynid.recording import AnyRecording, ExperimentRecord
from dynid.robot import RobotModel
from dynid.signals import filters, processing, resample


@dataclass(frozen=True, slots=True, kw_only=True)
class LongSignals:
    """A recording and how it is processed, part by part.

    Samples are counted as `process` would keep them.

    Raises:
        InputError: Too few samples.
    """

    recording: AnyRecording
    robot: RobotModel
    settings: processing.ProcessingSettings
    """With a cut-off; without a period; data are thinned."""
    grid: resample.StreamGrid
    encoder_noise: Array | None
    """(n) see `Samples`."""
    runs: tuple[tuple[int, int], ...] = field(init=False)
    """Points of the grid that are kept: the first, and one behind the last, of each run."""

    def __post_init__(self) -> None:
        count = self.grid.count
        unsettled = processing.unsettled(self.grid.rate_hz, self.settings, self.cutoff_hz)
        edge = min(unsettled, count // 4)
        runs: list[tuple[int, int]] = []
        begin = edge
        for a, b in self.grid.gaps:
            if b > a:
                runs.append((begin, a - edge))
                begin = b + edge
        runs.append((begin, count - edge))
        object.__setattr__(self, "runs", tuple((a, b) for a, b in runs if b > a))
        processing.require_samples(self.count)

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
        return processing.block_length(self.grid.rate_hz)

    @property
    def used(self) -> slice:
        """The samples whose torques are used, see `Samples.rows`."""
        return processing.used_rows(self.count, self.settings.torque_filter, self.grid.rate_hz)

    def samples(self, first: int, last: int) -> processing.Samples:
        """The kept samples from the first to the one before the last.

        Raises:
            InputError: A recording without the torques or velocities that are needed.
        """
        beside = int(np.ceil(filters.SETTLED * self.grid.rate_hz / self.cutoff_hz))
        beside += processing.unsettled(self.grid.rate_hz, self.settings, self.cutoff_hz)
        pieces: list[list[Array]] = []
        for near in _together(self._points(first, last), 4 * beside):
            low, high = near[0][0] - beside, near[-1][1] + beside
            ends = max(low, 0), min(high, self.grid.count)
            known = self.recording, self.robot, self.settings, self.grid
            signals = processing.signals_at(*known, *ends)
            motion = processing.filtered_motion(signals, self.settings, self.cutoff_hz)
            noise = self.encoder_noise
            held = signals.q if noise is None else filters.without_noise(signals.q, noise)
            torque = processing.delayed(signals.torque, signals.rate_hz, self.settings.delays_s)
            kept = np.concatenate([np.arange(a, b) for a, b in near]) - max(low, 0)
            pieces.append([values[kept] for values in (signals.t, *motion, held, torque)])
        t, q, dq, ddq, held, tau = (np.concatenate(values) for values in zip(*pieces, strict=True))
        return processing.Samples(
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


def _together(runs: Sequence[tuple[int, int]], apart: int) -> list[list[tuple[int, int]]]:
    """Runs in groups that lie more than `apart` points from each other."""
    groups = [[runs[0]]]
    for before, run in pairwise(runs):
        if run[0] - before[1] > apart:
            groups.append([])
        groups[-1].append(run)
    return groups


def samples_at_stamps(
    record: ExperimentRecord, robot: RobotModel, settings: processing.ProcessingSettings
) -> processing.Samples:
    """Motion from the uniform grid, torque as recorded, at the record's own stamps.

    A record that is uniform already gives the samples of `process`, and its ends. For a jittered
    one the grid holds more points than were recorded, and their torques are averages of
    neighbours: both would flatter a prediction error. So would torques between two samples: with
    a delay the nearest sample stands, and `late_s` tells what is left.

    Raises:
        InputError: See `process`.
    """
    signals = processing.uniform_signals(record, robot, settings)
    samples = processing.samples_from(signals, replace(settings, delays_s=None), trim=False)
    part = resample.window(record.t, settings.start_s, settings.stop_s)
    stamps, torque = record.t[part], processing.measured_torque(record, robot)[part]
    t: Array = stamps - float(stamps[0])
    after = np.clip(np.searchsorted(samples.t, t), 1, samples.count - 1)
    inside = (t >= samples.t[0]) & (t <= samples.t[-1])
    # Between kept grid points that are no neighbours lies a gap.
    inside &= samples.t[after] - samples.t[after - 1] < 1.5 / signals.rate_hz
    kept = t[inside]
    motion = (samples.q, samples.dq, samples.ddq, samples.friction_q)
    q, dq, ddq, unfiltered_q = (resample.linear(samples.t, x, kept) for x in motion)
    samples = replace(
        samples, t=kept, q=q, dq=dq, ddq=ddq, tau=torque[inside], unfiltered_q=unfiltered_q,
        block=1, noise=None, changed=None,
    )  # fmt: skip
    if settings.delays_s is None or not any(settings.delays_s):
        return samples
    if len(settings.delays_s) != robot.joints:
        raise InputError("one delay a joint", value=len(settings.delays_s), limit=robot.joints)
    # The nearest sample: a mean of two has less noise than was recorded.
    want = samples.t[:, None] + np.array(settings.delays_s)
    after = np.clip(np.searchsorted(t, want), 1, len(t) - 1)
    nearest = after - (want - t[after - 1] < t[after] - want)
    tau = np.take_along_axis(torque, nearest, axis=0)
    return replace(samples, tau=tau, late_s=t[nearest] - want)
