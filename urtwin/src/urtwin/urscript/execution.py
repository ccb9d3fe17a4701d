"""A running program: its threads, its memory and how much it may still do this cycle.

Threads are greenlets: what takes time waits wherever it is called, so that there is no second kind
of code beside plain functions.
"""

import time
from collections import deque
from collections.abc import Callable, Generator
from typing import Any

from greenlet import GreenletExit, getcurrent, greenlet

from dynid.core import DynidError
from urtwin.urscript.values import ScriptFault, ScriptHalt, Value, size

ENTERING, LISTENING, BACK = "entering", "listening", "back"
"""What a thread may say when it waits: for the critical section; for the network or the end of
another, who may have the section meanwhile; for what it had before. None: for the next cycle."""

Frame = list[Value]
Routine = Generator[str | None, None, Any]
"""A built-in that takes time; it yields what it waits for."""
MAX_THREADS = 50
"""Most threads at a time."""
MAX_DEPTH = 40
"""Deepest calls of one's own functions within each other."""
MAX_SLOTS = 20_000
"""Most variables alive at a time, over all calls and threads."""
MAX_MEMORY = 2_000_000
"""Most numbers and characters in all variables."""
CYCLE_CPU_S = 0.05
"""Processor time that a program may take in one control cycle [s]; what needs longer is an endless
loop. Where the cycle is shorter, the cycles that follow are late and catch up."""
_SOONEST_S = 0.001
"""Least time between two looks at the processor's clock, slower than that of the wall [s]."""


class Thread:
    """One thread of a program: a stack of its own, left where it waits and returned to."""

    __slots__ = ("alive", "depth", "frames", "function", "handle", "stack", "waits")

    def __init__(self, handle: int, work: Callable[[], object], function: object) -> None:
        self.handle, self.function = handle, function
        self.alive = True
        self.frames: list[Frame] = []
        self.stack = greenlet(work)
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
        """A call begins."""
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


