"""Interpreter mode: statements that clients add to the running program (port 30020).

What is answered, and when, is chapter 13 of the script manual: a statement is acknowledged when
it has been compiled into the program; what cannot be is discarded, with the reason.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from urtwin import urscript

Answer = Callable[[str], None]
MOST_WAITING = 8_500
"""Statements that may wait to be compiled, and as many to be run."""
MOST_COMPILED = 1_000_000
"""Characters of compiled statements that may wait to be run: some 250 MB."""
_LARGEST = 8_000
_A_CYCLE = 2_000
"""Characters that are compiled in a control cycle, about 2 ms."""
_QUICK = 8
"""Blocks in a control cycle after which no further statement begins in it. They are counted, not
timed: the same statements take the same cycles on every machine."""
_NOT_RUNNING = "Program is not running"
_LAST_OF_ITS_KIND = frozenset(("clear_interpreter", "end_interpreter"))
"""What follows these waits until they have been run."""


@dataclass(slots=True)
class _Received:
    text: str
    answer: Answer

    def discard(self, reason: str) -> None:
        self.answer(f"discard: {reason}: {self.text}")


class Interpreter:
    """The statements of one controller, and where they go."""

    def __init__(self) -> None:
        self._execution: urscript.ScriptRun | None = None
        self._base = self._context = urscript.Context({})
        self._lines: deque[_Received] = deque()
        self._queue: deque[tuple[int, urscript.CompiledProgram, int]] = deque()
        self._compiled = 0
        self._active = self._ending = self._held = self._abort = self._enough = False
        self._interpreted = self._executed = self._cleared = 0
        self._commands: dict[str, Callable[[], str]] = {
            "skipbuffer": self._skip,
            "abort": self._give_up,
            "statelastinterpreted": lambda: f"state: {self._interpreted}",
            "statelastexecuted": lambda: f"state: {self._executed}",
            "statelastcleared": lambda: f"state: {self._cleared}",
            "stateunexecuted": lambda: f"state: {len(self._queue) + len(self._lines)}",
        }
        """What is answered at once, also while a statement runs."""

    def begin(self, execution: urscript.ScriptRun, context: urscript.Context) -> None:
        """A program has started."""
        self._execution, self._base = execution, context
        self._context = context
        self._active = self._ending = self._abort = False
        self._interpreted = self._executed = self._cleared = 0

    def finish(self) -> None:
        """The program is over: what waits is discarded."""
        self._execution = None
        self._active = self._held = self._abort = False
        self._empty()
        while self._lines:
            self._lines.popleft().discard(_NOT_RUNNING)

    def receive(self, text: str, answer: Answer) -> None:
        """A command of the mode, or statements, from a client; `answer` takes the reply.

        Statements are answered when they have been compiled.
        """
        line = _Received(text, answer)
        if self._execution is None:
            line.discard(_NOT_RUNNING)
        elif text in self._commands:
            answer(f"{self._commands[text]()}: {text}")
        elif len(text) > _LARGEST:
            line.discard(f"Statement is longer than {_LARGEST} characters")
        elif len(self._lines) >= MOST_WAITING or len(self._queue) >= MOST_WAITING:
            line.discard("Too many interpreted messages")
        else:
            self._lines.append(line)

    def run(self, clear_queue: bool, clear_on_end: bool) -> urscript.Routine:
        """The mode itself, in the program's main thread, until it is ended.

        `clear_queue` forgets what came before the mode began, `clear_on_end` the functions and
        variables that were added. A second mode, or one in another thread, is a `ScriptFault`.
        """
        execution = self._execution
        if execution is None or self._active or execution.thread is not execution.threads[0]:
            raise urscript.ScriptFault("interpreter_mode belongs into the main thread, once")
        if clear_queue:
            while self._lines:
                self._lines.popleft().discard("Cleaned up before interpretation")
        self._active, self._ending, self._held = True, False, False
        while not self._ending:
            # Quick statements share a cycle, as long as they are few.
            if not self._queue or self._enough or execution.looks >= _QUICK:
                yield
                self._enough = False
                continue
            self._executed, addition, length = self._queue.popleft()
            self._compiled -= length
            new = len(addition.context.shared) - len(execution.shared)
            execution.shared += [None] * new
            addition.run(execution)
            self._held = self._held and not addition.called & _LAST_OF_ITS_KIND
        self._active = False
        self._empty()
        if clear_on_end:
            self.clear()

    def enough(self) -> None:
        """Something that takes long was done: no further statement begins in this cycle."""
        self._enough = True

    def end(self) -> None:
        """End the mode once the statement that runs is over."""
        self._ending = True

    def clear(self) -> None:
        """Forget what statements have defined so far, and end the threads that run it."""
        execution = self._execution
        self._cleared = self._executed
        if execution is None:
            return
        gone = {
            id(function)
            for name, function in self._context.functions.items()
            if self._base.functions.get(name) is not function
        }
        for thread in execution.threads:
            if id(thread.function) in gone:
                execution.kill(thread.handle)
        self._context = self._base
        del execution.shared[len(self._base.shared) :]

    def take_abort(self) -> bool:
        """Whether the move that runs is to be given up; asked once."""
        wanted, self._abort = self._abort, False
        return wanted

    def step(self) -> None:
        """One control cycle: compile what waits, a few lines at a time."""
        if not self._active or not self._lines:
            return
        left = min(_A_CYCLE, MOST_COMPILED - self._compiled)
        while self._lines and not self._held and not self._ending and left > 0:
            line = self._lines.popleft()
            left -= len(line.text)
            try:
                addition = urscript.compile_addition(line.text, self._context)
            except urscript.ScriptError as error:
                line.discard(f"Compile error {error.code.rstrip(':')}")
                continue
            except Exception as error:
                line.discard(f"Compile error {type(error).__name__}")
                continue
            self._context = addition.context
            self._interpreted += 1
            self._queue.append((self._interpreted, addition, len(line.text)))
            self._compiled += len(line.text)
            self._held = bool(addition.called & _LAST_OF_ITS_KIND)
            line.answer(f"ack: {self._interpreted}: {line.text}")

    def _empty(self) -> None:
        self._queue.clear()
        self._compiled = 0

    def _skip(self) -> str:
        self._empty()
        self._held = False
        while self._lines:
            self._lines.popleft().discard("Skipped")
        return f"ack: {self._interpreted}"

    def _give_up(self) -> str:
        self._abort = True
        return f"ack: {self._interpreted}"
