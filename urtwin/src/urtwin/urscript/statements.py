"""From the syntax tree of statements to code."""

from typing import Any, NoReturn

from dynid.core import DynidError
from urtwin.urscript.execution import BACK, ENTERING, LISTENING, Frame, ScriptRun
from urtwin.urscript.expressions import Combine, Runner, Scope, compose, store
from urtwin.urscript.syntax import Assign, Control, Expression, If, Node, Variable, While
from urtwin.urscript.values import ScriptError, ScriptFault, ScriptHalt, Value, truth

_FAULTS = (DynidError, ArithmeticError, TypeError, ValueError, IndexError)


def _in_order(steps: list[Runner], lines: list[int]) -> Runner:
    def run(x: ScriptRun, v: Frame) -> Any:
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


def _locate(error: Exception, line: int) -> NoReturn:
    """Raise an error again as a fault of its line; one that names its place stays as it is."""
    if isinstance(error, ScriptFault) and error.where is not None:
        raise error
    where = f"line {line}"
    if isinstance(error, DynidError):
        raise ScriptFault(**error.facts | {"where": where}) from error
    text = "division by zero" if isinstance(error, ZeroDivisionError) else str(error)
    raise ScriptFault(text, where=where) from error


BREAK, CONTINUE = "break", "continue"
"""What a block answers when a loop is to end or to go on; a tuple is a return value."""


def block(scope: Scope, statements: list[Node], *, in_loop: bool) -> Runner:
    """Compile a block: it runs in order, until a statement answers with a signal.

    `break` and `continue` make sense `in_loop` alone: elsewhere they are a `ScriptError`.
    """
    steps = [_statement(scope, statement, in_loop) for statement in statements]
    return _in_order(steps, [statement.line for statement in statements])


def _statement(scope: Scope, statement: Node, in_loop: bool) -> Runner:
    if isinstance(statement, Expression):
        return _for_effect(scope.expression(statement))
    if isinstance(statement, Assign):
        return _assign(scope, statement)
    if isinstance(statement, If):
        return _if(scope, statement, in_loop)
    if isinstance(statement, While):
        return _while(scope, statement)
    if isinstance(statement, Control):
        return _control(scope, statement, in_loop)
    raise TypeError(statement)


def _for_effect(inner: Runner) -> Runner:
    def run(x: ScriptRun, v: Frame) -> None:
        inner(x, v)

    return run


def _assign(scope: Scope, statement: Assign) -> Runner:
    name, value = statement.name, scope.kept(statement.value)
    local = name in scope.own and statement.scope != "global"
    place = scope.own[name] if local else scope.shared[name]
    if statement.indices:
        base = scope.expression(Variable(statement.line, name))
        indices = [scope.expression(index) for index in statement.indices]

        def change(x: ScriptRun, value: Value, base: Value, *indices: Value) -> None:
            store(base, list(indices), value)

        return compose([value, base, *indices], change)

    def run(x: ScriptRun, v: Frame) -> None:
        result = value(x, v)
        if result is None:
            raise ScriptFault(f"'{name}' gets no value: the function returns nothing")
        (v if local else x.shared)[place] = result

    return run


def _if(scope: Scope, statement: If, in_loop: bool) -> Runner:
    branches = [
        (scope.expression(condition), block(scope, body, in_loop=in_loop))
        for condition, body in statement.branches
    ]
    otherwise = block(scope, statement.otherwise, in_loop=in_loop)

    def run(x: ScriptRun, v: Frame) -> Any:
        for condition, body in branches:
            if truth(condition(x, v)):
                return body(x, v)
        return otherwise(x, v)

    return run


def _while(scope: Scope, statement: While) -> Runner:
    condition = scope.expression(statement.condition)
    body = block(scope, statement.body, in_loop=True)

    def run(x: ScriptRun, v: Frame) -> Any:
        while truth(condition(x, v)):
            signal = body(x, v)
            if signal is BREAK:
                break
            if signal is not None and signal is not CONTINUE:
                return signal
        return None

    return run


def _join(x: ScriptRun, handle: Value) -> None:
    # Whoever joins in a critical section lets others have it: they could not end else.
    waited = False
    while x.lives(handle):
        waited = True
        x.wait(LISTENING)
    if waited:
        x.wait(BACK)


def _control(scope: Scope, statement: Control, in_loop: bool) -> Runner:
    word = statement.word
    if statement.value is not None:
        return compose([scope.kept(statement.value)], _WITH_VALUE[word])
    if word in (BREAK, CONTINUE) and not in_loop:
        raise ScriptError(f"'{word}' outside a loop", statement.line)
    return _ALONE[word]


def _enter(x: ScriptRun, v: Frame) -> None:
    if x.section.open_to(x.thread):
        x.section.enter(x.thread)
    else:
        x.wait(ENTERING)


def _halt(x: ScriptRun, v: Frame) -> None:
    raise ScriptHalt


def _returned(x: ScriptRun, value: Value) -> tuple[Value]:
    return (value,)


_ALONE: dict[str, Runner] = {
    BREAK: lambda x, v: BREAK,
    CONTINUE: lambda x, v: CONTINUE,
    "return": lambda x, v: (None,),
    "halt": _halt,
    "enter_critical": _enter,
    "exit_critical": lambda x, v: x.section.leave(),
}
_WITH_VALUE: dict[str, Combine] = {"return": _returned, "kill": ScriptRun.kill, "join": _join}
