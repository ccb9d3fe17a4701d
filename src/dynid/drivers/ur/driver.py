"""UR robots: the controller evaluates the motion, or follows streamed set points."""

import gc
from abc import abstractmethod
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from threading import Event, Thread
from typing import Any, ClassVar

import numpy as np

from dynid.core import Array, InputError, JobError, Progress, require
from dynid.drivers import driver
from dynid.drivers.ur import variables
from dynid.drivers.ur.control import UrRtde
from dynid.drivers.ur.link import STOP_PROGRAM, Dashboard, RtdeLink, ScriptPort
from dynid.drivers.ur.pump import Conversation, Intake, Pump, Refused
from dynid.protocol import Numbers, Recipe, RuntimeState
from dynid.trajectory import ur_program

_DRAIN_EVERY = 25
"""Cycles after which the states that the script port sends are thrown away."""


Converse = Callable[[variables.Layout, Recipe, ScriptPort], Conversation]
"""Begins the conversation that moves the robot; everything else is ready by then."""
Record = Callable[[Converse], driver.Outcome]


class RtdeDriver(driver.Driver):
    """Records and watches every cycle of a UR controller; what moves it is a driver's own."""

    index: ClassVar[str]
    """The variable with the number of the sample."""
    slack: ClassVar[int] = 0
    """Cycles by which the set points may be late before the robot is stopped."""

    def __init__(self, state: variables.ControllerState) -> None:
        self.state = state

    @property
    def source(self) -> driver.Source:
        """See `Driver.source`."""
        state, version = self.state, ".".join(map(str, self.state.version))
        layout = variables.recorded(state.version[:3], self.index)
        return driver.Source(
            quantities=tuple(variables.SIGNALS),
            channels=tuple(name for name, _ in layout.channels),
            format="rtde",
            origin=f"{state.model or 'UR'} at {state.host}, software {version}",
            extra={
                "controller": version,
                "model": state.model,
                "start_degC": str([round(float(value), 2) for value in state.temperature]),
            },
        )

    @abstractmethod
    def move(self, execution: driver.Execution, cancel: Event, record: Record) -> driver.Outcome:
        """Have the robot move beside a recording, which begins the conversation that moves it."""

    def execute(
        self,
        execution: driver.Execution,
        recorder: driver.Recorder | None,
        *,
        cancel: Event | None = None,
        progress: Progress | None = None,
    ) -> driver.Outcome:
        """See `Driver.execute`; another control rate, or a program that runs, is refused."""
        host, wish = self.state.host, cancel or Event()
        if execution.rate_hz != self.state.rate_hz:
            what, limit = "the controller has another rate", f"{self.state.rate_hz} Hz"
            raise InputError(what, where=host, value=execution.rate_hz, limit=limit)

        def record(converse: Converse) -> driver.Outcome:
            watchdog = driver.Watchdog(
                execution.limits,
                execution.rate_hz,
                execution.total,
                slack=self.slack,
                way=np.stack([*execution.via, execution.setpoints()[0]]),
            )
            with closing(RtdeLink(host)) as link:
                names = variables.recorded_names(link.version[:3], self.index)
                layout = variables.Layout.of(link.ask_outputs(names))
                feed = link.ask_inputs([variables.FEED])
                with closing(ScriptPort(host)) as port:
                    link.write(feed.packet([-1]))
                    link.start()
                    conversation = converse(layout, feed, port)
                    pump = Pump(link, layout, watchdog, conversation, cancel=wish)
                    pump.start()
                    return Intake(execution, layout, recorder, progress).take(pump)

        # A check before the first pass knows nothing of what was started between two.
        variables.require_free(host)
        # To collect all that is loaded takes as long as the watchdog waits: before, not meanwhile.
        gc.collect()
        gc.freeze()
        try:
            return self.move(execution, wish, record)
        finally:
            gc.unfreeze()


class UrDriver(RtdeDriver):
    """Uploads a program that evaluates the motion, feeds it, records and watches every cycle."""

    index = variables.INDEX

    def move(self, execution: driver.Execution, cancel: Event, record: Record) -> driver.Outcome:
        """See `RtdeDriver.move`."""
        program = ur_program(
            execution.trajectory,
            rate_hz=execution.rate_hz,
            repeats=execution.periods,
            settle=execution.settle,
            via=execution.via[1:],
        )

        def converse(layout: variables.Layout, feed: Recipe, port: ScriptPort) -> Conversation:
            if not cancel.is_set():
                port.send(program)
            return _Program(layout, feed, port)

        return record(converse)


