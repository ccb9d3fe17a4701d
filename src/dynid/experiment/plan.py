"""What is to be done with a design: passes, periods, limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.drivers.driver import Execution
from dynid.drivers.watchdog import WatchLimits
from dynid.experiment.slow import check_share, slowed, whole_cycles_share
from dynid.robot.model import RobotModel
from dynid.trajectory.trajectory import Trajectory

DEVIATION = 0.1
"""Largest distance between target and measured position before a stop [rad or m]."""
_SPEED_ROOM = 1.1
_PLACE_ROOM = 0.02
_REST = {"dq": 1e-3, "ddq": 1e-2}
_CLOSED = 1e-6
_WHOLE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Payload:
    """What the robot carries, as its controller should be told."""

    mass: float = 0.0
    """[kg]"""
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of mass in the flange's frame [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pass:
    """One execution of the plan."""

    name: str
    """`slow`, `warm-up` or `run`."""
    execution: Execution
    """What to execute."""
    recorded: bool
    """Whether its samples are the recording."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentPlan:
    """A design made ready for a robot.

    Raises:
        InputError: A motion that is not at rest at its ends or does not close, a period that is
            no whole number of control cycles, joints that the robot has not, or settings out of
            range.
    """

    robot: RobotModel
    """The robot as it is mounted."""
    trajectory: Trajectory
    """One period of the motion."""
    periods: int = 3
    """Periods to record."""
    settle: bool = False
    """Move one period before them that is not recorded."""
    slow: float | None = None
    """Speed of a first pass that is not recorded, as a share; None for no such pass."""
    warm_up_s: float = 0.0
    """Time to repeat the motion before the recording [s]."""
    rate_hz: float = 125.0
    """Control cycles a second."""
    payload: Payload = field(default_factory=Payload)
    """What the robot carries."""
    via: tuple[Array, ...] = ()
    """Way points, each (n), on the way to the start of the first pass [rad or m]."""

    def __post_init__(self) -> None:
        if self.slow is not None:
            check_share(self.slow)
        if not (math.isfinite(self.warm_up_s) and self.warm_up_s >= 0):
            raise InputError("the time to warm up", value=self.warm_up_s, limit="0 s or more")
        cycles = self.trajectory.duration * self.rate_hz
        if abs(cycles - round(cycles)) > _WHOLE * max(cycles, 1.0):
            raise InputError(
                "the period is no whole number of control cycles",
                value=f"{self.trajectory.duration} s at {self.rate_hz} Hz",
                next_step=f"Design with a period of {round(cycles) / self.rate_hz:g} s.",
            )
        self._check_ends()

    def _check_ends(self) -> None:
        ends = self.trajectory.evaluate([0.0, self.trajectory.duration])
        if ends.q.shape[1] != self.robot.joints:
            raise InputError(
                f"the motion has {ends.q.shape[1]} joints but {self.robot.name} has "
                f"{self.robot.joints}"
            )
        for name, limit in _REST.items():
            values = np.abs(getattr(ends, name)).max(axis=0)
            if (values > limit).any():
                joint = int(np.argmax(values))
                word = "velocity" if name == "dq" else "acceleration"
                raise InputError(
                    f"joint {joint + 1}: the motion does not start and end at rest ({word})",
                    value=float(values[joint]),
                    limit=limit,
                )
        gap = np.abs(ends.q[1] - ends.q[0])
        if self.repeats and (gap > _CLOSED).any():
            joint = int(np.argmax(gap))
            raise InputError(
                f"joint {joint + 1}: the motion does not end where it starts, so it cannot repeat",
                value=float(gap[joint]),
                limit=_CLOSED,
                next_step="Run it with --repeat 1.",
            )

    @property
    def repeats(self) -> bool:
        """Whether the motion is executed more than once."""
        return self.periods > 1 or self.settle or self.slow is not None or self.warm_up_s > 0

    @property
    def start(self) -> Array:
        """(n) the pose from which the motion starts [rad or m]."""
        return self.trajectory.evaluate([0.0]).q[0]

    def passes(self) -> tuple[Pass, ...]:
        """The executions in their order; the last one is the recording."""
        found: list[Pass] = []
        if self.slow is not None:
            share = whole_cycles_share(self.trajectory.duration, self.slow, self.rate_hz)
            slow = slowed(self.trajectory, share)
            found.append(Pass(name="slow", execution=self._execution(slow, 1), recorded=False))
        if self.warm_up_s > 0:
            periods = math.ceil(self.warm_up_s / self.trajectory.duration)
            warm = self._execution(self.trajectory, periods)
            found.append(Pass(name="warm-up", execution=warm, recorded=False))
        run = self._execution(self.trajectory, self.periods, settle=int(self.settle))
        first, *others = (*found, Pass(name="run", execution=run, recorded=True))
        # Each pass ends where the next one starts: only the first one has a way to go.
        return (replace(first, execution=replace(first.execution, via=self.via)), *others)

    def _execution(self, trajectory: Trajectory, periods: int, settle: int = 0) -> Execution:
        return Execution(
            trajectory=trajectory,
            periods=periods,
            settle=settle,
            rate_hz=self.rate_hz,
            limits=watch_limits(self.robot),
        )


def watch_limits(robot: RobotModel, deviation: float = DEVIATION) -> WatchLimits:
    """Where the watchdog stops a robot: just beyond its own limits.

    Args:
        robot: The robot.
        deviation: Largest distance between target and measured position [rad or m].
    """
    limits = robot.limits
    return WatchLimits(
        lower=limits.lower - _PLACE_ROOM,
        upper=limits.upper + _PLACE_ROOM,
        velocity=_SPEED_ROOM * limits.velocity,
        deviation=np.full(robot.joints, deviation),
    )
