"""Chains of operators: sums, products, comparisons and logic."""

from __future__ import annotations

from dynid.simulation.controller.urscript.code import Code, compose
from dynid.simulation.controller.urscript.execution import Execution, Frame, Routine
from dynid.simulation.controller.urscript.values import OPERATORS, Value, truth

LOGIC = ("and", "or", "xor")
"""Operators on truth values."""


def arithmetic(operands: list[Code], signs: list[str]) -> Code:
    """Operators of one rank, from left to right.

    Args:
        operands: One more than signs.
        signs: The operators.
    """
    operations = [OPERATORS[sign] for sign in signs]
    weight = len(operations)
    if weight == 1:
        only = operations[0]

        def pair(x: Execution, a: Value, b: Value) -> Value:
            return only(a, b)

        return compose(operands, pair)
    if any(operand.slow for operand in operands):

        def combine(x: Execution, first: Value, *others: Value) -> Value:
            for operation, other in zip(operations, others, strict=True):
                first = operation(first, other)
            return first

        return compose(operands, combine, weight=weight)
    head = operands[0].run
    steps = [(sign, code.run) for sign, code in zip(operations, operands[1:], strict=True)]

    def run(x: Execution, v: Frame) -> Value:
        value = head(x, v)
        for operation, operand in steps:
            value = operation(value, operand(x, v))
        return value

    return Code(run, False, weight + sum(operand.weight for operand in operands))


def logic(operands: list[Code], signs: list[str]) -> Code:
    """`and`, `or` and `xor` from left to right; what cannot matter is not looked at.

    Args:
        operands: One more than signs.
        signs: The operators.
    """
    weight = sum(operand.weight for operand in operands)
    parts = list(zip(signs, operands[1:], strict=True))
    first = operands[0]
    head, quick = first.run, [(sign, code.run) for sign, code in parts]
    if not any(operand.slow for operand in operands):

        def at_once(x: Execution, v: Frame) -> bool:
            value = truth(head(x, v))
            for sign, part in quick:
                if sign == "xor":
                    value = value != truth(part(x, v))
                elif value is (sign == "and"):
                    value = truth(part(x, v))
            return value

        return Code(at_once, False, weight)

    def waiting(x: Execution, v: Frame) -> Routine:
        value = truth((yield from first.wait(x, v)) if first.slow else head(x, v))
        for sign, part in parts:
            if sign == "xor" or value is (sign == "and"):
                other = truth((yield from part.wait(x, v)) if part.slow else part.run(x, v))
                value = value != other if sign == "xor" else other
        return value

    return Code(waiting, True, weight)