class _Program:
    """The conversation with our program: it is fed, and tells what it does."""

    def __init__(self, layout: variables.Layout, feed: Recipe, port: ScriptPort) -> None:
        self._layout, self._port = layout, port
        self._fodder = (feed.packet([0]), feed.packet([1]))
        self._count = 0

    def answer(self, numbers: Numbers) -> bytes:
        """Something new each time."""
        self._count += 1
        if self._count % _DRAIN_EVERY == 0:
            self._port.drain()
        return self._fodder[self._count % 2]

    def begun(self, cycle: driver.Cycle, numbers: Numbers) -> bool:
        """Whether it is on its way to the start."""
        return (
            cycle.runtime_state == RuntimeState.PLAYING
            and cycle.index == -1
            and self._layout.number(numbers, variables.STATE) == variables.APPROACHING
        )

    def over(self, cycle: driver.Cycle, numbers: Numbers) -> bool:
        """Whether it has come to rest."""
        stopped = cycle.runtime_state != RuntimeState.PLAYING
        return stopped or self._layout.number(numbers, variables.STATE) == variables.DONE

    def halt(self) -> None:
        """Another program takes its place; it is fed no more."""
        halt(self._port)


def halt(port: ScriptPort) -> None:
    """Stop by a program; if that port is gone, by the dashboard. Starving it stops it anyway."""
    try:
        port.send(STOP_PROGRAM)
    except JobError:
        with suppress(JobError), closing(Dashboard(port.host)) as board:
            board.ask("stop")


LOOKAHEAD_S, GAIN = 0.03, 500.0
"""Of `servoj`."""
APPROACH = 0.5
"""Joint speed [rad/s] and acceleration [rad/s^2] of the way to the start."""
SLACK = 5
"""Cycles by which the stream may be late before the robot is stopped."""
_HOLD_S = 0.2
"""How long the last set point is sent on, for the arm to arrive [s]."""
_LEAD_CYCLES = 5
"""Cycles for which the start is sent before the first set point: the stream has its rhythm then."""
_LOOK_S = 0.01
"""How often ur_rtde's watchdog is kicked before the first set point [s]."""
_ARRIVED = 1e-3
"""The target at this distance from a pose has reached it [rad]."""
_LAG_S, _OFF_STREAM = 0.3, 0.05
"""The target follows the set points at most so late [s], and at most so far off them [rad]."""


class ServojDriver(RtdeDriver):
    """Streams set points with ur_rtde; records and watches every cycle as the other way does.

    Raises:
        MissingExtraError: ur_rtde is not installed.
    """

    index, slack = variables.FEED, SLACK

    def __init__(self, state: variables.ControllerState) -> None:
        super().__init__(state)
        require("rtde_control", "ur")

    def move(self, execution: driver.Execution, cancel: Event, record: Record) -> driver.Outcome:
        """See `RtdeDriver.move`."""
        if cancel.is_set():
            return driver.Outcome(samples=0, periods=0, gaps=0, abort=driver.INTERRUPTED)
        # What may fail comes before ur_rtde, which starts its program.
        starts, control = execution.setpoints()[:1], self._control(self.state.host)
        way = Way(control, (*execution.via[1:], *starts))
        try:
            outcome = record(
                lambda layout, feed, port: Stream(control, layout, feed, port, execution, way)
            )
            if outcome.abort is None:
                # If that fails, its watchdog ends the program: nobody kicks it any more.
                with suppress(RuntimeError):
                    control.servoStop()
                    control.stopScript()
            return outcome
        finally:
            if way.ident is None:
                # Its program would play on: the way, which sets its watchdog, has not begun.
                with suppress(RuntimeError):
                    control.stopScript()
            # First: who waits for an answer of it would wait until the network is back.
            control.close()
            way.leave()

    def _control(self, host: str) -> UrRtde:
        try:
            return UrRtde(host)
        except RuntimeError as error:
            raise JobError("ur_rtde cannot control the robot", where=host, value=error) from error


