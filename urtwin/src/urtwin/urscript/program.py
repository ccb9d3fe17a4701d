"""From text to a program that can run, and statements added to it (interpreter mode).

A name belongs to the program if the program's own body assigns it or anyone declares it
`global`; functions and threads see these. All other names are their function's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from urtwin.urscript import syntax
from urtwin.urscript.code import Code, Function
from urtwin.urscript.execution import Frame, Routine, ScriptRun
from urtwin.urscript.expressions import Scope
from urtwin.urscript.parser import parse
from urtwin.urscript.statements import block
from urtwin.urscript.values import Builtin, Calling, ScriptError

MAX_VARIABLES = 2_000
"""Most variables of a program or a function."""


@dataclass(slots=True)
class Names:
    """The definitions of one program."""

    own_functions: dict[str, syntax.Definition] = field(
        default_factory=dict[str, syntax.Definition]
    )
    """What it defines itself, in the order of the text."""
    functions: frozenset[str] = frozenset()
    """All functions, also those of the program that it is added to."""
    shared: dict[str, int] = field(default_factory=dict[str, int])
    """Program variables and their places."""
    slow: set[str] = field(default_factory=set[str])
    """Functions that take time."""


def names_of(
    program: syntax.Definition, builtins: Mapping[str, Builtin], outer: Names | None = None
) -> Names:
    """What a program defines, or statements that are added to one with the names `outer`.

    Raises:
        ScriptError: A name defined twice, or too many variables.
    """
    before = outer or Names()
    names = Names(shared=dict(before.shared))
    _collect(program, names)
    names.functions = before.functions | names.own_functions.keys()
    for statement in assignments(program.body):
        if statement.scope != "local":
            names.shared.setdefault(statement.name, len(names.shared))
    for definition in names.own_functions.values():
        for statement in assignments(definition.body):
            if statement.scope == "global":
                names.shared.setdefault(statement.name, len(names.shared))
    if len(names.shared) > MAX_VARIABLES:
        raise ScriptError("too many variables", program.line, limit=MAX_VARIABLES)
    names.slow = _slow(names, builtins, before.slow - names.own_functions.keys())
    return names


def own_variables(definition: syntax.Definition, names: Names) -> dict[str, int]:
    """Variables of one function and their places, parameters first.

    Raises:
        ScriptError: Too many variables.
    """
    own = {name: place for place, name in enumerate(definition.parameters)}
    for statement in assignments(definition.body):
        elsewhere = statement.scope != "local" and statement.name in names.shared
        if statement.scope != "global" and not elsewhere:
            own.setdefault(statement.name, len(own))
    if len(own) > MAX_VARIABLES:
        raise ScriptError("too many variables", definition.line, limit=MAX_VARIABLES)
    return own


def assignments(block: list[syntax.Statement]) -> Iterator[syntax.Assign]:
    """All assignments of a block, nested ones too."""
    return (
        node for node in syntax.nodes(block, syntax.Statement) if isinstance(node, syntax.Assign)
    )


def called_in(program: syntax.Definition) -> frozenset[str]:
    """The functions that the body of a program calls; starting a thread is no call."""
    nodes = syntax.nodes(program.body)
    return frozenset(node.name for node in nodes if type(node) is syntax.Call)


def _collect(definition: syntax.Definition, names: Names) -> None:
    for inner in definition.inner:
        if inner.name in names.own_functions:
            raise ScriptError("defined twice", inner.line, value=inner.name)
        names.own_functions[inner.name] = inner
        _collect(inner, names)


_WAITING = ("join", "enter_critical")


def _slow(names: Names, builtins: Mapping[str, Builtin], known_slow: set[str]) -> set[str]:
    callers: dict[str, set[str]] = {}
    found = list(known_slow)
    for name, definition in names.own_functions.items():
        waits = False
        for node in syntax.nodes(definition.body):
            if isinstance(node, syntax.OnThread | syntax.Simple):
                waits = waits or node.word in _WAITING
            elif isinstance(node, syntax.Call) and not isinstance(node, syntax.StartThread):
                callers.setdefault(node.name, set()).add(name)
                known = None if node.name in names.functions else builtins.get(node.name)
                waits = waits or (known is not None and known.kind == Calling.BLOCKING)
        if waits:
            found.append(name)
    slow: set[str] = set()
    while found:
        name = found.pop()
        if name not in slow:
            slow.add(name)
            found.extend(callers.get(name, ()))
    return slow


UNNAMED = "unnamed"
"""The name of a program that is a few statements without a `def`."""


@dataclass(frozen=True, slots=True)
class Context:
    """What a program knows; statements that are added to it while it runs know it too."""

    builtins: Mapping[str, Builtin]
    names: Names = field(default_factory=Names)
    functions: Mapping[str, Function] = field(default_factory=dict[str, Function])

    def compiled(self, main: syntax.Definition) -> CompiledProgram:
        """A program, or statements that are added to the one whose context this is.

        Raises:
            ScriptError: An unknown name, one that is defined twice, or too many variables.
        """
        names = names_of(main, self.builtins, self.names)
        functions = dict(self.functions)
        for name, definition in names.own_functions.items():
            own = own_variables(definition, names)
            functions[name] = Function(definition, name in names.slow, own)
        for function in (functions[name] for name in names.own_functions):
            scope = Scope(function.places, names.shared, functions, self.builtins, True)
            code = block(scope, function.definition.body, in_loop=False)
            # Whether it waits was worked out before its callers were compiled.
            function.code = code if code.slow == function.slow else _as_waiting(code)
        own, secondary = own_variables(main, names), main.kind == "sec"
        scope = Scope(own, names.shared, functions, self.builtins, not secondary)
        body = block(scope, main.body, in_loop=False)
        wider = Context(self.builtins, names, functions)
        return CompiledProgram(main.name, secondary, wider, len(own), body, called_in(main))


@dataclass(frozen=True, slots=True)
class CompiledProgram:
    """A compiled script, or statements for a running one; running it changes nothing in it."""

    name: str
    secondary: bool
    """Whether it runs beside the main program, without taking time (`sec`)."""
    context: Context
    """What it defines."""
    locals: int
    """How many variables of its body are declared `local`."""
    body: Code
    called: frozenset[str]
    """The functions that its body calls."""

    @property
    def variables(self) -> Mapping[str, int]:
        """Program variables and their places."""
        return self.context.names.shared

    def execution(self, port: Any) -> ScriptRun:
        """The program, ready for its first cycle; `port` is the controller, for the built-ins."""
        execution = ScriptRun(port, len(self.variables))
        execution.start(execution.new_thread(), self.routine(execution))
        return execution

    def routine(self, execution: ScriptRun) -> Routine:
        """What runs it."""
        frame: Frame = [None] * self.locals
        if self.body.slow:
            yield from self.body.wait(execution, frame)
        else:
            self.body.run(execution, frame)


def compile_script(text: str, builtins: Mapping[str, Builtin]) -> CompiledProgram:
    """Compile a script.

    A lone `def` is the program; of several the last one is. Statements outside any definition
    are a program of their own, which knows the definitions.

    Args:
        text: The script.
        builtins: The functions that it may call besides its own.

    Raises:
        ScriptError: It breaks the grammar, uses unknown names, or is too big.
    """
    script = parse(text)
    if script.statements:
        line = script.statements[0].line
        main = syntax.Definition(
            line, "def", UNNAMED, [], {}, script.statements, script.definitions
        )
    elif script.definitions:
        main = script.definitions[-1]
        main.inner = [*script.definitions[:-1], *main.inner]
    else:
        raise ScriptError("the script is empty", 1)
    if main.kind == "thread":
        raise ScriptError("a thread is no program", main.line, value=main.name)
    if main.parameters:
        raise ScriptError("a program takes no arguments", main.line, value=main.parameters)
    return Context(builtins).compiled(main)


def _as_waiting(code: Code) -> Code:
    def run(x: ScriptRun, v: Frame) -> Any:
        return code.run(x, v)
        yield  # makes it a generator function

    return Code(run, True, code.weight)


MAX_FUNCTIONS = 2_000
"""Most functions of a program and of what is added to it."""


def compile_addition(text: str, context: Context) -> CompiledProgram:
    """Compile statements in the scope of a running program.

    Definitions stay for the statements after these; a variable is the interpreter's own where the
    program has none of its name.

    Args:
        text: The statements.
        context: What the program knows so far.

    Raises:
        ScriptError: They break the grammar, use unknown names, or declare a new global variable.
    """
    script = parse(text)
    if not script.statements and not script.definitions:
        raise ScriptError("the statement is empty", 1)
    main = syntax.Definition(1, "def", UNNAMED, [], {}, script.statements, script.definitions)
    for statement in assignments([*main.body, *(part for x in main.inner for part in x.body)]):
        if statement.scope == "global" and statement.name not in context.names.shared:
            raise ScriptError(
                "no new global variable can be declared here", statement.line, value=statement.name
            )
    found = context.compiled(main)
    if len(found.context.functions) > MAX_FUNCTIONS:
        raise ScriptError("too many functions; clear_interpreter() forgets them", 1)
    return found
