"""Ctrl-C becomes a wish, and only for as long as the robot moves."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from dynid.experiment import interruptible, stop_on_signals


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_question_can_be_left_by_a_signal(number: int) -> None:
    with stop_on_signals() as event:
        with pytest.raises(KeyboardInterrupt), interruptible():
            os.kill(os.getpid(), number)
        assert not event.is_set()
        os.kill(os.getpid(), number)
        assert event.wait(1.0)
