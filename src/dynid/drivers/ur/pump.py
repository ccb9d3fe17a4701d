"""Threads that read every package, watch it, and store it."""

import os
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import replace
from typing import Protocol

from dynid.core import DynidError, JobError, Progress
from dynid.drivers import driver
from dynid.drivers.ur.link import Disconnected, RtdeLink
from dynid.drivers.ur.variables import Layout
from dynid.protocol import Numbers, RuntimeState

START_S = 10.0
"""Controller time in which an uploaded program must have begun [s]."""
BACKLOG_S = 60.0
"""Controller time by which the recorder may fall behind [s]: about 80 MB at 500 Hz."""
STOP_S = 3.0
"""Controller time after a stop, or the last sample, for which packages are still read [s]."""
_REFUSED = "Switch on remote control, and allow the secondary interface (port 30002), there."
_STILL = 1e-9
"""Target velocities below this are rest [rad/s]."""
_PRIORITY = 10
"""Of the thread, among those of the system that must keep time; 1 is the lowest."""


class Refused(JobError):
    """The controller no longer does what it is told."""


class Conversation(Protocol):
    """What is answered to the controller, and what its numbers mean."""

    def answer(self, numbers: Numbers) -> bytes | None:
        """What to send for a package; None for nothing.

        Raises:
            Refused: The motion cannot go on.
        """
        ...

    def begun(self, cycle: driver.Cycle, numbers: Numbers) -> bool:
        """Whether our motion runs; registers keep what an earlier one left there."""
        ...

    def over(self, cycle: driver.Cycle, numbers: Numbers) -> bool:
        """Whether it has ended, its last set point seen."""
        ...

    def halt(self) -> None:
        """Stop the robot, and feed no watchdog any more; from any thread."""
        ...


