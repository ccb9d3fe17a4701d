"""What every driver can do, and the watchdog that stops it."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from threading import Event
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from dynid import trajectory
from dynid.core import Array, Finding, InputError, Progress, freeze
from dynid.protocol import RobotMode, RuntimeState, SafetyMode
from dynid.trajectory import Trajectory

WATCHDOG_HZ = 10.0
"""How often a program on a controller must be fed; without it that stops it after 0.1 s."""
_SCALING = 1e-3
"""By how much a speed may be off its full value, as a share."""
_CLOCK = 0.25
"""By how much a timestamp may be off, in control cycles."""


@dataclass(frozen=True, slots=True)
class Abort:
    """Why a motion was ended early."""

    code: str
    """One word for programs: `gap`, `index`, `mode`, `safety`, `program`, `speed`, `limit`,
    `deviation`, `connection`, `recording`, `interrupted`, `start`."""
    message: str
    """What happened, in words, with its numbers."""
    next_step: str | None = None
    """What to do where no recording is kept."""


INTERRUPTED = Abort("interrupted", "it was interrupted")
"""Somebody wished it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchLimits:
    """Where the joints may be during a motion; all arrays (n).

    Raises:
        InputError: Shapes that disagree.
    """

    lower: Array
    """Smallest positions [rad or m]; NaN where unknown."""
    upper: Array
    """Largest positions [rad or m]; NaN where unknown."""
    velocity: Array
    """Largest speeds [rad/s or m/s]; NaN where unknown."""
    deviation: Array
    """Largest distances between target and measured positions [rad or m]."""
    prismatic: tuple[bool, ...] = ()
    """(n) joints that slide; empty where none does."""

    def __post_init__(self) -> None:
        n = np.size(self.lower)
        freeze(self, "watch", finite=False, lower=(n,), upper=(n,), velocity=(n,), deviation=(n,))
        if not (self.deviation > 0).all():
            raise InputError("the allowed deviation must be positive", value=self.deviation)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycle:
    """What a control cycle reported, as far as safety needs it."""

    timestamp: float
    """Controller time [s]."""
    index: int
    """Number of the set point that was commanded; negative before the first."""
    q: Array
    """(n) measured positions [rad or m]."""
    qd: Array
    """(n) measured velocities [rad/s or m/s]."""
    target_q: Array
    """(n) positions that the servo aims at [rad or m]."""
    robot_mode: int = RobotMode.RUNNING
    safety_mode: int = SafetyMode.NORMAL
    runtime_state: int = RuntimeState.PLAYING
    speed_scaling: float = 1.0
    """Share of the speed that the controller allows now."""
    speed_fraction: float = 1.0
    """The speed slider."""
    freedrive: bool = False
    """Whether somebody presses the teach button, to move the arm by hand."""


_OFF_WAY = 0.02
"""Distance of the target from the straight ways to the start [rad]."""
_WAIT_S, _SLOWNESS = 20.0, 4.0
"""Time for the way [s], and what is added for its length [s/rad]: twice what `movej` takes."""