class Way(Thread):
    """Moves from pose to pose, each (n) [rad], resting at each, with ur_rtde's `control`.

    Its watchdog is kicked until the first set point: the arm stops with this process, not at the
    next pose. Each move waits for the controller: a thread that answers packages cannot do it.
    """

    def __init__(self, control: Any, poses: Sequence[Array]) -> None:
        super().__init__(name="dynid-way", daemon=True)
        self.fault: Exception | None = None
        """Why the arm did not get there."""
        self.arrived = Event()
        """Set when the last move has ended."""
        self._control, self._poses, self._left = control, poses, Event()

    def run(self) -> None:
        """See `threading.Thread`."""
        try:
            self._control.setWatchdog(driver.WATCHDOG_HZ)
            for pose in self._poses:
                self._wait(self._control.moveJ(pose.tolist(), APPROACH, APPROACH, True))
                while self._control.getAsyncOperationProgress() >= 0:
                    self._wait(self._control.kickWatchdog())
            self.arrived.set()
            while not self._left.is_set():
                self._wait(self._control.kickWatchdog())
        # Whoever answers the packages raises it, and stops the robot.
        except Exception as error:
            self.fault = error

    def _wait(self, sent: bool) -> None:
        if not sent:
            raise Refused("the program of ur_rtde ended on the way to the start")
        if self._left.wait(_LOOK_S) and not self.arrived.is_set():
            raise Refused("the way to the start was left")

    def leave(self) -> None:
        """Move no more and kick no more; a move that was begun is left to ur_rtde's watchdog."""
        self._left.set()
        if self.is_alive():
            self.join()


class Stream:
    """The conversation: each package that arrives lets one set point go, once the way is over."""

    def __init__(
        self,
        control: Any,
        layout: variables.Layout,
        feed: Recipe,
        port: ScriptPort,
        execution: driver.Execution,
        way: Way,
    ) -> None:
        self._control, self._feed, self._execution = control, feed, execution
        self._port = port
        self._path, self._layout = execution.setpoints(), layout
        self._setpoints = self._path.tolist()
        self._target, self._way = layout.places["target_q"], way
        self._lag = round(_LAG_S * execution.rate_hz)
        self._next, self._late = -_LEAD_CYCLES, 0
        self._cycle = 1.0 / execution.rate_hz
        self._hold = round(_HOLD_S * execution.rate_hz)
        way.start()

    def answer(self, numbers: Numbers) -> bytes | None:
        """Send the next set point, and its number; nothing on the way to the start."""
        if self._next == -_LEAD_CYCLES and not self._at_start(numbers):
            return None
        self._check_target(numbers)
        k, last = self._next, self._execution.total - 1
        self._next += 1
        q = self._setpoints[max(min(k, last), 0) % self._execution.cycles]
        try:
            sent = self._control.servoJ(q, 0.0, 0.0, self._cycle, LOOKAHEAD_S, GAIN)
        except RuntimeError as error:
            raise Refused("ur_rtde cannot go on", value=error) from error
        if not sent:
            raise Refused(
                "ur_rtde has lost its program on the controller: its watchdog was not fed in time, "
                "the network is slow or this computer is busy; or someone stopped it"
            )
        return self._feed.packet([max(min(k, last + 1), -1)])

    def _check_target(self, numbers: Numbers) -> None:
        """The numbers of set points are our own: they go on where another program moves the arm."""
        index = int(self._layout.number(numbers, self._layout.index))
        due = np.arange(index - self._lag, index + SLACK + 1).clip(0, self._execution.total - 1)
        recent, target = self._path[due % self._execution.cycles], np.array(numbers[self._target])
        away = np.maximum(recent.min(axis=0) - target, target - recent.max(axis=0)).max()
        if not away <= _OFF_STREAM:
            what = "the arm is off its set points: another program has taken the robot over"
            raise Refused(what, value=f"{away:.3g} rad", limit=f"{_OFF_STREAM:g} rad")

    def _at_start(self, numbers: Numbers) -> bool:
        """Whether set points can be sent: to an arm elsewhere the first one is a jump."""
        if self._way.fault is not None:
            raise Refused("no way to the start", value=self._way.fault) from self._way.fault
        if not self._way.arrived.is_set():
            return False
        pairs = zip(numbers[self._target], self._setpoints[0], strict=True)
        away = max(abs(a - b) for a, b in pairs)
        # Its end may be told before the package with its last step arrives.
        if away > _ARRIVED and self._late < self._hold:
            self._late += 1
            return False
        if away > _ARRIVED:
            raise Refused("the way to the start ended elsewhere", value=f"{away:.3g} rad away")
        self._way.leave()
        return True

    def begun(self, cycle: driver.Cycle, numbers: Numbers) -> bool:
        """Whether ur_rtde's program runs and our number has arrived."""
        return cycle.runtime_state == RuntimeState.PLAYING and cycle.index < 0

    def over(self, cycle: driver.Cycle, numbers: Numbers) -> bool:
        """Whether the arm has had the time to arrive at the last set point."""
        return self._next > self._execution.total + self._hold

    def halt(self) -> None:
        """Whatever becomes of the stop, the watchdog of ur_rtde's program is kicked no more."""
        self._control.kill()
        halt(self._port)
