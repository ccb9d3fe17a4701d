"""From the syntax tree of statements to code."""

from itertools import accumulate
from typing import Any, NoReturn

from dynid.core import DynidError
from urtwin.urscript.code import Code, Runner, compose
from urtwin.urscript.execution import BACK, ENTERING, LISTENING, Frame, Routine, ScriptRun
from urtwin.urscript.expressions import Scope, store
from urtwin.urscript.syntax import Assign, Do, If, OnThread, Return, Simple, Statement, While
from urtwin.urscript.values import ScriptError, ScriptFault, ScriptHalt, Value, truth

_FAULTS = (DynidError, ArithmeticError, TypeError, ValueError, IndexError)


def _at_once(codes: list[Code], lines: list[int], weight: int) -> Runner:
    steps = [code.run for code in codes]

    def run(x: ScriptRun, v: Frame) -> Any:
        x.left -= weight
        if x.left < 0:
            x.look()
        done = 0
        try:
            for step in steps:
                signal = step(x, v)
                if signal is not None:
                    return signal
                done += 1
        except _FAULTS as error:
            _locate(error, lines[done])
        return None

    return run


def _waiting(codes: list[Code], lines: list[int], weight: int) -> Runner:
    steps = [(code.run, code.wait, code.slow) for code in codes]

    def run(x: ScriptRun, v: Frame) -> Routine:
        x.left -= weight
        if x.left < 0:
            x.look()
        done = 0
        try:
            for step, wait, waits in steps:
                signal = (yield from wait(x, v)) if waits else step(x, v)
                if signal is not None:
                    return signal
                done += 1
        except _FAULTS as error:
            _locate(error, lines[done])
        return None

    return run


def _locate(error: Exception, line: int) -> NoReturn:
    """Raise an error again as a fault of its line; one that names its place stays as it is."""
    if isinstance(error, ScriptFault) and error.where is not None:
        raise error
    where = f"line {line}"
    if isinstance(error, DynidError):
        step = error.next_step
        raise ScriptFault(
            error.what, where=where, value=error.value, limit=error.limit, next_step=step
        ) from error
    text = "division by zero" if isinstance(error, ZeroDivisionError) else str(error)
    raise ScriptFault(text, where=where) from error


BREAK, CONTINUE = "break", "continue"
"""What a block answers when a loop is to end or to go on; a tuple is a return value."""


def block(scope: Scope, statements: list[Statement], *, in_loop: bool, extra: int = 0) -> Code:
    """Compile a block: it runs in order, until a statement answers with a signal.

    `break` and `continue` make sense `in_loop` alone; `extra` operations count besides those of
    the statements.

    Raises:
        ScriptError: An unknown name, arguments that do not fit, or `break` outside a loop.
    """
    codes = [_statement(scope, statement, in_loop) for statement in statements]
    lines = [statement.line for statement in statements]
    weight = 1 + extra + sum(code.weight for code in codes)
    slow = any(code.slow for code in codes)
    return Code((_waiting if slow else _at_once)(codes, lines, weight), slow, 0)


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
        return compose([scope.kept(statement.value)], _returned)
    if isinstance(statement, OnThread):
        return _on_thread(scope, statement)
    if isinstance(statement, Simple):
        return _simple(scope, statement, in_loop)
    raise TypeError(statement)


def _returned(x: ScriptRun, value: Value) -> tuple[Value]:
    return (value,)


def _for_effect(code: Code) -> Code:
    inner, wait = code.run, code.wait
    if code.slow:

        def waiting(x: ScriptRun, v: Frame) -> Routine:
            yield from wait(x, v)

        return Code(waiting, True, code.weight)

    def at_once(x: ScriptRun, v: Frame) -> None:
        inner(x, v)

    return Code(at_once, False, code.weight)


