"""What is to be done with a design: passes in their order, the last one recorded, and the run.

Ctrl-C while a robot moves is a wish to stop, not an exception at a random place.
"""

import math
import signal
import threading
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, is_dataclass, replace
from threading import Event
from types import FrameType

import numpy as np

from dynid import trajectory
from dynid.core import Array, DynidError, Finding, InputError, Progress
from dynid.drivers import Abort, Driver, Execution, Outcome, Recorder, WatchLimits
from dynid.robot import RobotModel
from dynid.trajectory import Trajectory

_CLOCKS = ("period", "travel_time")
_SPEED = "the share of the speed"


def slowed(motion: Trajectory, share: float) -> Trajectory:
    """The same path at a share of the speed, in (0, 1], as the same kind of motion.

    Speeds fall by the share, accelerations by its square.

    Raises:
        InputError: A share out of range, or a motion without a period or travel time.
    """
    trajectory.require_share(_SPEED, share)
    if share == 1.0:
        return motion
    if isinstance(motion, trajectory.MotionSequence):
        return replace(motion, parts=tuple(slowed(part, share) for part in motion.parts))
    if isinstance(motion, trajectory.Repetition):
        return replace(motion, part=slowed(motion.part, share))
    for clock in _CLOCKS:
        if is_dataclass(motion) and hasattr(motion, clock):
            return replace(motion, **{clock: getattr(motion, clock) / share})
    raise InputError("this kind of motion cannot be slowed down", value=type(motion).__name__)


def whole_cycles_share(duration: float, share: float, rate_hz: float) -> float:
    """The largest share not above the one asked for that gives whole control cycles.

    The duration is that at full speed [s].
    """
    trajectory.require_share(_SPEED, share)
    cycles = math.ceil(duration * rate_hz / share - 1e-6)
    return duration * rate_hz / cycles


