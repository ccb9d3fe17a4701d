"""Calls of a script's own functions and threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dynid.simulation.controller.urscript.code import Code
from dynid.simulation.controller.urscript.execution import Execution, Routine
from dynid.simulation.controller.urscript.syntax import Definition
from dynid.simulation.controller.urscript.values import Value


@dataclass(slots=True)
class Function:
    """A `def` or `thread` of a script; its body is compiled after those who call it."""

    definition: Definition
    slow: bool
    places: dict[str, int]
    """Its own variables."""
    body: Code | None = None

    def caller(self) -> Callable[..., Any]:
        """What a call does with the arguments; a generator function if the function is slow."""
        blank: list[Value] = [None] * (len(self.places) - len(self.definition.parameters))

        def at_once(x: Execution, *values: Value) -> Value:
            frame = [*values, *blank]
            x.enter(frame)
            signal = self.code.run(x, frame)
            x.leave()
            return signal[0] if signal.__class__ is tuple else None

        def waiting(x: Execution, *values: Value) -> Routine:
            frame = [*values, *blank]
            x.enter(frame)
            signal = yield from self.code.wait(x, frame)
            x.leave()
            return signal[0] if signal.__class__ is tuple else None

        return waiting if self.slow else at_once

    def starter(self) -> Callable[..., int]:
        """What `run` does with the arguments: it gives the handle of the new thread."""
        call = self.caller()

        def routine(x: Execution, values: tuple[Value, ...]) -> Routine:
            if self.slow:
                yield from call(x, *values)
            else:
                call(x, *values)

        def start(x: Execution, *values: Value) -> int:
            thread = x.new_thread()
            thread.function = self
            x.start(thread, routine(x, values))
            return thread.handle

        return start

    @property
    def code(self) -> Code:
        """The compiled body."""
        if self.body is None:
            raise RuntimeError(f"{self.definition.name} was never compiled")
        return self.body
