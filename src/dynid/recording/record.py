"""What was measured, as a value, and the description that travels with it."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

import numpy as np

from dynid.core import Array, Finding, RecordError, finding_from_json, frozen

JOINT_QUANTITIES = (
    "q",
    "qd",
    "qdd",
    "current",
    "effort",
    "target_q",
    "target_qd",
    "target_qdd",
    "target_current",
    "target_moment",
    "temperature",
)
"""Signals with one column a joint, in SI units (A for currents, degC for temperature)."""


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
class ExperimentRecord:
    """A recording: time stamps and signals, strictly increasing and finite.

    Raises:
        RecordError: Fewer than two samples, time that does not increase, no positions,
            an unknown signal, or shapes that disagree.
    """

    t: Array
    """(N) time [s], strictly increasing."""
    signals: Mapping[str, Array]
    """Quantity (one of `JOINT_QUANTITIES`) to (N, n) samples, SI units."""
    metadata: RecordMetadata = field(default_factory=RecordMetadata)
    """Robot, origin, format and units."""
    problems: tuple[Finding, ...] = ()
    """What was found and repaired in reading."""
    channels: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """Other columns kept as they came, name to (N)."""

    def __post_init__(self) -> None:
        t = frozen(self.t, shape=(None,), name="t")
        object.__setattr__(self, "t", t)
        if len(t) < 2:
            raise RecordError("a recording needs at least two samples", value=len(t))
        if not (np.diff(t) > 0).all():
            row = int(np.argmax(np.diff(t) <= 0)) + 1
            raise RecordError(f"time does not increase at sample {row}", value=float(t[row]))
        if "q" not in self.signals:
            raise RecordError("a recording needs positions q", value=tuple(self.signals))
        unknown = set(self.signals) - set(JOINT_QUANTITIES)
        if unknown:
            raise RecordError("unknown signals", value=sorted(unknown), limit=JOINT_QUANTITIES)
        shape = (len(t), np.shape(self.signals["q"])[-1])
        signals = {
            name: frozen(value, shape=shape, name=name) for name, value in self.signals.items()
        }
        channels = {
            name: frozen(value, shape=(len(t),), name=name, finite=False)
            for name, value in self.channels.items()
        }
        object.__setattr__(self, "signals", MappingProxyType(signals))
        object.__setattr__(self, "channels", MappingProxyType(channels))
        names = self.metadata.joint_names
        if names and len(names) != shape[1]:
            raise RecordError("joint names do not match the columns", value=names, limit=shape[1])

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


def metadata_to_json(metadata: RecordMetadata) -> dict[str, Any]:
    """Metadata as a JSON object."""
    gains = metadata.drive_gains
    return {
        "robot": metadata.robot,
        "joint_names": list(metadata.joint_names),
        "origin": metadata.origin,
        "format": metadata.format,
        "clock": metadata.clock,
        "drive_gains": None if gains is None else [float(gain) for gain in gains],
        "dropped_rows": int(metadata.dropped_rows),
        "input_hash": metadata.input_hash,
        "extra": {str(name): str(value) for name, value in metadata.extra.items()},
    }


def metadata_from_json(data: Mapping[str, Any]) -> RecordMetadata:
    """Metadata from a JSON object.

    Raises:
        RecordError: A field of the wrong type.
    """
    known = {item.name for item in fields(RecordMetadata)}
    values = {name: value for name, value in data.items() if name in known}
    try:
        gains = values.get("drive_gains")
        return RecordMetadata(
            robot=None if values["robot"] is None else str(values["robot"]),
            joint_names=tuple(str(name) for name in values["joint_names"]),
            origin=str(values["origin"]),
            format=str(values["format"]),
            clock=str(values["clock"]),
            drive_gains=None if gains is None else tuple(float(gain) for gain in gains),
            dropped_rows=int(values["dropped_rows"]),
            input_hash=str(values["input_hash"]),
            extra={str(name): str(value) for name, value in dict(values["extra"]).items()},
        )
    except (KeyError, TypeError, ValueError) as error:
        raise RecordError("the recording's metadata is damaged", value=str(error)) from error


def notices_from_json(data: Iterable[Any]) -> tuple[Finding, ...]:
    """Notices from a list of JSON objects.

    Raises:
        RecordError: Something that is no notice.
    """
    notices: list[Finding] = []
    for item in data:
        try:
            notices.append(finding_from_json(item))
        except (KeyError, TypeError, ValueError) as error:
            raise RecordError(
                "the recording's list of problems is damaged", value=str(error)
            ) from error
    return tuple(notices)


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
        raise RecordError("unknown or repeated quantities", value=names, limit=JOINT_QUANTITIES)
    if "q" not in names:
        raise RecordError("a recording needs positions q", value=names)
    return names


def digest(description: Mapping[str, Any], columns: Iterable[Array]) -> str:
    """A fingerprint of the description and every number, to notice damage.

    Args:
        description: The JSON object without its own digest.
        columns: All columns in the order of the file.
    """
    hasher = hashlib.blake2b(json.dumps(description, sort_keys=True).encode(), digest_size=16)
    for column in columns:
        hasher.update(column.astype("<f8").tobytes())
    return hasher.hexdigest()


def identity(record: ExperimentRecord) -> str:
    """The hash of the file a record was read from, or of its times, positions and torques."""
    if record.metadata.input_hash:
        return record.metadata.input_hash
    digest = hashlib.sha256(record.t.tobytes())
    # Simulated arms repeat a motion to the last bit; what they carry shows in the torques.
    for name in ("q", "effort", "current"):
        if name in record.signals:
            digest.update(record.signals[name].tobytes())
    return digest.hexdigest()
