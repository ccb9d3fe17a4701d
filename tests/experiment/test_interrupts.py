"""Ctrl-C becomes a wish, and only for as long as the robot moves."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator

import pytest

from dynid.experiment import interruptible, stop_on_signals

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture(autouse=True)
def _a_terminal_that_can_close() -> Iterator[None]:
    """Tests may run under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_sets_the_event_and_raises_nothing(number: int) -> None:
    with stop_on_signals() as event:
        assert not event.is_set()
        for _ in range(3):
            os.kill(os.getpid(), number)
        assert event.wait(1.0)


def test_afterwards_ctrl_c_is_what_it_was() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with pytest.raises(RuntimeError), stop_on_signals():
        raise RuntimeError
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)


def test_under_nohup_a_terminal_that_closes_stops_nothing() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with stop_on_signals() as event:
        os.kill(os.getpid(), signal.SIGHUP)
        assert not event.wait(0.1)


def test_in_another_thread_the_event_is_the_callers() -> None:
    seen: list[bool] = []

    def work() -> None:
        with stop_on_signals() as event:
            event.set()
            seen.append(event.is_set())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [True]


@pytest.mark.parametrize("number", SIGNALS)
def test_a_question_can_be_left_by_a_signal(number: int) -> None:
    with stop_on_signals() as event:
        with pytest.raises(KeyboardInterrupt), interruptible():
            os.kill(os.getpid(), number)
        assert not event.is_set()
        os.kill(os.getpid(), number)
        assert event.wait(1.0)