def _assign(scope: Scope, statement: Assign) -> Code:
    name, value = statement.name, scope.kept(statement.value)
    local = name in scope.own and statement.scope != "global"
    place = scope.own[name] if local else scope.shared[name]
    if statement.indices:
        base = scope.expression_named(name, statement.line)
        indices = [scope.expression(index) for index in statement.indices]

        def change(x: ScriptRun, value: Value, base: Value, *indices: Value) -> None:
            store(base, list(indices), value)

        return compose([value, base, *indices], change)
    inner, wait = value.run, value.wait
    if value.slow:

        def waiting(x: ScriptRun, v: Frame) -> Routine:
            result = yield from wait(x, v)
            (v if local else x.shared)[place] = _something(result, name)

        return Code(waiting, True, value.weight + 1)
    if local:

        def own(x: ScriptRun, v: Frame) -> None:
            result = inner(x, v)
            v[place] = result if result is not None else _something(result, name)

        return Code(own, False, value.weight + 1)

    def shared(x: ScriptRun, v: Frame) -> None:
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
    # A chain of conditions costs what is looked at, not all of it.
    costs = list(accumulate(condition.weight for condition, _ in branches))
    parts = [(cost, ask.run, body.run) for cost, (ask, body) in zip(costs, branches, strict=True)]
    whole = costs[-1]
    last = otherwise.run
    if not otherwise.slow and not any(ask.slow or body.slow for ask, body in branches):

        def at_once(x: ScriptRun, v: Frame) -> Any:
            for cost, condition, body in parts:
                if truth(condition(x, v)):
                    x.left -= cost
                    return body(x, v)
            x.left -= whole
            return last(x, v)

        return Code(at_once, False, 1)

    def waiting(x: ScriptRun, v: Frame) -> Routine:
        for ask, body in branches:
            x.left -= ask.weight
            if truth((yield from ask.wait(x, v)) if ask.slow else ask.run(x, v)):
                return (yield from body.wait(x, v)) if body.slow else body.run(x, v)
        return (yield from otherwise.wait(x, v)) if otherwise.slow else last(x, v)

    return Code(waiting, True, 1)


def _while(scope: Scope, statement: While) -> Code:
    condition = scope.expression(statement.condition)
    body = block(scope, statement.body, in_loop=True, extra=condition.weight)
    ask, do = condition.run, body.run
    if not condition.slow and not body.slow:

        def at_once(x: ScriptRun, v: Frame) -> Any:
            while truth(ask(x, v)):
                signal = do(x, v)
                if signal is BREAK:
                    break
                if signal is not None and signal is not CONTINUE:
                    return signal
            return None

        return Code(at_once, False, condition.weight)

    ask_wait, do_wait, ask_slow, do_slow = condition.wait, body.wait, condition.slow, body.slow

    def waiting(x: ScriptRun, v: Frame) -> Routine:
        while truth((yield from ask_wait(x, v)) if ask_slow else ask(x, v)):
            signal = (yield from do_wait(x, v)) if do_slow else do(x, v)
            if signal is BREAK:
                break
            if signal is not None and signal is not CONTINUE:
                return signal
        return None

    return Code(waiting, True, condition.weight)


def _on_thread(scope: Scope, statement: OnThread) -> Code:
    handle = scope.expression(statement.handle)
    if statement.word == "kill":
        return compose([handle], ScriptRun.kill)
    if not scope.may_wait:
        raise ScriptError("a secondary program must not take time", statement.line, value="join")

    def wait(x: ScriptRun, value: Value) -> Routine:
        # Whoever joins in a critical section lets others have it: they could not end else.
        waited = False
        while x.lives(value):
            waited = True
            yield LISTENING
        if waited:
            yield BACK

    return compose([handle], wait, slow=True)


def _simple(scope: Scope, statement: Simple, in_loop: bool) -> Code:
    word = statement.word
    if word in (BREAK, CONTINUE):
        if not in_loop:
            raise ScriptError(f"'{word}' outside a loop", statement.line)
        signal = BREAK if word == BREAK else CONTINUE
        return Code(lambda x, v: signal, False, 1)
    if word == "halt":
        return Code(_halt, False, 1)
    if word == "enter_critical":
        return (
            Code(_enter, True, 1)
            if scope.may_wait
            else Code(lambda x, v: x.section.enter(x.thread), False, 1)
        )
    return Code(lambda x, v: x.section.leave(), False, 1)


def _enter(x: ScriptRun, v: Frame) -> Routine:
    if x.section.open_to(x.thread):
        x.section.enter(x.thread)
    else:
        yield ENTERING


def _halt(x: ScriptRun, v: Frame) -> None:
    raise ScriptHalt