class ScriptRun:
    """The state that compiled code works on; `port` is the controller, handed to built-ins.

    A program that wants too much (threads, calls, variables, memory, time) is a `ScriptFault`.
    """

    def __init__(self, port: Any, slots: int) -> None:
        self.port = port
        self.shared: Frame = [None] * slots
        self._began = self._next_look = 0.0
        self.looks = 0
        """Blocks run and values copied in this cycle: what it did, whatever the processor."""
        self.copied = 0
        self.threads: list[Thread] = []
        self.thread = Thread(0, lambda: None, None)
        self.finished = False
        self.fault: str | None = None
        """Why it stopped, if it did not stop by itself."""
        self.section = CriticalSection()
        self._slots = slots
        self._handles = 0
        self._outside = getcurrent()

    def start(self, work: Callable[[], object], function: object = None) -> int:
        """Add a thread that runs for the first time in this cycle; its handle.

        `work` is what it does, `function` the script's thread that it is; None for the main one.
        """
        if len(self.threads) >= MAX_THREADS:
            raise ScriptFault("too many threads", limit=MAX_THREADS)
        self._handles += 1
        self.threads.append(Thread(self._handles, work, function))
        return self._handles

    def wait(self, waits: str | None = None) -> None:
        """Let the present thread wait: for the next cycle, or for more than that."""
        self._outside.switch(waits)

    def finish(self, routine: Routine) -> Any:
        """Run a built-in that takes time to its end; what it returns."""
        try:
            while True:
                self.wait(next(routine))
        except StopIteration as end:
            return end.value

    def step(self) -> None:
        """One control cycle: every thread runs up to its next wait.

        Who stands before a critical section runs as soon as it is free, in the same cycle,
        those who came first before the others.
        """
        self._began, self._outside = time.thread_time(), getcurrent()
        self._next_look = time.perf_counter() + CYCLE_CPU_S
        self.looks = 0
        section = self.section
        pending, progress = self.threads, True
        while pending and progress:
            again: list[Thread] = []
            progress = section.passed = False
            for thread in pending:
                if not thread.alive:
                    # Another thread has killed it in this cycle.
                    continue
                if (section.holder or thread.waits) and section.stops(thread):
                    section.passed = section.passed or thread.waits is None
                    again.append(thread)
                    continue
                progress = True
                self._resume(thread)
                if self.finished:
                    return
                if thread.alive and (thread.waits is ENTERING or thread.waits is BACK):
                    again.append(thread)
            pending = again
        self.threads = [thread for thread in self.threads if thread.alive]

    def stop(self) -> None:
        """End the program, wherever it is."""
        self.finished = True
        for thread in self.threads:
            self._drop(thread)
        self.threads = []

    def enter(self, frame: Frame) -> None:
        """A call begins.

        Raises:
            ScriptFault: Too deep, or too many variables.
        """
        frames = self.thread.frames
        self._slots += len(frame)
        if len(frames) >= MAX_DEPTH:
            raise ScriptFault("calls are nested too deeply", limit=MAX_DEPTH)
        if self._slots > MAX_SLOTS:
            raise ScriptFault("out of memory: too many variables", limit=MAX_SLOTS)
        frames.append(frame)

    def leave(self) -> None:
        """A call ends."""
        self._slots -= len(self.thread.frames.pop())

    def look(self) -> None:
        """Look at the clock: the time of this cycle may be used up."""
        self.looks += 1
        if time.perf_counter() < self._next_look:
            return
        left = CYCLE_CPU_S - (time.thread_time() - self._began)
        if left < 0.0:
            raise ScriptFault(
                "endless loop: the program does too much without waiting",
                limit=f"{CYCLE_CPU_S:g} s of processor time in a control cycle",
                next_step="Call sync() in the loop.",
            )
        self._next_look = time.perf_counter() + max(left, _SOONEST_S)

    def charge(self, value: Value) -> None:
        """Account for a copy of a value."""
        amount = size(value)
        self.copied += amount
        self.look()
        if self.copied > MAX_MEMORY // 4:
            self.copied = 0
            frames = [self.shared, *(frame for each in self.threads for frame in each.frames)]
            held = sum(size(item) for frame in frames for item in frame)
            if held > MAX_MEMORY:
                raise ScriptFault("out of memory", value=held, limit=MAX_MEMORY)

    def kill(self, handle: Value) -> None:
        """End a thread; a handle of none does nothing, as on the robot.

        What is no handle is a `ScriptFault`.
        """
        if handle.__class__ is not int:
            raise ScriptFault("a thread handle expected", value=handle)
        for thread in self.threads:
            if thread.handle == handle and thread.alive:
                if thread is self.thread:
                    raise GreenletExit
                self._drop(thread)

    def lives(self, handle: Value) -> bool:
        """Whether a thread still runs."""
        return any(thread.alive and thread.handle == handle for thread in self.threads)

    def _resume(self, thread: Thread) -> None:
        self.thread = thread
        if thread.waits is not None:
            self.section.go(thread)
        thread.stack.parent = self._outside
        try:
            waits = thread.stack.switch()
            if not thread.stack.dead:
                if waits is not None:
                    self.section.wait(thread, waits)
                return
        except ScriptHalt:
            self.stop()
        except RecursionError:
            self._fail("calls are nested too deeply")
        except DynidError as error:
            self._fail(str(error))
        except Exception as error:
            # A fault of ours ends the script that met it, not the controller.
            self._fail(f"internal fault of urtwin: {type(error).__name__}: {error}")
        if self.threads and thread is self.threads[0] and not self.finished:
            # The program ends with its main thread.
            self.stop()
        self._drop(thread)

    def _fail(self, reason: str) -> None:
        self.fault = reason
        self.stop()

    def _drop(self, thread: Thread) -> None:
        thread.alive = False
        self._slots -= sum(len(frame) for frame in thread.frames)
        thread.frames.clear()
        self.section.forget(thread)
        if not thread.stack.dead:
            thread.stack.parent = getcurrent()
            thread.stack.throw()
