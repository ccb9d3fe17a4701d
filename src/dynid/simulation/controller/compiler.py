"""Compiles scripts beside the control cycle, in the order in which they came."""

from __future__ import annotations

import queue
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass

from dynid.core import DynidError
from dynid.simulation.controller.urscript.errors import ScriptError
from dynid.simulation.controller.urscript.program import Program

WAITING = 8
"""Programs that may wait to be compiled."""


@dataclass(frozen=True, slots=True)
class Compiled:
    """What came of a script."""

    program: Program | None
    """The program; None when it does not compile."""
    problem: ScriptError | None = None
    """What is wrong with it."""


class ScriptCompiler:
    """A thread that compiles, and a socket that becomes readable when it has.

    Compiling takes tens of milliseconds, many control cycles.

    Args:
        compile_: Turns text into a program; called in the thread.
    """

    def __init__(self, compile_: Callable[[str], Program]) -> None:
        self._compile = compile_
        self._scripts: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._finished: queue.SimpleQueue[Compiled] = queue.SimpleQueue()
        self._pending = 0
        self.signal, self._wake = socket.socketpair()
        self.signal.setblocking(False)
        self._thread = threading.Thread(target=self._work, name="urscript", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether a script has been taken that did not come back yet."""
        return self._pending > 0

    def submit(self, text: str) -> bool:
        """Take a script; whether there was room for it."""
        if self._pending >= WAITING:
            return False
        self._pending += 1
        self._scripts.put(text)
        return True

    def take(self) -> list[Compiled]:
        """What has been compiled since the last call, oldest first."""
        try:
            self.signal.recv(WAITING)
        except BlockingIOError:
            return []
        found: list[Compiled] = []
        while not self._finished.empty():
            found.append(self._finished.get())
        self._pending -= len(found)
        return found

    def close(self) -> None:
        """End the thread; what it compiles just now is thrown away."""
        self._scripts.put(None)
        self._thread.join(timeout=1.0)
        if not self._thread.is_alive():
            self.signal.close()
            self._wake.close()

    def _work(self) -> None:
        while (text := self._scripts.get()) is not None:
            self._finished.put(self._one(text))
            self._wake.send(b"!")

    def _one(self, text: str) -> Compiled:
        try:
            return Compiled(self._compile(text))
        except ScriptError as error:
            return Compiled(None, error)
        except DynidError as error:
            return Compiled(None, ScriptError(str(error), 1))
        except RecursionError:
            return Compiled(None, ScriptError("nested too deeply to compile", 1))
        except MemoryError:
            return Compiled(None, ScriptError("the script needs more memory than there is", 1))
