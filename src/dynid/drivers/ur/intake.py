"""From the pump to the recording, in a thread that may wait for the disk."""

from __future__ import annotations

from dynid.core.errors import DynidError
from dynid.core.progress import Progress
from dynid.drivers.driver import Execution, Outcome, Recorder
from dynid.drivers.ur.layout import Layout
from dynid.drivers.ur.pump import Pump
from dynid.drivers.watchdog import Abort
from dynid.protocol.recipe import Numbers

_LOOK_S = 0.02
"""How often packages are fetched [s]."""
_TELL_EVERY = 25
"""Samples from one word of progress to the next."""


class Intake:
    """Empties a pump into a recorder.

    Args:
        execution: What is executed.
        layout: What the packages bring.
        recorder: Where the samples go; None records nothing.
        progress: Told how far the motion is.
    """

    def __init__(
        self,
        execution: Execution,
        layout: Layout,
        recorder: Recorder | None,
        progress: Progress | None,
    ) -> None:
        self._execution, self._layout = execution, layout
        self._recorder, self._progress = recorder, progress
        self._first: float | None = None
        self._indices: set[int] = set()
        self._samples = 0

    def take(self, pump: Pump) -> Outcome:
        """Record until the pump has ended; whatever goes wrong here stops the robot."""
        try:
            # A look now and then: waking for every package would cost more than to record it.
            while not pump.over.wait(_LOOK_S):
                self._empty(pump)
            self._empty(pump)
        except BaseException:
            pump.stop(Abort("interrupted", "the program that records ended"))
            raise
        finally:
            pump.join()
        if pump.fault is not None:
            raise pump.fault
        return Outcome(
            samples=self._samples, periods=self._periods(), gaps=pump.gaps, abort=pump.abort
        )

    def _periods(self) -> int:
        """Periods of which every sample is there."""
        execution = self._execution
        return sum(
            self._indices.issuperset(range(start, start + execution.cycles))
            for start in range(execution.first_recorded, execution.total, execution.cycles)
        )

    def _empty(self, pump: Pump) -> None:
        execution = self._execution
        while pump.rows:
            numbers = pump.rows.popleft()
            index = int(self._layout.number(numbers, self._layout.index))
            if self._progress is not None and index % _TELL_EVERY == 0:
                self._progress("run", min((index + 1) / execution.total, 1.0))
            inside = execution.first_recorded <= index < execution.total
            if self._recorder is None or not inside:
                continue
            try:
                self._append(self._recorder, numbers)
            except DynidError as error:
                self._recorder = None
                pump.stop(Abort("recording", str(error)))
            else:
                self._samples += 1
                self._indices.add(index)

    def _append(self, recorder: Recorder, numbers: Numbers) -> None:
        layout = self._layout
        now = layout.number(numbers, "timestamp")
        if self._first is None:
            self._first = now
        recorder.append(
            now - self._first,
            {name: numbers[place] for name, place in layout.signals},
            {name: float(numbers[place]) for name, place in layout.channels},
        )
