"""What was measured, as a value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from dynid.core import Array, Finding, RecordError, frozen

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
