"""The second way: ur_rtde streams set points by `servoJ`, one for each package that arrives.

Where the first way cannot be used: programs of others on the controller, motions that URScript
cannot evaluate. Set points may then be used twice or skipped; the index of each sample is the
number that the controller had when it sent the sample.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import JobError
from dynid.core.optional import require
from dynid.drivers.driver import Driver, Execution, Outcome, Progress, Recorder, Source
from dynid.drivers.ur.commands import ScriptPort
from dynid.drivers.ur.driver import check_rate, halt, source_of
from dynid.drivers.ur.intake import Intake
from dynid.drivers.ur.layout import FEED, Layout, recorded_names
from dynid.drivers.ur.link import RtdeLink
from dynid.drivers.ur.pump import Pump
from dynid.drivers.ur.state import ControllerState
from dynid.drivers.watchdog import Abort, Cycle, Watchdog
from dynid.protocol.modes import RuntimeState
from dynid.protocol.recipe import Numbers, Recipe

LOOKAHEAD_S, GAIN = 0.03, 500.0
"""Of `servoj`."""
APPROACH = 0.5
"""Joint speed [rad/s] and acceleration [rad/s^2] of the way to the start."""
SLACK = 5
"""Cycles by which the stream may be late before the robot is stopped."""
WATCHDOG_HZ = 10.0
_THERE, _STILL = 1e-3, 1e-6
_HOLD_S, _APPROACH_S = 0.2, 60.0


class ServojDriver(Driver):
    """Streams set points with ur_rtde; records and watches every cycle as the other way does.

    Args:
        state: The controller, as `inspect` found it.

    Raises:
        MissingExtraError: ur_rtde is not installed.
    """

    def __init__(self, state: ControllerState) -> None:
        self.state = state
        self._rtde: Any = require("rtde_control", "ur")

    @property
    def source(self) -> Source:
        """See `Driver.source`."""
        return source_of(self.state, FEED)

    def execute(
        self,
        execution: Execution,
        recorder: Recorder | None,
        *,
        cancel: threading.Event | None = None,
        progress: Progress | None = None,
    ) -> Outcome:
        """See `Driver.execute`."""
        check_rate(execution, self.state)
        host = self.state.host
        control = self._control(host)
        try:
            with RtdeLink(host) as link:
                names = recorded_names(link.version[:3], FEED)
                layout = Layout.of(link.ask_outputs(names))
                feed = link.ask_inputs([FEED])
                port = ScriptPort(host)
                try:
                    link.write(feed.packet([-1]))
                    stream = _Stream(control, link, feed, layout, execution)
                    link.start()
                    pump = Pump(
                        link,
                        layout,
                        Watchdog(execution.limits, execution.rate_hz, execution.total, slack=SLACK),
                        stream,
                        halt=lambda: halt(port),
                        cancel=cancel or threading.Event(),
                    )
                    stream.start(pump)
                    pump.start()
                    outcome = Intake(execution, layout, recorder, progress).take(pump)
                    stream.join()
                    return outcome
                finally:
                    port.close()
        finally:
            control.disconnect()

    def _control(self, host: str) -> Any:
        try:
            return self._rtde.RTDEControlInterface(host)
        except RuntimeError as error:
            raise JobError("ur_rtde cannot control the robot", where=host, value=error) from error


class _Stream:
    """The conversation: each package that arrives lets one set point go."""

    def __init__(
        self, control: Any, link: RtdeLink, feed: Recipe, layout: Layout, execution: Execution
    ) -> None:
        self._control, self._link, self._feed, self._layout = control, link, feed, layout
        self._execution = execution
        self._setpoints = execution.setpoints()
        self._news = threading.Condition()
        self._latest: Numbers = ()
        self._count = 0
        self._done = False
        self._thread: threading.Thread | None = None

    def answer(self, numbers: Numbers) -> None:
        """Wake the stream; the pump itself sends nothing."""
        with self._news:
            self._latest = numbers
            self._count += 1
            self._news.notify_all()

    def begun(self, cycle: Cycle, numbers: Numbers) -> bool:
        """Whether ur_rtde's program runs."""
        return cycle.runtime_state == RuntimeState.PLAYING and cycle.index == -1

    def over(self, cycle: Cycle, numbers: Numbers) -> bool:
        """Whether the robot was brought to rest."""
        return self._done

    def start(self, pump: Pump) -> None:
        """Begin to stream, in a thread of its own."""
        self._thread = threading.Thread(
            target=self._run, args=(pump,), name="dynid-servoj", daemon=True
        )
        self._thread.start()

    def join(self) -> None:
        """Wait until the stream has ended."""
        with self._news:
            self._news.notify_all()
        if self._thread is not None:
            self._thread.join()

    def _run(self, pump: Pump) -> None:
        try:
            if not self._approach(pump):
                return
            self._control.setWatchdog(WATCHDOG_HZ)
            hold = round(_HOLD_S * self._execution.rate_hz)
            first = self._count + 1
            k = -1
            while k < self._execution.total + hold:
                if not self._wait(pump):
                    return
                # By the packages that came: a late stream skips, so that periods keep their time.
                k = self._count - first
                self._send(k)
            self._control.servoStop()
            self._control.stopScript()
            self._done = True
        except (JobError, RuntimeError) as error:
            # ur_rtde raises RuntimeError for whatever it does not like.
            pump.stop(Abort("program", f"ur_rtde cannot go on: {error}"))

    def _send(self, k: int) -> None:
        last = self._execution.total - 1
        q = self._setpoints[min(k, last) % self._execution.cycles]
        cycle = 1.0 / self._execution.rate_hz
        if not self._control.servoJ(q.tolist(), 0.0, 0.0, cycle, LOOKAHEAD_S, GAIN):
            raise JobError("its servoJ was refused", where=f"set point {k}")
        self._link.write(self._feed.packet([min(k, last + 1)]))

    def _approach(self, pump: Pump) -> bool:
        start: Array = self._setpoints[0]
        self._control.moveJ(start.tolist(), APPROACH, APPROACH, True)
        for _ in range(round(_APPROACH_S * self._execution.rate_hz)):
            if not self._wait(pump):
                return False
            places = self._layout.places
            away = np.abs(np.array(self._latest[places["target_q"]]) - start).max()
            speed = np.abs(self._latest[places["target_qd"]]).max()
            if away < _THERE and speed < _STILL:
                return True
        raise JobError("its moveJ did not reach the start", limit=f"{_APPROACH_S:g} s")

    def _wait(self, pump: Pump) -> bool:
        """Wait for the next package; whether the motion still goes on."""
        with self._news:
            seen = self._count
            self._news.wait_for(lambda: self._count > seen or pump.ended, timeout=1.0)
        return pump.abort is None and not pump.ended
