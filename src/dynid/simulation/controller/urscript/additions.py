"""Statements that are added to a program while it runs: the language's side of interpreter mode."""

from __future__ import annotations

from dataclasses import dataclass

from dynid.simulation.controller.urscript.code import Code
from dynid.simulation.controller.urscript.errors import ScriptError
from dynid.simulation.controller.urscript.execution import Execution, Routine
from dynid.simulation.controller.urscript.names import calls, expressions, walk
from dynid.simulation.controller.urscript.parser import parse
from dynid.simulation.controller.urscript.program import UNNAMED, Context, routine_of
from dynid.simulation.controller.urscript.syntax import Assign, Definition, Statement

MAX_FUNCTIONS = 2_000
"""Most functions of a program and of what is added to it."""


@dataclass(frozen=True, slots=True)
class Addition:
    """Compiled statements, to be run in the thread that interprets them."""

    context: Context
    """What the program knows with them."""
    body: Code
    locals: int
    """How many variables they declare `local`."""
    called: frozenset[str]
    """The functions that they call themselves."""

    def routine(self, execution: Execution) -> Routine:
        """What runs them."""
        return routine_of(self.body, execution, [None] * self.locals)


def compile_addition(text: str, context: Context) -> Addition:
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
    main = Definition(1, "def", UNNAMED, [], {}, script.statements, script.definitions)
    _refuse_new_globals(main, context)
    wider = context.with_program(main)
    if len(wider.functions) > MAX_FUNCTIONS:
        raise ScriptError("too many functions; clear_interpreter() forgets them", 1)
    body, slots = wider.body_of(main)
    called = frozenset(
        call.name
        for statement in walk(main.body)
        for part in expressions(statement)
        for call in calls(part)
    )
    return Addition(wider, body, slots, called)


def _refuse_new_globals(main: Definition, context: Context) -> None:
    blocks: list[list[Statement]] = [main.body, *(inner.body for inner in main.inner)]
    for statement in (each for block in blocks for each in walk(block)):
        if (
            isinstance(statement, Assign)
            and statement.scope == "global"
            and statement.name not in context.names.shared
        ):
            raise ScriptError(
                "no new global variable can be declared here", statement.line, value=statement.name
            )
