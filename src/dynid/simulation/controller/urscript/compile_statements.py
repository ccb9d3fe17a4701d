"""From the tree of statements to code."""

from __future__ import annotations

from typing import Any

from dynid.core.errors import DynidError
from dynid.simulation.controller.urscript.access import store
from dynid.simulation.controller.urscript.code import Code, Runner, compose
from dynid.simulation.controller.urscript.compile_expressions import Scope
from dynid.simulation.controller.urscript.errors import ScriptError, ScriptFault, ScriptHalt
from dynid.simulation.controller.urscript.execution import Execution, Frame
from dynid.simulation.controller.urscript.syntax import (
    Assign,
    Do,
    If,
    OnThread,
    Return,
    Simple,
    Statement,
    While,
)
from dynid.simulation.controller.urscript.values import Value, truth

BREAK, CONTINUE = "break", "continue"
"""What a block answers when a loop is to end or to go on; a tuple is a return value."""
_RAW = (ArithmeticError, TypeError, ValueError, IndexError)


def block(scope: Scope, statements: list[Statement], *, in_loop: bool, extra: int = 0) -> Code:
    """Compile a block.

    Args:
        scope: What it can see.
        statements: The statements.
        in_loop: Whether `break` and `continue` make sense.
        extra: Operations to count besides those of the statements.

    Raises:
        ScriptError: An unknown name, arguments that do not fit, or `break` outside a loop.
    """
    codes = [_statement(scope, statement, in_loop) for statement in statements]
    lines = [statement.line for statement in statements]
    weight = 1 + extra + sum(code.weight for code in codes)
    slow = any(code.slow for code in codes)
    return Code(_waiting(codes, lines, weight) if slow else _at_once(codes, lines, weight), slow, 0)


def _at_once(codes: list[Code], lines: list[int], weight: int) -> Runner:
    steps = [(code.run, line) for code, line in zip(codes, lines, strict=True)]

    def run(x: Execution, v: Frame) -> Any:
        x.left -= weight
        if x.left < 0:
            x.exhausted()
        line = 0
        try:
            for step, line in steps:
                signal = step(x, v)
                if signal is not None:
                    return signal
        except _RAW as error:
            raise _located(error, line) from error
        except DynidError as error:
            if _is_located(error):
                raise
            raise _located(error, line) from error
        return None

    return run


def _waiting(codes: list[Code], lines: list[int], weight: int) -> Runner:
    steps = [(code.run, code.slow, line) for code, line in zip(codes, lines, strict=True)]

    def run(x: Execution, v: Frame) -> Any:
        x.left -= weight
        if x.left < 0:
            x.exhausted()
        line = 0
        try:
            for step, waits, line in steps:
                signal = (yield from step(x, v)) if waits else step(x, v)
                if signal is not None:
                    return signal
        except _RAW as error:
            raise _located(error, line) from error
        except DynidError as error:
            if _is_located(error):
                raise
            raise _located(error, line) from error
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


def _statement(scope: Scope, statement: Statement, in_loop: bool) -> Code:
    if isinstance(statement, Do):
        return _for_effect(scope.expression(statement.expression))
    if isinstance(statement, Assign):
        return _assign(scope, statement)
    if isinstance(statement, If):
        return _if(scope, statement, in_loop)
    if isinstance(statement, While):
        return _while(scope, statement)
    if isinstance(statement, Return):
        if statement.value is None:
            return Code(lambda x, v: (None,), False, 1)
        return compose([scope.kept(statement.value)], lambda x, value: (value,))
    if isinstance(statement, OnThread):
        return _on_thread(scope, statement)
    if isinstance(statement, Simple):
        return _simple(statement, in_loop)
    raise TypeError(statement)


def _for_effect(code: Code) -> Code:
    inner = code.run
    if code.slow:

        def waiting(x: Execution, v: Frame) -> Any:
            yield from inner(x, v)

        return Code(waiting, True, code.weight)

    def at_once(x: Execution, v: Frame) -> None:
        inner(x, v)

    return Code(at_once, False, code.weight)


