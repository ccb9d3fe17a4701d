"""Which names a script defines, where they live, and which functions take time.

A name belongs to the program if the program's own body assigns it or anyone declares it
`global`; functions and threads see these. All other names are their function's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from dynid.simulation.controller.urscript.builtin import Builtin, Kind
from dynid.simulation.controller.urscript.errors import ScriptError
from dynid.simulation.controller.urscript.syntax import (
    Assign,
    Call,
    Chain,
    Definition,
    Do,
    Expression,
    If,
    Index,
    ListOf,
    Method,
    OnThread,
    Return,
    Run,
    Simple,
    Statement,
    Unary,
    While,
)

MAX_VARIABLES = 2_000
"""Most variables of a program or a function."""


@dataclass(slots=True)
class Names:
    """The definitions of one program."""

    own_functions: dict[str, Definition] = field(default_factory=dict[str, Definition])
    """What it defines itself, in the order of the text."""
    functions: frozenset[str] = frozenset()
    """All functions, also those of the program that it is added to."""
    shared: dict[str, int] = field(default_factory=dict[str, int])
    """Program variables and their places."""
    slow: set[str] = field(default_factory=set[str])
    """Functions that take time."""


def names_of(
    program: Definition, builtins: Mapping[str, Builtin], outer: Names | None = None
) -> Names:
    """What a program defines.

    Args:
        program: The program, or statements that are added to one.
        builtins: The functions that it may call besides its own.
        outer: What the program defines to which these statements are added.

    Raises:
        ScriptError: A name defined twice, or too many variables.
    """
    before = outer or Names()
    names = Names(shared=dict(before.shared))
    _collect(program, names)
    names.functions = before.functions | names.own_functions.keys()
    for statement in walk(program.body):
        if isinstance(statement, Assign) and statement.scope != "local":
            names.shared.setdefault(statement.name, len(names.shared))
    for definition in names.own_functions.values():
        for statement in walk(definition.body):
            if isinstance(statement, Assign) and statement.scope == "global":
                names.shared.setdefault(statement.name, len(names.shared))
    if len(names.shared) > MAX_VARIABLES:
        raise ScriptError("too many variables", program.line, limit=MAX_VARIABLES)
    names.slow = _slow(names, builtins, before.slow - names.own_functions.keys())
    return names


def own_variables(definition: Definition, names: Names) -> dict[str, int]:
    """Variables of one function and their places, parameters first.

    Raises:
        ScriptError: Too many variables.
    """
    own = {name: place for place, name in enumerate(definition.parameters)}
    for statement in walk(definition.body):
        if isinstance(statement, Assign):
            elsewhere = statement.scope != "local" and statement.name in names.shared
            if statement.scope != "global" and not elsewhere:
                own.setdefault(statement.name, len(own))
    if len(own) > MAX_VARIABLES:
        raise ScriptError("too many variables", definition.line, limit=MAX_VARIABLES)
    return own


def walk(block: list[Statement]) -> Iterator[Statement]:
    """All statements of a block, nested ones too."""
    for statement in block:
        yield statement
        if isinstance(statement, If):
            for _, body in statement.branches:
                yield from walk(body)
            yield from walk(statement.otherwise)
        elif isinstance(statement, While):
            yield from walk(statement.body)


def calls(expression: Expression) -> Iterator[Call]:
    """All calls in an expression; starting a thread is none."""
    if isinstance(expression, Call):
        yield expression
        parts = [*expression.positional, *expression.named.values()]
    elif isinstance(expression, Run):
        parts = [*expression.call.positional, *expression.call.named.values()]
    elif isinstance(expression, Chain):
        parts = [expression.first, *(part for _, part in expression.rest)]
    elif isinstance(expression, Method):
        parts = [expression.base, *expression.arguments]
    elif isinstance(expression, Unary):
        parts = [expression.operand]
    elif isinstance(expression, ListOf):
        parts = expression.items
    elif isinstance(expression, Index):
        parts = [expression.base, *expression.indices]
    else:
        return
    for part in parts:
        yield from calls(part)


def expressions(statement: Statement) -> list[Expression]:
    """The expressions of a statement itself, without those of its blocks."""
    if isinstance(statement, Do):
        return [statement.expression]
    if isinstance(statement, Assign):
        return [*statement.indices, statement.value]
    if isinstance(statement, If):
        return [condition for condition, _ in statement.branches]
    if isinstance(statement, While):
        return [statement.condition]
    if isinstance(statement, Return):
        return [] if statement.value is None else [statement.value]
    return [statement.handle] if isinstance(statement, OnThread) else []


def _collect(definition: Definition, names: Names) -> None:
    for inner in definition.inner:
        if inner.name in names.own_functions:
            raise ScriptError("defined twice", inner.line, value=inner.name)
        names.own_functions[inner.name] = inner
        _collect(inner, names)


def _slow(names: Names, builtins: Mapping[str, Builtin], known_slow: set[str]) -> set[str]:
    callers: dict[str, set[str]] = {}
    found = list(known_slow)
    for name, definition in names.own_functions.items():
        for statement in walk(definition.body):
            waits = (isinstance(statement, OnThread) and statement.word == "join") or (
                isinstance(statement, Simple) and statement.word == "enter_critical"
            )
            for call in (call for part in expressions(statement) for call in calls(part)):
                callers.setdefault(call.name, set()).add(name)
                known = None if call.name in names.functions else builtins.get(call.name)
                waits = waits or (known is not None and known.kind == Kind.BLOCKING)
            if waits:
                found.append(name)
    slow: set[str] = set()
    while found:
        name = found.pop()
        if name not in slow:
            slow.add(name)
            found.extend(callers.get(name, ()))
    return slow
