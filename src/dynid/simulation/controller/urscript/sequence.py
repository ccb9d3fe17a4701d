"""Statements one after another: what they cost, and in which line one failed."""

from __future__ import annotations

from typing import Any

from dynid.core import DynidError
from dynid.simulation.controller.urscript.code import Code, Runner
from dynid.simulation.controller.urscript.errors import ScriptFault
from dynid.simulation.controller.urscript.execution import Execution, Frame, Routine

_RAW = (ArithmeticError, TypeError, ValueError, IndexError)


def sequence(codes: list[Code], lines: list[int], weight: int) -> Code:
    """Code that runs statements in order, until one answers with a signal.

    Args:
        codes: The statements.
        lines: Their lines.
        weight: Operations that one pass costs.
    """
    slow = any(code.slow for code in codes)
    return Code((_waiting if slow else _at_once)(codes, lines, weight), slow, 0)


def _at_once(codes: list[Code], lines: list[int], weight: int) -> Runner:
    steps = [code.run for code in codes]

    def run(x: Execution, v: Frame) -> Any:
        x.left -= weight
        if x.left < 0:
            x.exhausted()
        done = 0
        try:
            for step in steps:
                signal = step(x, v)
                if signal is not None:
                    return signal
                done += 1
        except _RAW as error:
            raise _located(error, lines[done]) from error
        except DynidError as error:
            if _is_located(error):
                raise
            raise _located(error, lines[done]) from error
        return None

    return run


def _waiting(codes: list[Code], lines: list[int], weight: int) -> Runner:
    steps = [(code.run, code.wait, code.slow) for code in codes]

    def run(x: Execution, v: Frame) -> Routine:
        x.left -= weight
        if x.left < 0:
            x.exhausted()
        done = 0
        try:
            for step, wait, waits in steps:
                signal = (yield from wait(x, v)) if waits else step(x, v)
                if signal is not None:
                    return signal
                done += 1
        except _RAW as error:
            raise _located(error, lines[done]) from error
        except DynidError as error:
            if _is_located(error):
                raise
            raise _located(error, lines[done]) from error
        return None

    return run


def _is_located(error: DynidError) -> bool:
    return isinstance(error, ScriptFault) and error.where is not None


def _located(error: Exception, line: int) -> ScriptFault:
    if isinstance(error, DynidError):
        return ScriptFault(
            error.what,
            where=f"line {line}",
            value=error.value,
            limit=error.limit,
            next_step=error.next_step,
        )
    text = "division by zero" if isinstance(error, ZeroDivisionError) else str(error)
    return ScriptFault(text, where=f"line {line}")
