"""UR robots: the controller evaluates the motion, every package is recorded."""

from __future__ import annotations

import threading
from contextlib import suppress

from dynid.core.errors import InputError, JobError
from dynid.core.progress import Progress
from dynid.drivers.driver import Driver, Execution, Outcome, Recorder, Source
from dynid.drivers.ur.commands import STOP_PROGRAM, Dashboard, ScriptPort
from dynid.drivers.ur.intake import Intake
from dynid.drivers.ur.layout import (
    APPROACHING,
    DONE,
    FEED,
    INDEX,
    SIGNALS,
    STATE,
    Layout,
    recorded,
    recorded_names,
)
from dynid.drivers.ur.link import RtdeLink
from dynid.drivers.ur.pump import Pump
from dynid.drivers.ur.state import ControllerState
from dynid.drivers.watchdog import Cycle, Watchdog
from dynid.protocol.modes import RuntimeState
from dynid.protocol.recipe import Numbers, Recipe
from dynid.trajectory.urscript import UrProgramOptions, ur_program

WATCHDOG_HZ = 10.0
"""How often the program must be fed; without it the controller stops after 0.1 s."""
_DRAIN_EVERY = 25
"""Cycles after which the states that the script port sends are thrown away."""


class UrDriver(Driver):
    """Uploads a program that evaluates the motion, feeds it, records and watches every cycle.

    Args:
        state: The controller, as `inspect` found it.
    """

    def __init__(self, state: ControllerState) -> None:
        self.state = state

    @property
    def source(self) -> Source:
        """See `Driver.source`."""
        return source_of(self.state, INDEX)

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
        wish = cancel or threading.Event()
        options = UrProgramOptions(
            rate_hz=execution.rate_hz,
            repeats=execution.periods,
            settle=execution.settle,
            watchdog_hz=WATCHDOG_HZ,
        )
        program = ur_program(execution.trajectory, options, via=execution.via)
        with RtdeLink(self.state.host) as link:
            layout = Layout.of(link.ask_outputs(recorded_names(link.version[:3])))
            feed = link.ask_inputs([FEED])
            port = ScriptPort(self.state.host)
            try:
                link.start()
                pump = Pump(
                    link,
                    layout,
                    Watchdog(execution.limits, execution.rate_hz, execution.total),
                    _Program(layout, feed, port),
                    halt=lambda: halt(port),
                    cancel=wish,
                )
                if not wish.is_set():
                    port.send(program.text)
                pump.start()
                return Intake(execution, layout, recorder, progress).take(pump)
            finally:
                port.close()


class _Program:
    """The conversation with our program: it is fed, and tells what it does."""

    def __init__(self, layout: Layout, feed: Recipe, port: ScriptPort) -> None:
        self._layout, self._port = layout, port
        self._fodder = (feed.packet([0]), feed.packet([1]))
        self._count = 0

    def answer(self, numbers: Numbers) -> bytes:
        """Something new each time."""
        self._count += 1
        if self._count % _DRAIN_EVERY == 0:
            self._port.drain()
        return self._fodder[self._count % 2]

    def begun(self, cycle: Cycle, numbers: Numbers) -> bool:
        """Whether it is on its way to the start."""
        return (
            cycle.runtime_state == RuntimeState.PLAYING
            and cycle.index == -1
            and self._layout.number(numbers, STATE) == APPROACHING
        )

    def over(self, cycle: Cycle, numbers: Numbers) -> bool:
        """Whether it has come to rest."""
        stopped = cycle.runtime_state != RuntimeState.PLAYING
        return stopped or self._layout.number(numbers, STATE) == DONE


def source_of(state: ControllerState, index: str) -> Source:
    """What the samples of a controller are made of.

    Args:
        state: The controller.
        index: The variable with the number of the sample.
    """
    version = ".".join(str(part) for part in state.version)
    return Source(
        quantities=tuple(SIGNALS),
        channels=tuple(name for name, _ in recorded(state.version[:3], index).channels),
        format="rtde",
        origin=f"{state.model or 'UR'} at {state.host}, software {version}",
        extra={
            "controller": version,
            "model": state.model,
            "start_degC": str([round(float(value), 2) for value in state.temperature]),
        },
    )


def check_rate(execution: Execution, state: ControllerState) -> None:
    """Refuse a motion for another control rate.

    Raises:
        InputError: It is for another rate.
    """
    if execution.rate_hz != state.rate_hz:
        raise InputError(
            "the controller has another rate",
            where=state.host,
            value=execution.rate_hz,
            limit=f"{state.rate_hz} Hz",
        )


def halt(port: ScriptPort) -> None:
    """Stop by a program; if that port is gone, by the dashboard. Starving it stops it anyway."""
    try:
        port.send(STOP_PROGRAM)
    except JobError:
        with suppress(JobError):
            board = Dashboard(port.host)
            try:
                board.ask("stop")
            finally:
                board.close()
