"""Compiled code: composition of values, calls of the script's own functions, operator chains."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Concatenate

from urtwin.urscript.execution import Frame, ScriptRun
from urtwin.urscript.syntax import Definition
from urtwin.urscript.values import OPERATORS, Value, truth

Runner = Callable[[ScriptRun, Frame], Any]
"""Gives a value; where the code takes time, other threads run meanwhile."""
Combine = Callable[Concatenate[ScriptRun, ...], Any]
"""Takes the execution and the values of the operands."""


@dataclass(frozen=True, slots=True)
class Code:
    """A compiled expression or statement."""

    run: Runner
    weight: int
    """Operations that it costs at most, calls of one's own functions apart."""
    fresh: bool = True
    """Whether its value belongs to nobody yet, so that it need not be copied."""


def compose(operands: list[Code], combine: Combine, *, weight: int = 1) -> Code:
    """Code that combines the values of operands, which are evaluated in order.

    `weight` counts the operations of `combine`.
    """
    total = weight + sum(operand.weight for operand in operands)
    runs = [operand.run for operand in operands]
    if not runs:
        return Code(lambda x, v: combine(x), total)
    if len(runs) == 1:
        one = runs[0]
        return Code(lambda x, v: combine(x, one(x, v)), total)
    if len(runs) == 2:
        first, second = runs
        return Code(lambda x, v: combine(x, first(x, v), second(x, v)), total)
    return Code(lambda x, v: combine(x, *[run(x, v) for run in runs]), total)


@dataclass(slots=True)
class Function:
    """A `def` or `thread` of a script; its body is compiled after those who call it."""

    definition: Definition
    places: dict[str, int]
    """Its own variables."""
    code: Code = field(init=False)
    """Its body, once that is compiled."""

    def caller(self) -> Callable[..., Any]:
        """What a call does with the arguments."""
        blank: list[Value] = [None] * (len(self.places) - len(self.definition.parameters))

        def call(x: ScriptRun, *values: Value) -> Value:
            frame = [*values, *blank]
            x.enter(frame)
            signal = self.code.run(x, frame)
            x.leave()
            return signal[0] if signal.__class__ is tuple else None

        return call

    def starter(self) -> Callable[..., int]:
        """What `run` does with the arguments: it gives the handle of the new thread."""
        call = self.caller()

        def start(x: ScriptRun, *values: Value) -> int:
            return x.start(lambda: call(x, *values), self)

        return start


LOGIC = ("and", "or", "xor")
"""Operators on truth values."""


def arithmetic(operands: list[Code], signs: list[str]) -> Code:
    """Operators of one rank, from left to right, each between two of the operands."""
    operations = [OPERATORS[sign] for sign in signs]
    weight = len(operations) + sum(operand.weight for operand in operands)
    head, *others = [operand.run for operand in operands]
    if len(operations) == 1:
        only, other = operations[0], others[0]
        return Code(lambda x, v: only(head(x, v), other(x, v)), weight)
    steps = list(zip(operations, others, strict=True))

    def run(x: ScriptRun, v: Frame) -> Value:
        value = head(x, v)
        for operation, operand in steps:
            value = operation(value, operand(x, v))
        return value

    return Code(run, weight)


def logic(operands: list[Code], signs: list[str]) -> Code:
    """`and`, `or` and `xor` from left to right; what cannot matter is not looked at."""
    head, *others = [operand.run for operand in operands]
    parts = list(zip(signs, others, strict=True))

    def run(x: ScriptRun, v: Frame) -> bool:
        value = truth(head(x, v))
        for sign, part in parts:
            if sign == "xor":
                value = value != truth(part(x, v))
            elif value is (sign == "and"):
                value = truth(part(x, v))
        return value

    return Code(run, sum(operand.weight for operand in operands))
