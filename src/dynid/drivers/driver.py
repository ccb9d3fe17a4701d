"""What every driver can do: move a robot along a motion, record it, and stop."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from threading import Event
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.core.notices import Notice
from dynid.core.progress import Progress
from dynid.drivers.watchdog import Abort, WatchLimits
from dynid.trajectory.trajectory import Trajectory


class Recorder(Protocol):
    """Where samples go; `RecordWriter` is one."""

    def append(
        self,
        t: float,
        signals: Mapping[str, ArrayLike],
        channels: Mapping[str, float] | None = None,
    ) -> None:
        """Append one sample."""

    def report(self, problem: Notice) -> None:
        """Add to the recording's problems."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Execution:
    """A motion to execute: whole periods, one after the other, from rest.

    Raises:
        InputError: No period, a rate that is not positive, or a motion shorter than two cycles.
    """

    trajectory: Trajectory
    """One period; it starts and ends at rest at the same pose."""
    periods: int = 3
    """Periods to record."""
    settle: int = 0
    """Periods before these that are moved and not recorded."""
    rate_hz: float = 125.0
    """Control cycles a second."""
    limits: WatchLimits
    """Beyond which the robot is stopped."""
    via: tuple[Array, ...] = ()
    """Way points, each (n), at which a real robot rests on its way to the start [rad or m]."""

    def __post_init__(self) -> None:
        if self.periods < 1 or self.settle < 0:
            raise InputError(
                "periods must be positive, settling periods not negative",
                value=(self.periods, self.settle),
            )
        if not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise InputError("the control rate must be positive", value=self.rate_hz)
        if self.cycles < 2:
            raise InputError("the motion is shorter than two control cycles", value=self.cycles)

    @property
    def cycles(self) -> int:
        """Control cycles of one period."""
        return round(self.trajectory.duration * self.rate_hz)

    @property
    def first_recorded(self) -> int:
        """Index of the first sample that is recorded."""
        return self.settle * self.cycles

    @property
    def total(self) -> int:
        """Control cycles of all periods; indices run from 0 to one less."""
        return (self.settle + self.periods) * self.cycles

    def setpoints(self) -> Array:
        """(cycles, n) positions of one period [rad or m]; every period repeats them exactly."""
        return self.trajectory.evaluate(np.arange(self.cycles) / self.rate_hz).q


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """What a driver's samples are made of."""

    quantities: tuple[str, ...]
    """The signals that every sample brings; `q` among them."""
    channels: tuple[str, ...] = ()
    """Names of its scalar columns."""
    format: str
    """What the recording calls its format."""
    origin: str
    """Where it comes from, in words."""
    extra: Mapping[str, str] = field(default_factory=dict[str, str])
    """Anything else worth keeping."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How an execution ended."""

    samples: int
    """Samples recorded."""
    periods: int
    """Whole periods recorded."""
    gaps: int
    """Control cycles that never arrived."""
    abort: Abort | None = None
    """Why it ended early; None if it did not."""


class Driver(ABC):
    """Moves a robot along a motion."""

    @property
    @abstractmethod
    def source(self) -> Source:
        """What the samples are made of."""

    @abstractmethod
    def execute(
        self,
        execution: Execution,
        recorder: Recorder | None,
        *,
        cancel: Event | None = None,
        progress: Progress | None = None,
    ) -> Outcome:
        """Go to the first pose, execute the motion, record it, come to rest.

        A stop is no exception: the outcome says why the motion ended early, and what was
        recorded until then stays with the recorder.

        Args:
            execution: What to execute.
            recorder: Where the samples go; None records nothing.
            cancel: Stops the robot when it is set.
            progress: Told how far the motion is.

        Raises:
            InputError: A motion that does not fit the robot.
            JobError: The robot cannot be reached or does not get ready; it has not moved.
            MissingExtraError: A package is missing.
        """
