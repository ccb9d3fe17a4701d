"""From text to a program that can run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dynid.simulation.controller.urscript.builtin import Builtin
from dynid.simulation.controller.urscript.code import Code
from dynid.simulation.controller.urscript.compile_expressions import Scope
from dynid.simulation.controller.urscript.compile_statements import block
from dynid.simulation.controller.urscript.errors import ScriptError
from dynid.simulation.controller.urscript.execution import Execution, Frame, Routine
from dynid.simulation.controller.urscript.functions import Function
from dynid.simulation.controller.urscript.names import Names, names_of, own_variables
from dynid.simulation.controller.urscript.parser import parse
from dynid.simulation.controller.urscript.syntax import Definition

UNNAMED = "unnamed"
"""The name of a program that is a few statements without a `def`."""


@dataclass(frozen=True, slots=True)
class Context:
    """What a program knows; statements that are added to it while it runs know it too."""

    builtins: Mapping[str, Builtin]
    names: Names = field(default_factory=Names)
    functions: Mapping[str, Function] = field(default_factory=dict[str, Function])

    def with_program(self, main: Definition) -> Context:
        """The context with what a program or an addition to one defines; its functions compiled.

        Raises:
            ScriptError: An unknown name, one that is defined twice, or too many variables.
        """
        names = names_of(main, self.builtins, self.names)
        functions = dict(self.functions)
        new: list[Function] = []
        for name, definition in names.own_functions.items():
            own = own_variables(definition, names)
            functions[name] = Function(definition, name in names.slow, own)
            new.append(functions[name])
        for function in new:
            scope = Scope(function.places, names.shared, functions, self.builtins, True)
            code = block(scope, function.definition.body, in_loop=False)
            # Whether it waits was worked out before its callers were compiled.
            function.body = code if code.slow == function.slow else _as_waiting(code)
        return Context(self.builtins, names, functions)

    def body_of(self, main: Definition) -> tuple[Code, int]:
        """The compiled body of a program or an addition, and how many `local` variables it has.

        Raises:
            ScriptError: As `with_program`.
        """
        own = own_variables(main, self.names)
        may_wait = main.kind != "sec"
        scope = Scope(own, self.names.shared, self.functions, self.builtins, may_wait)
        return block(scope, main.body, in_loop=False), len(own)


@dataclass(frozen=True, slots=True)
class Program:
    """A compiled script; running it changes nothing in it."""

    name: str
    secondary: bool
    """Whether it runs beside the main program, without taking time (`sec`)."""
    context: Context
    """What it defines."""
    locals: int
    """How many variables of its body are declared `local`."""
    body: Code

    @property
    def variables(self) -> Mapping[str, int]:
        """Program variables and their places."""
        return self.context.names.shared

    def execution(self, port: Any, cycle: float) -> Execution:
        """The program, ready for its first cycle.

        Args:
            port: The controller, handed to the built-ins.
            cycle: Length of a control cycle [s].
        """
        execution = Execution(port, len(self.variables), cycle)
        execution.start(
            execution.new_thread(), routine_of(self.body, execution, [None] * self.locals)
        )
        return execution


def compile_script(text: str, builtins: Mapping[str, Builtin]) -> Program:
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
        main = Definition(line, "def", UNNAMED, [], {}, script.statements, script.definitions)
    elif script.definitions:
        main = script.definitions[-1]
        main.inner = [*script.definitions[:-1], *main.inner]
    else:
        raise ScriptError("the script is empty", 1)
    if main.kind == "thread":
        raise ScriptError("a thread is no program", main.line, value=main.name)
    if main.parameters:
        raise ScriptError("a program takes no arguments", main.line, value=main.parameters)
    context = Context(builtins).with_program(main)
    body, slots = context.body_of(main)
    return Program(main.name, main.kind == "sec", context, slots, body)


def routine_of(body: Code, execution: Execution, frame: Frame) -> Routine:
    """What runs a compiled body, with the variables that it declares `local`."""
    if body.slow:
        yield from body.wait(execution, frame)
    else:
        body.run(execution, frame)


def _as_waiting(code: Code) -> Code:
    def run(x: Execution, v: Frame) -> Any:
        return code.run(x, v)
        yield  # makes it a generator function

    return Code(run, True, code.weight)