class Watchdog:
    """Watches one execution, from the way to its first set point to its last one.

    Args:
        limits: Where the joints may be.
        rate_hz: Control cycles a second.
        total: Number of set points; indices run from 0 to one less.
        slack: By how much an index may be off the one that is due, one a cycle from the first on:
            nought where the controller counts, more where set points are streamed to it.
        way: (k, n) poses on the way to the first set point, that itself the last, straight ways
            between them; of one alone, from where the arm stands. None where nobody moves it there.
    """

    def __init__(
        self,
        limits: WatchLimits,
        rate_hz: float,
        total: int,
        *,
        slack: int = 0,
        way: Array | None = None,
    ) -> None:
        self._limits = limits
        self._rate = rate_hz
        self._last = total - 1
        self._slack = slack
        self._before: Cycle | None = None
        self._due = -1
        self._way, self._patience = way, np.inf
        self._fastest = np.where(np.isnan(limits.velocity), np.inf, limits.velocity)
        self.gaps = 0
        """Control cycles that never arrived."""

    @property
    def finished(self) -> bool:
        """Whether the last set point was seen."""
        return self._before is not None and self._before.index >= self._last

    def see(self, cycle: Cycle, *, begun: bool = True) -> Abort | None:
        """Take the next control cycle.

        Args:
            cycle: What it reported.
            begun: Whether our motion runs already; the robot may not start it in every state.

        Returns:
            Why the robot must stop now; None if all is well.
        """
        before = self._before
        if self.finished or not begun:
            return _state(cycle, playing=False)
        # What the controller says of itself explains what follows from it: it comes first.
        abort = _state(cycle, playing=True) or _speed(cycle)
        if before is None and cycle.index < 0:
            return abort or self._place(cycle) or self._approach(cycle)
        self._before = cycle
        return abort or self._clock(cycle, before) or self._order(cycle) or self._place(cycle)

    def _approach(self, cycle: Cycle) -> Abort | None:
        """Another program that takes the robot over moves it elsewhere, or nowhere."""
        if self._way is None:
            return None
        target = cycle.target_q
        if np.isinf(self._patience):
            if len(self._way) == 1:
                self._way = np.vstack([target, self._way])
            length = float(np.abs(np.diff(self._way, axis=0)).max(axis=1).sum())
            self._patience = self._rate * (_WAIT_S + _SLOWNESS * length)
        self._patience -= 1
        steps = np.diff(self._way, axis=0)
        square = np.maximum(np.square(steps).sum(axis=1), 1e-300)
        along = np.clip(((target - self._way[:-1]) * steps).sum(axis=1) / square, 0.0, 1.0)
        away = np.abs(self._way[:-1] + along[:, None] * steps - target).max(axis=1).min()
        if away <= _OFF_WAY and self._patience > 0:
            return None
        what = f"{away:.3g} rad off its way to the start" if self._patience > 0 else "not arriving"
        why = "it was moved, or another program has taken the robot over"
        return Abort("program", f"the arm is {what}: {why}")

    def _clock(self, cycle: Cycle, before: Cycle | None) -> Abort | None:
        if before is None:
            return None
        steps = (cycle.timestamp - before.timestamp) * self._rate
        if abs(steps - 1.0) <= _CLOCK:
            return None
        if np.isfinite(steps):
            self.gaps += max(round(steps) - 1, 0)
        return Abort(
            "gap",
            f"a gap in the timestamps: {1e3 * steps / self._rate:.1f} ms after sample "
            f"{before.index}, where {1e3 / self._rate:.1f} ms were due",
        )

    def _order(self, cycle: Cycle) -> Abort | None:
        self._due += 1
        if abs(cycle.index - self._due) <= self._slack:
            return None
        why = "another program has taken the robot over, or the controller was late"
        if self._slack:
            why = "set points came late: the network is slow, or this computer is busy"
        what = f"the sample index is {cycle.index}, where {self._due} was due"
        return Abort("index", f"{what}; {why}")

    def _place(self, cycle: Cycle) -> Abort | None:
        q, limits = cycle.q, self._limits
        units = ["m" if slides else "rad" for slides in limits.prismatic] or ["rad"] * len(q)
        # Where a limit is unknown (NaN), no comparison holds.
        outside = (q < limits.lower) | (q > limits.upper)
        if outside.any():
            j = int(np.argmax(outside))
            where = f"joint {j + 1} is at {q[j]:.4g} {units[j]}"
            bounds = f"{limits.lower[j]:.4g} to {limits.upper[j]:.4g}"
            return Abort("limit", f"{where}, outside {bounds}")
        # Asked this way round a velocity that is no number stops the robot too.
        fast = ~(np.abs(cycle.qd) <= self._fastest)
        if fast.any():
            j = int(np.argmax(fast))
            speed = f"joint {j + 1} moves at {cycle.qd[j]:.4g} {units[j]}/s"
            return Abort("limit", f"{speed}, above {limits.velocity[j]:.4g}")
        away = np.abs(q - cycle.target_q)
        if not (away <= limits.deviation).all():
            j = int(np.argmax(away / limits.deviation))
            where = f"joint {j + 1} is {away[j]:.4g} {units[j]} away from its target"
            return Abort("deviation", f"{where}, more than {limits.deviation[j]:.4g}")
        return None


