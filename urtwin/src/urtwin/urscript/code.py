"""Compiled code: composition of values, calls of the script's own functions, operator chains."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Concatenate

from urtwin.urscript.execution import Frame, Routine, ScriptRun
from urtwin.urscript.syntax import Definition
from urtwin.urscript.values import OPERATORS, Value, truth

Runner = Callable[[ScriptRun, Frame], Any]
"""Gives a value, or a generator that returns it where the code takes time."""
SlowRunner = Callable[[ScriptRun, Frame], Routine]
Combine = Callable[Concatenate[ScriptRun, ...], Any]
"""Takes the execution and the values of the operands."""


@dataclass(frozen=True, slots=True)
class Code:
    """A compiled expression or statement."""

    run: Runner
    slow: bool
    """Whether `run` is a generator function."""
    weight: int
    """Operations that it costs at most, calls of one's own functions apart."""
    fresh: bool = True
    """Whether its value belongs to nobody yet, so that it need not be copied."""

    @property
    def wait(self) -> SlowRunner:
        """`run` of slow code: a generator function."""
        return self.run


def compose(operands: list[Code], combine: Combine, *, slow: bool = False, weight: int = 1) -> Code:
    """Code that combines the values of operands, which are evaluated in order.

    `combine` is a generator function where it is slow; `weight` counts its operations.
    """
    total = weight + sum(operand.weight for operand in operands)
    if slow or any(operand.slow for operand in operands):
        return Code(_waiting(operands, combine, slow), True, total)
    runs = [operand.run for operand in operands]
    if not runs:
        return Code(lambda x, v: combine(x), False, total)
    if len(runs) == 1:
        one = runs[0]
        return Code(lambda x, v: combine(x, one(x, v)), False, total)
    if len(runs) == 2:
        first, second = runs
        return Code(lambda x, v: combine(x, first(x, v), second(x, v)), False, total)
    return Code(lambda x, v: combine(x, *[run(x, v) for run in runs]), False, total)


def _waiting(operands: list[Code], combine: Combine, slow: bool) -> Runner:
    parts = [(operand.run, operand.wait, operand.slow) for operand in operands]

    def run(x: ScriptRun, v: Frame) -> Routine:
        values: list[Any] = []
        for part, wait, waits in parts:
            values.append((yield from wait(x, v)) if waits else part(x, v))
        result = combine(x, *values)
        if slow:
            routine: Routine = result
            return (yield from routine)
        return result

    return run


@dataclass(slots=True)
class Function:
    """A `def` or `thread` of a script; its body is compiled after those who call it."""

    definition: Definition
    slow: bool
    places: dict[str, int]
    """Its own variables."""
    code: Code = field(init=False)
    """Its body, once that is compiled."""

    def caller(self) -> Callable[..., Any]:
        """What a call does with the arguments; a generator function if the function is slow."""
        blank: list[Value] = [None] * (len(self.places) - len(self.definition.parameters))

        def at_once(x: ScriptRun, *values: Value) -> Value:
            frame = [*values, *blank]
            x.enter(frame)
            signal = self.code.run(x, frame)
            x.leave()
            return signal[0] if signal.__class__ is tuple else None

        def waiting(x: ScriptRun, *values: Value) -> Routine:
            frame = [*values, *blank]
            x.enter(frame)
            signal = yield from self.code.wait(x, frame)
            x.leave()
            return signal[0] if signal.__class__ is tuple else None

        return waiting if self.slow else at_once

    def starter(self) -> Callable[..., int]:
        """What `run` does with the arguments: it gives the handle of the new thread."""
        call = self.caller()

        def routine(x: ScriptRun, values: tuple[Value, ...]) -> Routine:
            if self.slow:
                yield from call(x, *values)
            else:
                call(x, *values)

        def start(x: ScriptRun, *values: Value) -> int:
            thread = x.new_thread()
            thread.function = self
            x.start(thread, routine(x, values))
            return thread.handle

        return start


LOGIC = ("and", "or", "xor")
"""Operators on truth values."""


def arithmetic(operands: list[Code], signs: list[str]) -> Code:
    """Operators of one rank, from left to right, each between two of the operands."""
    operations = [OPERATORS[sign] for sign in signs]
    weight = len(operations)
    if weight == 1:
        only = operations[0]

        def pair(x: ScriptRun, a: Value, b: Value) -> Value:
            return only(a, b)

        return compose(operands, pair)
    if any(operand.slow for operand in operands):

        def combine(x: ScriptRun, first: Value, *others: Value) -> Value:
            for operation, other in zip(operations, others, strict=True):
                first = operation(first, other)
            return first

        return compose(operands, combine, weight=weight)
    head = operands[0].run
    steps = [(sign, code.run) for sign, code in zip(operations, operands[1:], strict=True)]

    def run(x: ScriptRun, v: Frame) -> Value:
        value = head(x, v)
        for operation, operand in steps:
            value = operation(value, operand(x, v))
        return value

    return Code(run, False, weight + sum(operand.weight for operand in operands))


def logic(operands: list[Code], signs: list[str]) -> Code:
    """`and`, `or` and `xor` from left to right; what cannot matter is not looked at."""
    weight = sum(operand.weight for operand in operands)
    parts = list(zip(signs, operands[1:], strict=True))
    first = operands[0]
    head, quick = first.run, [(sign, code.run) for sign, code in parts]
    if not any(operand.slow for operand in operands):

        def at_once(x: ScriptRun, v: Frame) -> bool:
            value = truth(head(x, v))
            for sign, part in quick:
                if sign == "xor":
                    value = value != truth(part(x, v))
                elif value is (sign == "and"):
                    value = truth(part(x, v))
            return value

        return Code(at_once, False, weight)

    def waiting(x: ScriptRun, v: Frame) -> Routine:
        value = truth((yield from first.wait(x, v)) if first.slow else head(x, v))
        for sign, part in parts:
            if sign == "xor" or value is (sign == "and"):
                other = truth((yield from part.wait(x, v)) if part.slow else part.run(x, v))
                value = value != other if sign == "xor" else other
        return value

    return Code(waiting, True, weight)