def _assign(scope: Scope, statement: Assign) -> Code:
    name, value = statement.name, scope.kept(statement.value)
    local = name in scope.own and statement.scope != "global"
    place = scope.own[name] if local else scope.shared[name]
    if statement.indices:
        base = scope.expression_named(name, statement.line)
        indices = [scope.expression(index) for index in statement.indices]

        def change(x: Execution, value: Value, base: Value, *indices: Value) -> None:
            store(base, list(indices), value)

        return compose([value, base, *indices], change)
    inner, slow = value.run, value.slow
    if slow:

        def waiting(x: Execution, v: Frame) -> Any:
            result = yield from inner(x, v)
            (v if local else x.shared)[place] = _something(result, name)

        return Code(waiting, True, value.weight + 1)
    if local:

        def own(x: Execution, v: Frame) -> None:
            result = inner(x, v)
            v[place] = result if result is not None else _something(result, name)

        return Code(own, False, value.weight + 1)

    def shared(x: Execution, v: Frame) -> None:
        result = inner(x, v)
        x.shared[place] = result if result is not None else _something(result, name)

    return Code(shared, False, value.weight + 1)


def _something(value: Value, name: str) -> Value:
    if value is None:
        raise ScriptFault(f"'{name}' gets no value: the function returns nothing")
    return value


def _if(scope: Scope, statement: If, in_loop: bool) -> Code:
    branches = [
        (scope.expression(condition), block(scope, body, in_loop=in_loop))
        for condition, body in statement.branches
    ]
    otherwise = block(scope, statement.otherwise, in_loop=in_loop)
    weight = sum(condition.weight for condition, _ in branches)
    parts = [(condition.run, body.run) for condition, body in branches]
    waits = [(condition.slow, body.slow) for condition, body in branches]
    last, last_slow = otherwise.run, otherwise.slow
    if not last_slow and not any(a or b for a, b in waits):

        def at_once(x: Execution, v: Frame) -> Any:
            for condition, body in parts:
                if truth(condition(x, v)):
                    return body(x, v)
            return last(x, v)

        return Code(at_once, False, weight)

    def waiting(x: Execution, v: Frame) -> Any:
        for (condition, body), (slow_condition, slow_body) in zip(parts, waits, strict=True):
            held = (yield from condition(x, v)) if slow_condition else condition(x, v)
            if truth(held):
                return (yield from body(x, v)) if slow_body else body(x, v)
        return (yield from last(x, v)) if last_slow else last(x, v)

    return Code(waiting, True, weight)


def _while(scope: Scope, statement: While) -> Code:
    condition = scope.expression(statement.condition)
    body = block(scope, statement.body, in_loop=True, extra=condition.weight)
    ask, ask_slow, do, do_slow = condition.run, condition.slow, body.run, body.slow
    if not ask_slow and not do_slow:

        def at_once(x: Execution, v: Frame) -> Any:
            while truth(ask(x, v)):
                signal = do(x, v)
                if signal is BREAK:
                    break
                if signal is not None and signal is not CONTINUE:
                    return signal
            return None

        return Code(at_once, False, condition.weight)

    def waiting(x: Execution, v: Frame) -> Any:
        while truth((yield from ask(x, v)) if ask_slow else ask(x, v)):
            signal = (yield from do(x, v)) if do_slow else do(x, v)
            if signal is BREAK:
                break
            if signal is not None and signal is not CONTINUE:
                return signal
        return None

    return Code(waiting, True, condition.weight)


def _on_thread(scope: Scope, statement: OnThread) -> Code:
    handle = scope.expression(statement.handle)
    if statement.word == "kill":
        return compose([handle], lambda x, value: x.kill(value))
    if not scope.may_wait:
        raise ScriptError("a secondary program must not take time", statement.line, value="join")

    def wait(x: Execution, value: Value) -> Any:
        while x.lives(value):
            yield

    return compose([handle], wait, slow=True)


def _simple(statement: Simple, in_loop: bool) -> Code:
    word = statement.word
    if word in (BREAK, CONTINUE):
        if not in_loop:
            raise ScriptError(f"'{word}' outside a loop", statement.line)
        signal = BREAK if word == BREAK else CONTINUE
        return Code(lambda x, v: signal, False, 1)
    if word == "halt":
        return Code(_halt, False, 1)
    if word == "enter_critical":
        return Code(lambda x, v: x.hold(), False, 1)
    return Code(lambda x, v: x.let_go(), False, 1)


def _halt(x: Execution, v: Frame) -> None:
    raise ScriptHalt
