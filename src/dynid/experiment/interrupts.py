"""Ctrl-C while a robot moves: a wish to stop, not an exception at a random place."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType

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