def mode_name(modes: type[IntEnum], value: int) -> str:
    """A mode in words, with its number."""
    known = value in {int(mode) for mode in modes}
    words = modes(value).name.lower().replace("_", " ") if known else "unknown"
    return f"{words} ({value})"


def _state(cycle: Cycle, *, playing: bool) -> Abort | None:
    # Reduced limits are no place to identify in: normal is the one mode that passes.
    if cycle.safety_mode != SafetyMode.NORMAL:
        return Abort("safety", f"safety mode became {mode_name(SafetyMode, cycle.safety_mode)}")
    if cycle.robot_mode != RobotMode.RUNNING:
        return Abort("mode", f"robot mode became {mode_name(RobotMode, cycle.robot_mode)}")
    if cycle.freedrive:
        return Abort("mode", "somebody presses the teach button (freedrive)")
    if playing and cycle.runtime_state != RuntimeState.PLAYING:
        paused = cycle.runtime_state in (RuntimeState.PAUSING, RuntimeState.PAUSED)
        unfed = (
            f"its watchdog was not fed in time ({1 / WATCHDOG_HZ:g} s): the network is slow or "
            "loses packets, or this computer is busy; or someone stopped it"
        )
        why = "someone paused it" if paused else unfed
        state = mode_name(RuntimeState, cycle.runtime_state)
        return Abort("program", f"the program on the controller is {state}: {why}")
    return None


def _speed(cycle: Cycle) -> Abort | None:
    for value, what in (
        (cycle.speed_fraction, "the speed slider was moved to"),
        (cycle.speed_scaling, "the controller slows the motion down to"),
    ):
        if not abs(value - 1.0) <= _SCALING:
            return Abort("speed", f"{what} {100 * value:.4g} %")
    return None


class Recorder(Protocol):
    """Where samples go; `RecordWriter` is one."""

    def append(
        self,
        t: float,
        signals: Mapping[str, ArrayLike],
        channels: Mapping[str, float] | None = None,
    ) -> None:
        """Append one sample."""

    def report(self, problem: Finding) -> None:
        """Add to the recording's problems."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Execution:
    """A motion to execute: whole periods, one after the other, from rest.

    Raises:
        InputError: No period or part of one, a rate that is not positive, a period that is no
            whole number of cycles or shorter than two, or a motion that does not start and end at
            rest or, to be repeated, where it starts.
    """

    trajectory: Trajectory
    """One period."""
    periods: int = 3
    """Periods to record."""
    settle: int = 0
    """Periods before these that are moved and not recorded."""
    rate_hz: float = 125.0
    """Control cycles a second."""
    limits: WatchLimits
    """Beyond which the robot is stopped."""
    via: tuple[Array, ...] = ()
    """Where a real robot stands, and way points at which it rests on its way to the start, each (n)
    [rad or m]. Empty: it comes straight, from wherever it stands."""

    def __post_init__(self) -> None:
        trajectory.require_whole("periods", self.periods, 1)
        trajectory.require_whole("settling periods", self.settle, 0)
        trajectory.require_positive("the control rate", self.rate_hz)
        trajectory.whole_cycles(self.trajectory.duration, self.rate_hz)
        trajectory.require_rest(self.trajectory)
        if self.settle + self.periods > 1:
            # Refuses a motion that does not end as it starts.
            trajectory.Repetition(part=self.trajectory, times=2)

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


QUANTITIES = (
    *("q", "qd", "current", "target_q", "target_qd", "target_qdd", "target_current"),
    *("target_moment", "temperature"),
)
"""The signals that drivers record."""


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
    drive_gains: tuple[float, ...] | None = None
    """(n) [N.m/A], where others than the robot's."""
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