DEVIATION = 0.1
"""Largest distance between target and measured position before a stop [rad or m]."""
_SPEED_ROOM = 1.1
_PLACE_ROOM = 0.02
_CLOSED = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Pass:
    """One execution of the plan."""

    name: str
    """`slow`, `warm-up` or `run`."""
    execution: Execution
    """What to execute."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentPlan:
    """A design made ready for a robot.

    Raises:
        InputError: A motion that is not at rest at its ends or does not close, a period that is
            no whole number of control cycles, joints that the robot has not, or settings out of
            range.
    """

    robot: RobotModel
    """The robot as it is mounted, with its tool."""
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
    via: tuple[Array, ...] = ()
    """Where it stands, and way points, each (n), to the start of the first pass [rad or m]."""

    def __post_init__(self) -> None:
        if self.slow is not None:
            trajectory.require_share(_SPEED, self.slow)
        if not (math.isfinite(self.warm_up_s) and self.warm_up_s >= 0):
            raise InputError("the time to warm up", value=self.warm_up_s, limit="0 s or more")
        trajectory.whole_cycles(self.trajectory.duration, self.rate_hz)
        if self.trajectory.joints != self.robot.joints:
            raise InputError(
                f"the motion has {self.trajectory.joints} joints but {self.robot.name} has "
                f"{self.robot.joints}"
            )
        ends = trajectory.require_rest(self.trajectory)
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
        run = Execution(
            trajectory=self.trajectory,
            periods=self.periods,
            settle=int(self.settle),
            rate_hz=self.rate_hz,
            limits=watch_limits(self.robot),
        )
        found: list[Pass] = []
        if self.slow is not None:
            share = whole_cycles_share(self.trajectory.duration, self.slow, self.rate_hz)
            slow = slowed(self.trajectory, share)
            once = replace(run, trajectory=slow, periods=1, settle=0)
            found.append(Pass(name="slow", execution=once))
        if self.warm_up_s > 0:
            periods = math.ceil(self.warm_up_s / self.trajectory.duration)
            warm = replace(run, periods=periods, settle=0)
            found.append(Pass(name="warm-up", execution=warm))
        first, *others = (*found, Pass(name="run", execution=run))
        # Each pass ends where the next one starts: only the first one has a way to go.
        there = [replace(x, execution=replace(x.execution, via=(self.start,))) for x in others]
        return (replace(first, execution=replace(first.execution, via=self.via)), *there)


def watch_limits(robot: RobotModel) -> WatchLimits:
    """Where the watchdog stops a robot: just beyond its own limits."""
    limits = robot.limits
    return WatchLimits(
        lower=limits.lower - _PLACE_ROOM,
        upper=limits.upper + _PLACE_ROOM,
        velocity=_SPEED_ROOM * limits.velocity,
        deviation=np.full(robot.joints, DEVIATION),
        prismatic=robot.prismatic,
    )


_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def _signals_to(handler: Callable[[int, FrameType | None], object]) -> Generator[None]:
    """SIGINT, SIGTERM and SIGHUP (a terminal that closes, without `nohup`) for a handler.

    Outside the main thread signals cannot be caught.
    """
    main = threading.current_thread() is threading.main_thread()
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    numbers = _SIGNALS[:2] if ignored else _SIGNALS
    before = {number: signal.signal(number, handler) for number in numbers if main}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


@contextmanager
def stop_on_signals() -> Generator[threading.Event]:
    """Turn SIGINT, SIGTERM and SIGHUP into an event for as long as the context lasts.

    The robot is then stopped and the recording closed in good order, wherever the program is.
    Outside the main thread the event is for the caller alone.

    Yields:
        The event that the signals set.
    """
    event = threading.Event()
    with _signals_to(lambda number, frame: event.set()):
        yield event


def interruptible() -> AbstractContextManager[None]:
    """Inside `stop_on_signals`: let signals raise again while no robot moves."""
    return _signals_to(signal.default_int_handler)


OpenRecorder = Callable[[], AbstractContextManager[Recorder]]
"""Starts the recording."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """How a plan ended."""

    outcome: Outcome
    """Of the recorded pass, or of the pass that was ended early."""
    stopped_in: str | None
    """The pass in which the robot was stopped; None if it was not, or had not moved."""


def run(
    plan: ExperimentPlan,
    driver: Driver,
    open_recorder: OpenRecorder,
    *,
    cancel: Event | None = None,
    progress: Progress | None = None,
) -> RunResult:
    """Execute a plan.

    Args:
        plan: What to do.
        driver: What moves the robot.
        open_recorder: Starts the recording; called once, before anything moves.
        cancel: Stops the robot when it is set.
        progress: Told what is being done and how far it is (0 to 1).

    Returns:
        How it ended; a stop is no exception.

    Raises:
        InputError: A motion that does not fit the robot.
        JobError: The robot cannot be reached, or the recording cannot be started.
    """
    *_, last = passes = plan.passes()
    step, outcome, over = last, Outcome(samples=0, periods=0, gaps=0), False
    try:
        # Before the arm warms up for half an hour: that the disk is full is known now.
        with open_recorder() as recorder:
            for step in passes:
                kept = recorder if step is last else None
                outcome = driver.execute(step.execution, kept, cancel=cancel, progress=progress)
                if outcome.abort is not None:
                    break
            over, abort = True, outcome.abort
            # What refuses the rows may refuse this too.
            if abort is not None and abort.code != "recording":
                text = f"aborted after {outcome.samples} samples: {abort.message}"
                recorder.report(Finding("aborted", text))
    except DynidError as error:
        # After the motion the end of the recording was refused.
        if not over:
            raise
        refused = Abort("recording", error.changed(next_step=None).line, error.next_step)
        outcome = replace(outcome, abort=outcome.abort or refused)
    if step is not last:
        # Nothing of it was to be recorded.
        outcome = replace(outcome, samples=0, periods=0)
    return RunResult(outcome=outcome, stopped_in=None if outcome.abort is None else step.name)
