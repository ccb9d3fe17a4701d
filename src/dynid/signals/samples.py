"""Samples ready for identification or validation, their settings, and their torque."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from dynid.core import Array, InputError, freeze
from dynid.recording import ExperimentRecord
from dynid.robot import RobotModel
from dynid.signals.filters import METHODS, TorqueFilter

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
    """Average torques and columns over blocks as long as the cut-off allows."""
    period_s: float | None = None
    """Average over periods of this length [s]."""
    torque_filter: TorqueFilter | None = None
    """The low-pass that the torque had passed before it was written; the model passes it too."""

    def __post_init__(self) -> None:
        if self.cutoff_hz is not None and not 0 < self.cutoff_hz < 1e6:
            raise InputError("must be positive", where="--cutoff", value=self.cutoff_hz)
        if self.velocity not in VELOCITY_SOURCES:
            raise InputError("velocity source", value=self.velocity, limit=VELOCITY_SOURCES)
        if self.derivative not in METHODS:
            raise InputError("derivative", value=self.derivative, limit=METHODS)
        for name, value in (("--from", self.start_s), ("--to", self.stop_s)):
            if value is not None and not 0 <= value < 1e9:
                raise InputError(
                    "must be a time after the record's start",
                    where=name,
                    value=value,
                    limit="0 s or more, below 1e9 s",
                )
        if self.start_s is not None and self.stop_s is not None and self.stop_s <= self.start_s:
            raise InputError("--to must be later than --from", value=(self.start_s, self.stop_s))

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
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
    """(n) torque noise from the scatter between periods [N.m], if there were periods."""
    torque_filter: TorqueFilter | None = None
    """The low-pass that the recorded torque has passed."""

    def __post_init__(self) -> None:
        freeze(self, t=(None,), q=(len(self.t), None))
        freeze(self, dq=self.q.shape, ddq=self.q.shape, tau=self.q.shape)

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
    def rows(self) -> slice:
        """The samples whose torques are used: the torque filter has settled there."""
        return used_rows(self.count, self.torque_filter, self.rate_hz)

    @property
    def count(self) -> int:
        """Number of samples N."""
        return len(self.t)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.q.shape[1]


def joined(parts: Sequence[Samples]) -> Samples:
    """Samples of several records, one after the other, a second apart."""
    starts = np.cumsum([0.0, *(part.t[-1] + 1.0 for part in parts[:-1])])
    names = ("q", "dq", "ddq", "tau")
    return replace(
        parts[0],
        t=np.concatenate([part.t + s for part, s in zip(parts, starts, strict=True)]),
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names},
        block=max(part.block for part in parts),
        noise=None,
    )


def used_rows(count: int, torque_filter: TorqueFilter | None, rate_hz: float) -> slice:
    """Of some samples those whose torques are used: the torque filter has settled there."""
    edge = 0 if torque_filter is None else min(torque_filter.settled(rate_hz), count // 8)
    return slice(edge, count - edge)


def measured_torque(record: ExperimentRecord, robot: RobotModel) -> Array:
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
            next_step="Pass --gains g1,..,gn, or record effort.",
        )
    return record.signals["current"] * gains
