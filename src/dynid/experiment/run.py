"""Executing a plan: its passes in order, the last one recorded.

Ctrl-C while a robot moves: a wish to stop, not an exception at a random place.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from threading import Event
from types import FrameType

from dynid.core import DynidError, Finding, Progress
from dynid.drivers import Abort, Driver, Execution, Outcome, Recorder
from dynid.experiment.plan import ExperimentPlan

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def stop_on_signals() -> Generator[threading.Event]:
    """Turn SIGINT and SIGTERM into an event for as long as the context lasts.

    The robot is then stopped and the recording closed in good order, wherever the program is.
    Outside the main thread signals cannot be caught; the event is then for the caller alone.

    Yields:
        The event that the signals set.
    """
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return

    def ask(number: int, frame: FrameType | None) -> None:
        event.set()

    before = {number: signal.signal(number, ask) for number in _SIGNALS}
    try:
        yield event
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def interruptible() -> Generator[None]:
    """Inside `stop_on_signals`: let Ctrl-C raise again while a person is asked something."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


OpenRecorder = Callable[[], AbstractContextManager[Recorder]]
"""Starts the recording."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """How a plan ended."""

    outcome: Outcome
    """Of the recorded pass, or of the pass that was ended early."""
    stopped_in: str | None
    """The pass in which the robot was stopped; None if it was not."""


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
        open_recorder: Starts the recording; called once, before the recorded pass moves.
        cancel: Stops the robot when it is set.
        progress: Told what is being done and how far it is (0 to 1).

    Returns:
        How it ended; a stop is no exception.

    Raises:
        InputError: A motion that does not fit the robot.
        JobError: The robot cannot be reached, or the recording cannot be started.
    """
    *before, last = plan.passes()
    for step in before:
        outcome = driver.execute(step.execution, None, cancel=cancel, progress=progress)
        if outcome.abort is not None:
            return RunResult(outcome=_nothing(outcome), stopped_in=step.name)
    return _recorded(last.execution, driver, open_recorder, cancel, progress)


def _recorded(
    execution: Execution,
    driver: Driver,
    open_recorder: OpenRecorder,
    cancel: Event | None,
    progress: Progress | None,
) -> RunResult:
    outcome: Outcome | None = None
    try:
        with open_recorder() as recorder:
            outcome = driver.execute(execution, recorder, cancel=cancel, progress=progress)
            if outcome.abort is not None:
                _mark(recorder, outcome.abort, outcome.samples)
    except DynidError as error:
        # Before the motion it is an error; after it, the end of the recording was refused.
        if outcome is None:
            raise
        refused = Abort("recording", str(error))
        outcome = replace(outcome, abort=outcome.abort or refused)
    return RunResult(outcome=outcome, stopped_in=None if outcome.abort is None else "run")


def _mark(recorder: Recorder, abort: Abort, samples: int) -> None:
    """Write the cause into the recording; what refuses the rows may refuse this too."""
    if abort.code != "recording":
        recorder.report(Finding("aborted", f"aborted after {samples} samples: {abort.message}"))


def _nothing(outcome: Outcome) -> Outcome:
    return replace(outcome, samples=0, periods=0)
