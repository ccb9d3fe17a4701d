"""From a recording to samples ready for identification or validation, and their settings."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from dynid import recording
from dynid.core import Array, Indices, InputError, Value, freeze
from dynid.robot import RobotLike, RobotModel, load_robot
from dynid.signals import filters, resample

VELOCITY_SOURCES = ("position", "measured")


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessingSettings:
    """How a recording becomes samples.

    Raises:
        InputError: A setting outside its range.
    """

    cutoff_hz: float | None = None
    """Low-pass cut-off of the motion [Hz]; None: from its spectrum."""
    velocity: str = "position"
    """`position`: differentiate positions; `measured`: start from recorded velocities."""
    derivative: str = "central"
    """`central` or `savgol`; whole periods are always differentiated exactly."""
    delays_s: tuple[float, ...] | None = None
    """How much later each joint's torque was stamped than its motion [s]."""
    start_s: float | None = None
    """Start of the window, from the record's start [s]."""
    stop_s: float | None = None
    """End of the window [s]."""
    decimate: bool = False
    """Average torques and columns over blocks of at least 4 ms."""
    period_s: float | None = None
    """Average over periods of this length [s]."""
    torque_filter: filters.TorqueFilter | None = None
    """The low-pass that the torque had passed before it was written; the model passes it too."""

    def __post_init__(self) -> None:
        if self.cutoff_hz is not None and not 0 < self.cutoff_hz < 1e6:
            raise InputError("must be positive", where="--cutoff", value=self.cutoff_hz)
        if self.velocity not in VELOCITY_SOURCES:
            raise InputError("velocity source", value=self.velocity, limit=VELOCITY_SOURCES)
        if self.derivative not in filters.METHODS:
            raise InputError("derivative", value=self.derivative, limit=filters.METHODS)
        for name, value in (("--from", self.start_s), ("--to", self.stop_s)):
            if value is not None and not 0 <= value < 1e9:
                what, limit = "must be a time after the record's start", "0 s or more, below 1e9 s"
                raise InputError(what, where=name, value=value, limit=limit)
        if self.start_s is not None and self.stop_s is not None and self.stop_s <= self.start_s:
            what, limit = "must be later than the start of the window", f"after {self.start_s:g} s"
            raise InputError(what, where="--to", value=self.stop_s, limit=limit)

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples(Value):
    """Filtered motion and measured torque on a uniform grid.

    Raises:
        InputError: Shapes that disagree or numbers that are not finite.
    """

    t: Array
    """(N) time from the start of the window [s]."""
    q: Array
    """(N, n) positions, filtered [rad or m]."""
    dq: Array
    """(N, n) velocities [rad/s or m/s]."""
    ddq: Array
    """(N, n) accelerations [rad/s^2 or m/s^2]."""
    tau: Array
    """(N, n) joint torques as recorded, aligned in time, not filtered [N.m or N]."""
    block: int = 1
    """Identification averages torques and columns alike over this many samples."""
    rate_hz: float
    """Rate of these samples."""
    cutoff_hz: float
    """Cut-off that was used [Hz]."""
    noise: Array | None = None
    """(n) torque noise from the scatter between periods [N.m or N], if there were periods."""
    changed: Array | None = None
    """(n) what else differs between them, see `UniformSignals` [N.m or N]."""
    periods: float = 1.0
    """Periods of which torques are means."""
    unfiltered_q: Array | None = None
    """(N, n) positions as recorded, without their noise, see `filters.without_noise` [rad or m];
    None for `q`."""
    encoder_noise: Array | None = None
    """(n) standard deviation of that noise [rad or m]."""
    torque_filter: filters.TorqueFilter | None = None
    """The low-pass that the recorded torque has passed."""
    late_s: Array | None = None
    """(N, n) by how much torques are later than the motion beside them, where delays are no whole
    samples and the torques stay as recorded [s]; None for not at all."""

    def __post_init__(self) -> None:
        freeze(self, t=(None,), q=(len(self.t), None))
        freeze(self, dq=self.q.shape, ddq=self.q.shape, tau=self.q.shape)
        if self.unfiltered_q is not None:
            freeze(self, unfiltered_q=self.q.shape)

    def as_recorded(self, values: Array, part: slice | None = None) -> Array:
        """What the record would show of torques or columns (..., T) of a part of the samples."""
        if self.torque_filter is None:
            return values
        stamps = self.t if part is None else self.t[part]
        return self.torque_filter.passed(values, stamps, self.rate_hz)

    def surroundings(self, part: slice) -> tuple[slice, slice]:
        """A part with what the torque filter looks at beside it, and the part inside that."""
        reach = 0 if self.torque_filter is None else self.torque_filter.reach(self.rate_hz)
        wide = slice(max(part.start - reach, 0), min(part.stop + reach, self.count))
        return wide, slice(part.start - wide.start, part.stop - wide.start)

    @property
    def friction_q(self) -> Array:
        """(N, n) positions that the state of presliding friction follows [rad or m]."""
        return self.q if self.unfiltered_q is None else self.unfiltered_q

    @property
    def rows(self) -> slice:
        """The samples whose torques are used: the torque filter has settled there."""
        return used_rows(self.count, self.torque_filter, self.rate_hz)

    @property
    def runs(self) -> list[slice]:
        """Parts between which no motion was recorded for `APART_S`: each starts anew."""
        return resample.stretches(self.t, APART_S - 0.5 / self.rate_hz)

    @property
    def count(self) -> int:
        """Number of samples N."""
        return len(self.t)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.q.shape[1]


