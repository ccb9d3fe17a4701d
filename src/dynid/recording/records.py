"""What was measured, as a value, and the description that travels with it."""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from dynid import core
from dynid.recording.names import places_of, said_of_others
from dynid.robot import RobotModel

UNITS: dict[str, str] = {
    "t": "s",
    "q": "rad",
    "qd": "rad/s",
    "qdd": "rad/s^2",
    "current": "A",
    "effort": "N.m",
    "target_q": "rad",
    "target_qd": "rad/s",
    "target_qdd": "rad/s^2",
    "target_current": "A",
    "target_moment": "N.m",
    "temperature": "degC",
}
"""Unit of each column; m and N instead of rad and N.m on prismatic joints."""
JOINT_QUANTITIES = tuple(name for name in UNITS if name != "t")
"""Signals with one column a joint."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordMetadata:
    """Where a recording comes from and how to read it."""

    robot: str | None = None
    """Built-in name or path of the robot, if known."""
    joint_names: tuple[str, ...] = ()
    """Joint names in column order; empty if the file did not say."""
    origin: str = ""
    """The file or program that the recording was read from."""
    format: str = ""
    """The format it was read as."""
    clock: str = "recorded"
    """`recorded` (stamps of the file), `header` (ROS stamps), `receive` (ROS receive times,
    where the headers are empty), or `rate` (made from --rate)."""
    drive_gains: tuple[float, ...] | None = None
    """Drive gains given with the recording [N.m/A]; they override the robot's."""
    dropped_rows: int = 0
    """Rows that were thrown away in reading."""
    input_hash: str = ""
    """SHA-256 of the origin."""
    extra: Mapping[str, str] = field(default_factory=dict[str, str])
    """Anything else worth keeping (thermal state, run settings); an import puts the first stamp
    in `t0` [s], its choices in `notes`, and a bag's topic in `topic`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentRecord(core.Value):
    """A recording: time stamps and signals, strictly increasing and finite.

    Raises:
        RecordError: Fewer than two samples, time that does not increase, no positions,
            an unknown signal, or signals, channels or metadata of another type.
        InputError: Shapes that disagree, or what is no finite number.
    """

    t: core.Array
    """(N) time [s], strictly increasing."""
    signals: Mapping[str, core.Array]
    """Quantity (one of `JOINT_QUANTITIES`) to (N, n) samples, SI units."""
    metadata: RecordMetadata = field(default_factory=RecordMetadata)
    """Robot, origin, format and units."""
    problems: tuple[core.Finding, ...] = ()
    """What was found and repaired in reading."""
    channels: Mapping[str, core.Array] = field(default_factory=dict[str, core.Array])
    """Other columns kept as they came, name to (N)."""

    def __post_init__(self) -> None:
        t = core.frozen(self.t, shape=(None,), name="t")
        object.__setattr__(self, "t", t)
        if len(t) < 2:
            raise core.RecordError("a recording needs at least two samples", value=len(t))
        if not (np.diff(t) > 0).all():
            row = int(np.argmax(np.diff(t) <= 0)) + 1
            raise core.RecordError(f"time does not increase at sample {row}", value=float(t[row]))
        kinds = {"signals": Mapping, "channels": Mapping, "metadata": RecordMetadata}
        for name, kind in kinds.items():
            if not isinstance(value := getattr(self, name), kind):
                what, got = f"{name} of a recording", type(value).__name__
                raise core.RecordError(what, value=got, limit=f"a {kind.__name__}")
        check_quantities(self.signals)
        q = core.frozen(self.signals["q"], shape=(len(t), None), name="q")
        shape = q.shape
        signals = {name: core.frozen(x, shape=shape, name=name) for name, x in self.signals.items()}
        channels = {
            name: core.frozen(value, shape=(len(t),), name=name, finite=False)
            for name, value in self.channels.items()
        }
        object.__setattr__(self, "signals", MappingProxyType(signals))
        object.__setattr__(self, "channels", MappingProxyType(channels))
        names = self.metadata.joint_names
        if names and len(names) != shape[1]:
            raise core.RecordError(
                "joint names do not match the columns", value=names, limit=shape[1]
            )

    @property
    def samples(self) -> int:
        """Number of samples N."""
        return len(self.t)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.signals["q"].shape[1]

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.t[-1] - self.t[0])

    @property
    def rate_hz(self) -> float:
        """Samples a second, from the median step."""
        return float(1.0 / np.median(np.diff(self.t)))


VERSION = 1


def metadata_to_json(metadata: RecordMetadata) -> dict[str, Any]:
    """Metadata as a JSON object."""
    texts = {str(name): str(value) for name, value in metadata.extra.items()}
    gains = metadata.drive_gains
    return {
        **asdict(replace(metadata, extra=texts)),
        "joint_names": list(metadata.joint_names),
        "drive_gains": None if gains is None else [float(gain) for gain in gains],
        "dropped_rows": int(metadata.dropped_rows),
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class Description:
    """What a file says of the recording in it."""

    quantities: tuple[str, ...]
    joints: int
    channels: tuple[str, ...]
    metadata: RecordMetadata
    problems: tuple[core.Finding, ...]

    @classmethod
    def of(cls, data: Any, problems: Iterable[Any]) -> "Description":
        """The description in a JSON object, and the problems beside it.

        Raises:
            RecordError: A field that is missing or of the wrong type.
        """
        try:
            found = tuple(map(core.finding_from_json, problems))
            made = core.JsonFields(data).made(cls, problems=found)
        except (core.InputError, AttributeError, KeyError, TypeError, ValueError) as error:
            what = "the recording's description is damaged"
            raise core.RecordError(what, value=str(error)) from error
        check_quantities(made.quantities)
        return made

    @property
    def names(self) -> list[str]:
        """The names of time, signals and channels, in the order of the columns."""
        return ["t", *column_names(self.quantities, self.joints), *self.channels]

    def record(self, columns: Sequence[core.Array]) -> ExperimentRecord:
        """The recording of these columns, each (N)."""
        n, start = self.joints, 1 + self.joints * len(self.quantities)
        return ExperimentRecord(
            t=columns[0],
            signals={
                name: np.column_stack(columns[1 + k * n : 1 + (k + 1) * n])
                for k, name in enumerate(self.quantities)
            },
            metadata=self.metadata,
            problems=self.problems,
            channels=dict(zip(self.channels, columns[start:], strict=True)),
        )


def with_gains(found: RecordMetadata, joints: int, gains: Sequence[float] | None) -> RecordMetadata:
    """Metadata with drive gains (n) [N.m/A] in place of its own; None keeps those.

    Raises:
        RecordError: Not one finite gain a joint, other than zero.
    """
    if gains is None:
        return found
    try:
        values = tuple(map(float, gains))
    except (TypeError, ValueError):
        values = ()
    if len(values) != joints or not (np.isfinite(values).all() and all(values)):
        raise core.RecordError(
            "one drive gain a joint is needed, finite and not zero [N.m/A]",
            where="--gains",
            value=",".join(map(str, gains)),
            limit=f"{joints} joints",
        )
    return replace(found, drive_gains=values)


def of_robot(
    found: RecordMetadata, joints: int, robot: RobotModel | None
) -> tuple[RecordMetadata, tuple[int, ...], tuple[core.Finding, ...]]:
    """Metadata fitted to a robot, the columns in the order of its joints, and what to tell.

    Raises:
        RecordError: Another number of joints.
    """
    order, told = tuple(range(joints)), ""
    if robot is not None:
        if joints != robot.joints:
            raise core.RecordError(
                f"the recording has {joints} joints but {robot.name} has {robot.joints}"
            )
        names, own = found.joint_names, found.drive_gains
        if names and names != robot.joint_names:
            place = places_of(robot.joint_names, names)
            order = tuple(place) or order
            told = "" if place else said_of_others(names, robot.joint_names, "in this order")
            own = None if own is None else tuple(own[k] for k in order)
            found = replace(found, joint_names=robot.joint_names, drive_gains=own)
        # A recording that says of which robot it is can be given to another one by mistake.
        found = replace(found, robot=found.robot or robot.name)
    return found, order, (core.Finding("unit_suspect", told),) if told else ()


def column_names(quantities: Iterable[str], joints: int) -> list[str]:
    """`q_0`, `q_1`, ..., in the order of the given quantities."""
    return [f"{quantity}_{k}" for quantity in quantities for k in range(joints)]


def check_quantities(quantities: Iterable[str]) -> tuple[str, ...]:
    """The quantities, if a recording can hold them.

    Raises:
        RecordError: An unknown one, one named twice, or no positions.
    """
    names = tuple(quantities)
    if len(set(names)) != len(names) or not set(names) <= set(JOINT_QUANTITIES):
        raise core.RecordError(
            "unknown or repeated quantities", value=names, limit=JOINT_QUANTITIES
        )
    if "q" not in names:
        raise core.RecordError("a recording needs positions q", value=names)
    return names


def digest(description: Mapping[str, Any], columns: Iterable[core.Array]) -> str:
    """A fingerprint of a description, without its own digest, and of all columns."""
    hasher = hashlib.blake2b(json.dumps(description, sort_keys=True).encode(), digest_size=16)
    for column in columns:
        hasher.update(column.astype("<f8").tobytes())
    return hasher.hexdigest()


def identity(record: ExperimentRecord) -> str:
    """The hash of the file a record was read from, or of its times, positions and torques."""
    return record.metadata.input_hash or signals_hash(record, record.t)


def signals_hash(record: ExperimentRecord, t: core.Array | None = None) -> str:
    """The hash of a record's positions and torques, whatever file and stamps they came from.

    With times (N) these count too.
    """
    digest = hashlib.sha256(b"" if t is None else t.tobytes())
    # Simulated arms repeat a motion to the last bit; what they carry shows in the torques.
    for name in ("q", "effort", "current"):
        if name in record.signals:
            digest.update(record.signals[name].tobytes())
    return digest.hexdigest()


JUMPS, LARGEST = 1.0, 0.05
"""Mean squared second differences of positions over that of first ones: 3 of unrelated positions,
1 of a sine with six samples a period, less of any motion that can be differentiated; without the
largest differences, two and a share, which gaps may be."""
AWAY, LEAST_POSES = 0.05, 8
"""Range of a joint in which poses differ [rad or m], and the fewest poses that are told."""
APART = 0.02
"""... and by which share of it they do from one to the next: a slow motion that is written coarsely
changes by its last digit alone."""


def are_poses(q: core.Array) -> bool:
    """Whether rows (N, n) of positions are single poses, each unrelated to the one before."""
    ranges = np.ptp(q, axis=0)
    away = ranges > AWAY
    if len(q) < LEAST_POSES or not away.any():
        return False
    share = q[:, away] / ranges[away]
    squares = (np.square(np.diff(share, n=n, axis=0)).sum(axis=1) for n in (1, 2))
    first, second = (np.sort(s)[: int((1 - LARGEST) * len(s)) - 2].mean() for s in squares)
    return bool(first > APART**2 and second > JUMPS * first)
