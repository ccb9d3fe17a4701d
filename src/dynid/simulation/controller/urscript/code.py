"""Pieces of compiled code, and how values are gathered from expressions that may take time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Concatenate

from dynid.simulation.controller.urscript.execution import Execution, Frame, Routine

Runner = Callable[[Execution, Frame], Any]
"""Gives a value, or a generator that returns it where the code takes time."""
SlowRunner = Callable[[Execution, Frame], Routine]
Combine = Callable[Concatenate[Execution, ...], Any]
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
    """Code that combines the values of operands.

    Args:
        operands: What to evaluate first, in order.
        combine: What to do with the values.
        slow: Whether `combine` is a generator function.
        weight: Operations of `combine`.
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

    def run(x: Execution, v: Frame) -> Routine:
        values: list[Any] = []
        for part, wait, waits in parts:
            values.append((yield from wait(x, v)) if waits else part(x, v))
        result = combine(x, *values)
        if slow:
            routine: Routine = result
            return (yield from routine)
        return result

    return run
