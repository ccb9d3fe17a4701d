"""From the statements of a script to a program that can run, and statements added to it.

A name belongs to the program if the program's own body assigns it or anyone declares it
`global`; functions and threads see these. All other names are their function's own.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NoReturn

from dynid.core import DynidError
from urtwin.urscript import parser, syntax
from urtwin.urscript.execution import BACK, ENTERING, LISTENING, Frame, ScriptRun
from urtwin.urscript.expressions import Combine, Function, Runner, Scope, compose, store
from urtwin.urscript.values import Builtin, ScriptError, ScriptFault, ScriptHalt, Value, truth

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


def block(scope: Scope, statements: list[syntax.Node], *, in_loop: bool) -> Runner:
    """Compile a block: it runs in order, until a statement answers with a signal.

    `break` and `continue` make sense `in_loop` alone: elsewhere they are a `ScriptError`.
    """
    steps = [_statement(scope, statement, in_loop) for statement in statements]
    return _in_order(steps, [statement.line for statement in statements])


def _statement(scope: Scope, statement: syntax.Node, in_loop: bool) -> Runner:
    if isinstance(statement, syntax.Expression):
        return _for_effect(scope.expression(statement))
    if isinstance(statement, syntax.Assign):
        return _assign(scope, statement)
    if isinstance(statement, syntax.If):
        return _if(scope, statement, in_loop)
    if isinstance(statement, syntax.While):
        return _while(scope, statement)
    if isinstance(statement, syntax.Control):
        return _control(scope, statement, in_loop)
    raise TypeError(statement)


def _for_effect(inner: Runner) -> Runner:
    def run(x: ScriptRun, v: Frame) -> None:
        inner(x, v)

    return run


def _assign(scope: Scope, statement: syntax.Assign) -> Runner:
    name, value = statement.name, scope.kept(statement.value)
    local = name in scope.own and statement.scope != "global"
    place = scope.own[name] if local else scope.shared[name]
    if statement.indices:
        base = scope.expression(syntax.Variable(statement.line, name))
        indices = [scope.expression(index) for index in statement.indices]

        def change(x: ScriptRun, value: Value, base: Value, *indices: Value) -> None:
            store(base, list(indices), value)
            if value.__class__ is str:
                x.charge(value)

        return compose([value, base, *indices], change)

    def run(x: ScriptRun, v: Frame) -> None:
        result = value(x, v)
        if result is None:
            raise ScriptFault(f"'{name}' gets no value: the function returns nothing")
        (v if local else x.shared)[place] = result

    return run


def _if(scope: Scope, statement: syntax.If, in_loop: bool) -> Runner:
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


def _while(scope: Scope, statement: syntax.While) -> Runner:
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


def _control(scope: Scope, statement: syntax.Control, in_loop: bool) -> Runner:
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


MAX_VARIABLES = 2_000
"""Most variables of a program or a function."""
MAX_FUNCTIONS = 2_000
"""Most functions of a program and of what is added to it."""


def program_variables(
    program: syntax.Definition, definitions: Mapping[str, syntax.Definition], known: dict[str, int]
) -> dict[str, int]:
    """Variables of a program and their places; those that are `known` already keep theirs."""
    shared = dict(known)
    for statement in assignments(program.body):
        if statement.scope != "local":
            shared.setdefault(statement.name, len(shared))
    for definition in definitions.values():
        for statement in assignments(definition.body):
            if statement.scope == "global":
                shared.setdefault(statement.name, len(shared))
    if len(shared) > MAX_VARIABLES:
        raise ScriptError("too many variables", program.line, limit=MAX_VARIABLES)
    return shared


def own_variables(definition: syntax.Definition, shared: Mapping[str, int]) -> dict[str, int]:
    """Variables of one function and their places, parameters first."""
    own = {name: place for place, name in enumerate(definition.parameters)}
    for statement in assignments(definition.body):
        elsewhere = statement.scope != "local" and statement.name in shared
        if statement.scope != "global" and not elsewhere:
            own.setdefault(statement.name, len(own))
    if len(own) > MAX_VARIABLES:
        raise ScriptError("too many variables", definition.line, limit=MAX_VARIABLES)
    return own


def assignments(block: list[syntax.Node]) -> Iterator[syntax.Assign]:
    """All assignments of a block, nested ones too."""
    return (
        node for node in syntax.nodes(block, syntax.Statement) if isinstance(node, syntax.Assign)
    )


def called_in(program: syntax.Definition) -> frozenset[str]:
    """The functions that the body of a program calls; starting a thread is no call."""
    nodes = syntax.nodes(program.body)
    return frozenset(node.name for node in nodes if type(node) is syntax.Call)


def _collect(definition: syntax.Definition, found: dict[str, syntax.Definition]) -> None:
    """Add the definitions inside one, in the order of the text."""
    for inner in definition.inner:
        if inner.name in found:
            raise ScriptError("defined twice", inner.line, value=inner.name)
        found[inner.name] = inner
        _collect(inner, found)


@dataclass(frozen=True, slots=True)
class Context:
    """What a program knows; statements that are added to it while it runs know it too."""

    builtins: Mapping[str, Builtin]
    shared: dict[str, int] = field(default_factory=dict[str, int])
    """Program variables and their places."""
    functions: Mapping[str, Function] = field(default_factory=dict[str, Function])

    def compiled(self, main: syntax.Definition) -> "CompiledProgram":
        """A program, or statements that are added to the one whose context this is.

        Raises:
            ScriptError: An unknown name, one that is defined twice, too many variables, or a
                secondary program that takes time.
        """
        definitions: dict[str, syntax.Definition] = {}
        _collect(main, definitions)
        shared, functions = program_variables(main, definitions, self.shared), dict(self.functions)
        for name, definition in definitions.items():
            functions[name] = Function(definition, own_variables(definition, shared))
        wider = Context(self.builtins, shared, functions)
        for name, definition in definitions.items():
            functions[name].body = wider.code(definition, functions[name].places)
        own, secondary = own_variables(main, shared), main.kind == "sec"
        slow = wider.delay(main.body, set()) if secondary else None
        if slow is not None:
            word = slow.name if isinstance(slow, syntax.Call) else "join"
            raise ScriptError("a secondary program must not take time", slow.line, value=word)
        body = wider.code(main, own)
        return CompiledProgram(main.name, secondary, wider, len(own), body, called_in(main))

    def code(self, definition: syntax.Definition, own: Mapping[str, int]) -> Runner:
        """The body of a function or a program with its own variables."""
        scope = Scope(own, self.shared, self.functions, self.builtins)
        return block(scope, definition.body, in_loop=False)

    def delay(self, body: list[syntax.Node], seen: set[str]) -> syntax.Node | None:
        """The first part of a body that takes time; functions that were `seen` do not."""
        for node in syntax.nodes(body):
            waits = isinstance(node, syntax.Control) and node.word == "join"
            if isinstance(node, syntax.Call) and not isinstance(node, syntax.StartThread):
                function, known = self.functions.get(node.name), self.builtins.get(node.name)
                if function is None:
                    waits = known is not None and known.takes_time
                elif node.name not in seen:
                    seen.add(node.name)
                    waits = self.delay(function.definition.body, seen) is not None
            if waits:
                return node
        return None


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
    body: Runner
    called: frozenset[str]
    """The functions that its body calls."""

    def execution(self, port: Any) -> ScriptRun:
        """The program, ready for its first cycle; `port` is the controller, for the built-ins."""
        execution = ScriptRun(port, len(self.context.shared))
        execution.start(lambda: self.run(execution))
        return execution

    def run(self, execution: ScriptRun) -> None:
        """Run it to its end, in a thread of an execution."""
        frame: Frame = [None] * self.locals
        self.body(execution, frame)


def compile_script(text: str, builtins: Mapping[str, Builtin]) -> CompiledProgram:
    """Compile a script, which may call `builtins` besides its own functions.

    A lone `def` is the program; of several the last one is. Statements outside any definition
    are a program of their own, which knows the definitions.

    Raises:
        ScriptError: It breaks the grammar, uses unknown names, or is too big.
    """
    main = parser.parse(text)
    if not main.body:
        if not main.inner:
            raise ScriptError("the script is empty", 1)
        *others, main = main.inner
        main.inner = [*others, *main.inner]
    if main.kind == "thread":
        raise ScriptError("a thread is no program", main.line, value=main.name)
    if main.parameters:
        raise ScriptError("a program takes no arguments", main.line, value=main.parameters)
    return Context(builtins).compiled(main)


def compile_addition(text: str, context: Context) -> CompiledProgram:
    """Compile statements in the scope of a running program, its context so far.

    Definitions stay for the statements after these; a variable is the interpreter's own where the
    program has none of its name.

    Raises:
        ScriptError: They break the grammar, use unknown names, or declare a new global variable.
    """
    main = parser.parse(text)
    if not main.body and not main.inner:
        raise ScriptError("the statement is empty", 1)
    for statement in assignments([*main.body, *(part for x in main.inner for part in x.body)]):
        if statement.scope == "global" and statement.name not in context.shared:
            raise ScriptError(
                "no new global variable can be declared here", statement.line, value=statement.name
            )
    found = context.compiled(main)
    if len(found.context.functions) > MAX_FUNCTIONS:
        raise ScriptError("too many functions; clear_interpreter() forgets them", 1)
    return found