APART_S = 1.0
"""Between recordings that are joined; after as long without samples the motion is not known."""


def joined(parts: Sequence[Samples]) -> Samples:
    """Samples of several records, one after the other, `APART_S` apart."""
    starts = np.cumsum([0.0, *(part.t[-1] + APART_S for part in parts[:-1])])
    names = ("q", "dq", "ddq", "tau")
    return replace(
        parts[0],
        t=np.concatenate([part.t + s for part, s in zip(parts, starts, strict=True)]),
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names},
        unfiltered_q=np.concatenate([part.friction_q for part in parts]),
        block=max(part.block for part in parts),
        noise=None,
        changed=None,
        periods=float(np.mean([part.periods for part in parts])),
    )


def used_rows(count: int, torque_filter: filters.TorqueFilter | None, rate_hz: float) -> slice:
    """Of some samples those whose torques are used: the torque filter has settled there."""
    edge = 0 if torque_filter is None else min(torque_filter.settled(rate_hz), count // 8)
    return slice(edge, count - edge)


def measured_torque(record: recording.ExperimentRecord, robot: RobotModel) -> Array:
    """Joint torques (N, n) [N.m or N] of a recording.

    Effort wins over current. Gains given with the recording win over the robot's.

    Raises:
        InputError: The joint counts differ, neither effort nor current was recorded, or a
            drive gain is missing.
    """
    if record.joints != robot.joints:
        raise InputError(
            f"the recording has {record.joints} joints, the robot {robot.name} has {robot.joints}",
            next_step="Pass the right --robot, or lock the joints that were not recorded.",
        )
    if "effort" in record.signals:
        return record.signals["effort"]
    if "current" not in record.signals:
        raise InputError(
            "the recording has neither effort nor current",
            value=", ".join(record.signals),
            next_step="Import it again with --columns ...,effort=A:B or current=A:B.",
        )
    given = record.metadata.drive_gains
    gains = robot.drives.gain if given is None else np.array(given, dtype=np.float64)
    if len(gains) != robot.joints:
        raise InputError("one drive gain a joint is needed", value=len(gains), limit=robot.joints)
    missing = [robot.joint_names[j] for j in np.flatnonzero(~np.isfinite(gains))]
    if missing:
        raise InputError(
            "torque from current needs drive gains [N.m/A]",
            where=robot.name,
            value=f"no gain for {', '.join(missing)}",
            next_step="Pass --gains g1,..,gn; this recording shows them: dynid gains RECORD."
            if {"target_current", "target_moment"} <= set(record.signals)
            else "Pass --gains g1,..,gn, or record effort.",
        )
    return record.signals["current"] * gains


TIME_CONSTANTS = 5.0
"""Cut from both ends: the filter has not settled there."""
BLOCK_RATE_HZ = 250.0
"""Means of blocks where data are thinned, whatever the cut-off: errors of several compare."""
MIN_SAMPLES = 16
LEAST_STRETCH = 4
"""Of so few samples between gaps `unsettled` leaves none."""


def uniform_signals(
    record: recording.ExperimentRecord, robot: RobotModel, settings: ProcessingSettings
) -> resample.UniformSignals:
    """The window of a recording on a uniform grid, torques on the joint side.

    Raises:
        InputError: An empty window, no torque, stamps without a usable rate, or single poses.
    """
    if recording.are_poses(record.signals["q"]):
        raise InputError(
            "these rows are no motion: each position is unrelated to the one before",
            where=record.metadata.origin or None,
            next_step="Identify gravity from poses at rest: dynid gravity RECORD. If it is a "
            "motion, check the columns and the time stamps.",
        )
    grid = resample.survey(record, settings.start_s, settings.stop_s)
    return signals_at(record, robot, settings, grid, 0, grid.count)


def signals_at(
    record: recording.AnyRecording,
    robot: RobotModel,
    settings: ProcessingSettings,
    grid: resample.StreamGrid,
    first: int,
    last: int,
) -> resample.UniformSignals:
    """The signals at some points of a recording's grid."""
    low, high = grid.rows(first, last)
    part = rows_of(record, low, high, settings)
    torque = measured_torque(part, robot)
    qd, rate = part.signals.get("qd"), grid.rate_hz
    valid = np.ones(last - first)
    for a, b in grid.gaps:
        valid[max(a - first, 0) : max(b - first, 0)] = 0.0
    if grid.uniform:
        return resample.UniformSignals(
            t=part.t, rate_hz=rate, q=part.signals["q"], qd=qd, torque=torque, valid=valid
        )
    times = grid.times(first, last)
    return resample.onto(times, rate, part.t, part.signals["q"], qd, torque, valid)


def rows_of(
    record: recording.AnyRecording,
    first: int,
    last: int,
    settings: ProcessingSettings | None = None,
    *,
    positions: bool = False,
) -> recording.ExperimentRecord:
    """Rows from the first to the one before the last, as a recording of their own.

    Only signals that settings ask for are read, None for all that are processed; or only positions.
    """
    if isinstance(record, recording.StoredRecording) and positions:
        return record.part(first, last, ())
    if isinstance(record, recording.StoredRecording):
        source = "effort" if "effort" in record.quantities else "current"
        measured = settings is None or settings.velocity == "measured"
        return record.part(first, last, (source, "qd") if measured else (source,))
    rows = slice(first, last)
    return recording.ExperimentRecord(
        t=record.t[rows],
        signals={name: values[rows] for name, values in record.signals.items()},
        metadata=replace(record.metadata, input_hash=""),
    )


def process(
    record: recording.RecordLike, robot: RobotLike, settings: ProcessingSettings | None = None
) -> Samples:
    """Resample, align, filter the motion, differentiate, trim.

    Torques are not low-passed on their own: a smoothed Coulomb step would no longer match its
    column. Where data are thinned, torques and columns pass the same filter, a block mean.

    Args:
        record: The recording or its file.
        robot: The robot, or its name or file.
        settings: How to process it; None for the defaults.

    Raises:
        InputError: See `uniform_signals`; or too few samples remain.
    """
    settings, robot = settings or ProcessingSettings(), load_robot(robot, collision=False)
    signals = uniform_signals(recording.open_record(record, robot), robot, settings)
    return samples_from(signals, settings)


def samples_from(
    signals: resample.UniformSignals, settings: ProcessingSettings, *, trim: bool = True
) -> Samples:
    """Samples from signals on a uniform grid; see `process`.

    Trimming leaves out ends where the filter has not settled; a prediction is judged there too.
    """
    rate = signals.rate_hz
    cutoff = settings.cutoff_hz or filters.default_cutoff(signals.q, rate)
    cutoff = min(cutoff, filters.NYQUIST_SHARE * rate / 2)
    folded = settings.period_s is not None
    if settings.period_s is not None:
        signals = resample.fold_periods(signals, settings.period_s)
        # Exact derivatives of one averaged period: a circle has no ends.
        q, dq = filters.fourier_derivative(signals.q, rate, cutoff)
        ddq = filters.fourier_derivative(dq, rate, cutoff)[1]
    else:
        q, dq, ddq = filtered_motion(signals, settings, cutoff)
    noise = filters.encoder_noise(signals.q, q)
    unfiltered_q = filters.without_noise(signals.q, noise)
    torque = delayed(signals.torque, rate, settings.delays_s, circular=folded)
    keep = _kept(signals, settings, cutoff, circular=folded, trim=trim)
    return Samples(
        t=signals.t[keep] - signals.t[0],
        q=q[keep],
        dq=dq[keep],
        ddq=ddq[keep],
        tau=torque[keep],
        block=block_length(rate) if settings.decimate else 1,
        rate_hz=rate,
        cutoff_hz=cutoff,
        noise=signals.noise,
        changed=signals.changed,
        periods=signals.periods,
        unfiltered_q=unfiltered_q[keep],
        encoder_noise=noise,
        torque_filter=settings.torque_filter,
    )


def delayed(
    torque: Array, rate_hz: float, delays_s: tuple[float, ...] | None, circular: bool = False
) -> Array:
    """Torques (N, n) moved earlier by each joint's delay (n) [s], straight lines between samples.

    None for no delays; circular where the samples span whole periods.

    Raises:
        InputError: Not one delay a joint.
    """
    if delays_s is None or not any(delays_s):
        return torque
    if len(delays_s) != torque.shape[1]:
        raise InputError("one delay a joint", value=len(delays_s), limit=torque.shape[1])
    index = np.arange(len(torque), dtype=np.float64)
    period = len(torque) if circular else None
    moved = np.empty_like(torque)
    for j, delay in enumerate(delays_s):
        moved[:, j] = np.interp(index + delay * rate_hz, index, torque[:, j], period=period)
    return moved


def filtered_motion(
    signals: resample.UniformSignals, settings: ProcessingSettings, cutoff_hz: float
) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations (N, n) below a cut-off [Hz].

    Raises:
        InputError: Measured velocities are asked for, and there are none.
    """
    qd = signals.qd if settings.velocity == "measured" else None
    if settings.velocity == "measured" and qd is None:
        raise InputError("the recording has no velocities qd", value="velocity=measured")
    # Each stretch alone: what bridges a gap is no motion, and would be smeared into what is.
    valid = signals.valid > 0.5
    runs = np.split(np.arange(len(valid)), np.flatnonzero(np.diff(valid)) + 1)
    out = signals.q.copy(), np.zeros_like(signals.q), np.zeros_like(signals.q)
    for run in runs:
        # Of shorter ones nothing is kept.
        if valid[run[0]] and len(run) > LEAST_STRETCH:
            part = slice(run[0], run[-1] + 1)
            measured = None if qd is None else qd[part]
            found = _filtered(signals.q[part], measured, signals.rate_hz, settings, cutoff_hz)
            for whole, values in zip(out, found, strict=True):
                whole[part] = values
    return out


def _filtered(
    q: Array, qd: Array | None, rate: float, settings: ProcessingSettings, cutoff_hz: float
) -> tuple[Array, Array, Array]:
    q = filters.low_pass(q, rate, cutoff_hz)
    if qd is None:
        dq = filters.derivative(q, rate, settings.derivative, cutoff_hz)
    else:
        dq = filters.low_pass(qd, rate, cutoff_hz)
    return q, dq, filters.derivative(dq, rate, settings.derivative, cutoff_hz)


def unsettled(rate_hz: float, settings: ProcessingSettings, cutoff_hz: float) -> int:
    """Samples beside an end or a gap that filter and delay carry it to."""
    edge = int(np.ceil(TIME_CONSTANTS / (2 * np.pi * cutoff_hz) * rate_hz))
    longest = max((abs(d) for d in settings.delays_s or ()), default=0.0)
    return edge + int(np.ceil(longest * rate_hz - 1e-6))


def _kept(
    signals: resample.UniformSignals,
    settings: ProcessingSettings,
    cutoff: float,
    *,
    circular: bool,
    trim: bool,
) -> Indices:
    """The samples that no gap and, where trimmed, no end reaches through filter and delay."""
    edge = min(unsettled(signals.rate_hz, settings, cutoff), len(signals.t) // 4)
    gap = signals.valid < 0.5
    lost = np.pad(gap, edge, mode="wrap") if circular else np.pad(gap, edge, constant_values=trim)
    before = np.concatenate([[0], np.cumsum(lost)])
    keep = np.flatnonzero(before[2 * edge + 1 :] == before[: -2 * edge - 1])
    require_samples(len(keep))
    return keep


def require_samples(count: int) -> None:
    """Refuse fewer than `MIN_SAMPLES`."""
    if count < MIN_SAMPLES:
        raise InputError(
            "too few samples remain after filtering",
            value=count,
            limit=f"at least {MIN_SAMPLES}",
            next_step="Use a longer window or a higher --cutoff.",
        )


def block_length(rate: float) -> int:
    """Samples that are averaged where data are thinned."""
    # Stamps give rates like 499.9999999.
    return max(1, int(rate / BLOCK_RATE_HZ + 1e-6))