class Pump(threading.Thread):
    """Reads packages until the motion has ended and the robot stands still.

    It never waits for the disk: packages go to `rows`, which another thread empties. The watchdog
    judges every cycle from the motion's begin on; the conversation halts the robot, once.
    """

    def __init__(
        self,
        link: RtdeLink,
        layout: Layout,
        watchdog: driver.Watchdog,
        conversation: Conversation,
        *,
        cancel: threading.Event,
    ) -> None:
        super().__init__(name="dynid-rtde", daemon=True)
        self.rows: deque[Numbers] = deque()
        """Packages from the first set point to the last one or a stop, oldest first."""
        self.over = threading.Event()
        """Set when no more packages will come."""
        self.abort: driver.Abort | None = None
        """Why the motion was ended early."""
        self.fault: Exception | None = None
        """An error of ours that ended this thread, to be raised where somebody sees it."""
        self._link, self._layout, self._watchdog = link, layout, watchdog
        self._conversation, self._cancel = conversation, cancel
        self._begun = self._ended = False
        self._pause = 0.0
        self._backlog = round(BACKLOG_S * link.rate_hz)
        self._patience = round(START_S * link.rate_hz)
        self._after = round(STOP_S * link.rate_hz)
        self._lock = threading.Lock()

    @property
    def gaps(self) -> int:
        """Control cycles that never arrived."""
        return self._watchdog.gaps

    def stop(self, abort: driver.Abort) -> None:
        """Stop the robot; the first cause is the one that counts."""
        with self._lock:
            if self.abort is not None:
                return
            facts = self._link.messages[-2:]
            if abort.code == "program" and self._pause > 1 / driver.WATCHDOG_HZ:
                facts = [f"no package came for {self._pause:.2g} s", *facts]
            said = "; ".join(dict.fromkeys(facts))
            self.abort = replace(abort, message=f"{abort.message} ({said})") if said else abort
        self._conversation.halt()

    def run(self) -> None:
        """See `threading.Thread`."""
        # The robot waits for this thread: it goes before others, where the system allows it.
        with suppress(OSError, AttributeError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        try:
            seen = time.monotonic()
            while not self._ended:
                packages, before, seen = self._link.packages(), seen, time.monotonic()
                self._pause = max(self._pause, seen - before)
                for numbers in packages:
                    self._take(numbers)
                    if self._ended:
                        break
        except Disconnected as error:
            self.stop(driver.Abort("connection", str(error)))
        except JobError as error:
            self.stop(driver.Abort("connection", f"the controller's data cannot be read: {error}"))
        # Nobody else watches the robot: whatever it is, first the robot stops.
        except Exception as error:
            self.fault = error
            self.stop(driver.Abort("program", f"dynid failed: {type(error).__name__}: {error}"))
        finally:
            self.over.set()

    def _take(self, numbers: Numbers) -> None:
        cycle = self._layout.cycle(numbers)
        self._begun = self._begun or self._conversation.begun(cycle, numbers)
        moving = self._begun and not self._watchdog.finished
        if self.abort is None:
            self._answer(cycle, numbers)
        # How a stop brakes is no part of the motion.
        if moving and cycle.index >= 0 and self.abort is None:
            self.rows.append(numbers)
            if len(self.rows) > self._backlog:
                self.stop(driver.Abort("recording", "the recording cannot keep up with the robot"))
        if self.abort is None and not self._watchdog.finished:
            return
        # Another program may have taken the robot over, which need never end.
        self._after -= 1
        over = self._conversation.over(cycle, numbers)
        if self.abort is not None:
            speed = max(map(abs, numbers[self._layout.places["target_qd"]]))
            over = speed < _STILL and cycle.runtime_state != RuntimeState.PLAYING
        self._ended = over or self._after <= 0

    def _answer(self, cycle: driver.Cycle, numbers: Numbers) -> None:
        words = refused = None
        try:
            words = self._conversation.answer(numbers)
        except Refused as error:
            # The state that explains it comes first.
            refused = driver.Abort("program", str(error))
        if words is not None:
            self._link.write(words)
        if self._cancel.is_set():
            self.stop(driver.INTERRUPTED)
        elif abort := self._watchdog.see(cycle, begun=self._begun) or refused:
            self.stop(abort)
        elif not self._begun:
            self._patience -= 1
            if self._patience <= 0:
                what = f"the program did not start within {START_S:g} s of robot time"
                self.stop(driver.Abort("start", what, _REFUSED))


_LOOK_S = 0.02
"""How often packages are fetched [s]."""
_TELL_EVERY = 25
"""Samples from one word of progress to the next."""


class Intake:
    """Empties a pump into a recorder, if there is one."""

    def __init__(
        self,
        execution: driver.Execution,
        layout: Layout,
        recorder: driver.Recorder | None,
        progress: Progress | None,
    ) -> None:
        self._execution, self._layout = execution, layout
        self._recorder, self._progress = recorder, progress
        self._first: float | None = None
        self._indices: set[int] = set()
        self._samples = 0

    def take(self, pump: Pump) -> driver.Outcome:
        """Record until the pump has ended; whatever goes wrong here stops the robot."""
        try:
            # A look now and then: waking for every package would cost more than to record it.
            while not pump.over.wait(_LOOK_S):
                self._empty(pump)
            self._empty(pump)
        except BaseException:
            pump.stop(driver.Abort("interrupted", "the program that records ended"))
            raise
        finally:
            pump.join()
        if pump.fault is not None:
            raise pump.fault
        execution = self._execution
        # Periods of which every sample is there.
        periods = sum(
            self._indices.issuperset(range(start, start + execution.cycles))
            for start in range(execution.first_recorded, execution.total, execution.cycles)
        )
        return driver.Outcome(
            samples=self._samples, periods=periods, gaps=pump.gaps, abort=pump.abort
        )

    def _empty(self, pump: Pump) -> None:
        execution, layout = self._execution, self._layout
        while pump.rows:
            numbers = pump.rows.popleft()
            index = int(layout.number(numbers, layout.index))
            if self._progress is not None and index % _TELL_EVERY == 0:
                self._progress("run", min((index + 1) / execution.total, 1.0))
            inside = execution.first_recorded <= index < execution.total
            if self._recorder is None or not inside:
                continue
            now = layout.number(numbers, "timestamp")
            self._first = now if self._first is None else self._first
            signals = {name: numbers[place] for name, place in layout.signals}
            channels = {name: float(numbers[place]) for name, place in layout.channels}
            try:
                self._recorder.append(now - self._first, signals, channels)
            except DynidError as error:
                self._recorder = None
                # How rows are read is told at the end, when it is known whether there are any.
                pump.stop(driver.Abort("recording", error.changed(next_step=None).line))
            else:
                self._samples += 1
                self._indices.add(index)
