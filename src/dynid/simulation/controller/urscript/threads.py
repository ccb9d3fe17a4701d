"""Threads of a program, and the critical section that only one of them is in."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from typing import Any

from dynid.simulation.controller.urscript.values import Value

ENTERING, LISTENING, BACK = "entering", "listening", "back"
"""What a thread may say when it waits: for the critical section; for the network or the end of
another, who may have the section meanwhile; for what it had before. None: for the next cycle."""

Frame = list[Value]
Routine = Generator[str | None, None, Any]


class ThreadEnd(Exception):
    """A thread killed itself."""


class Thread:
    """One thread of a program."""

    __slots__ = ("alive", "depth", "frames", "function", "handle", "routine", "waits")

    def __init__(self, handle: int) -> None:
        self.handle = handle
        self.alive = True
        self.frames: list[Frame] = []
        self.function: object = None
        """Which of the script's threads it runs."""
        self.routine: Routine | None = None
        self.waits: str | None = None
        """What it waits for, besides the next cycle."""
        self.depth = 0
        """How deep it was in the critical section when it began to listen."""


class CriticalSection:
    """Who is in it keeps all others from running; who wants in gets in by turns."""

    __slots__ = ("_depth", "_line", "holder", "passed")

    def __init__(self) -> None:
        self.holder: Thread | None = None
        self.passed = False
        """Whether it has kept somebody from running who is to run before it is entered again."""
        self._depth = 0
        self._line: deque[Thread] = deque()

    def open_to(self, thread: Thread) -> bool:
        """Whether a thread can enter at once."""
        return self.holder is thread or not (self.holder or self._line or self.passed)

    def enter(self, thread: Thread) -> None:
        """The thread is in, once more."""
        self.holder = thread
        self._depth += 1

    def leave(self) -> None:
        """The thread leaves once."""
        self._depth = max(self._depth - 1, 0)
        if self._depth == 0:
            self.holder = None

    def stops(self, thread: Thread) -> bool:
        """Whether it keeps a thread from running now."""
        waits = thread.waits
        if waits is None:
            return self.holder is not None and self.holder is not thread
        if waits is LISTENING or (waits is BACK and not thread.depth):
            return False
        return self.holder is not None or self._line[0] is not thread

    def wait(self, thread: Thread, waits: str) -> None:
        """A thread waits for more than the next cycle."""
        thread.waits = waits
        if waits is ENTERING or (waits is BACK and thread.depth):
            self._line.append(thread)
        elif waits is LISTENING and self.holder is thread:
            thread.depth, self._depth, self.holder = self._depth, 0, None

    def go(self, thread: Thread) -> None:
        """A thread's wait is over."""
        if self._line and self._line[0] is thread:
            self._line.popleft()
            self.holder, self._depth, thread.depth = thread, thread.depth or 1, 0
        thread.waits = None

    def forget(self, thread: Thread) -> None:
        """A thread has ended."""
        if self.holder is thread:
            self.holder, self._depth = None, 0
        if thread in self._line:
            self._line.remove(thread)
