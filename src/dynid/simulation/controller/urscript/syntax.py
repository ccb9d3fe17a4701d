"""The tree of a script. Expressions know their weight: how many operations they cost."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Node:
    """Any part of a script."""

    line: int


@dataclass(slots=True)
class Expression(Node):
    """Something with a value."""


@dataclass(slots=True)
class Constant(Expression):
    """A number, truth value or string."""

    value: float | int | bool | str


@dataclass(slots=True)
class Name(Expression):
    """A variable."""

    name: str


@dataclass(slots=True)
class ListOf(Expression):
    """A list, or a pose of six numbers."""

    items: list[Expression]
    pose: bool


@dataclass(slots=True)
class Index(Expression):
    """An element; two indices for a matrix."""

    base: Expression
    indices: list[Expression]


@dataclass(slots=True)
class Call(Expression):
    """A call of a built-in or of one's own function."""

    name: str
    positional: list[Expression]
    named: dict[str, Expression]


@dataclass(slots=True)
class Signal(Call):
    """`digital_in[2]` and its like, from before there were functions for them."""


@dataclass(slots=True)
class Method(Expression):
    """A call of a list's method."""

    base: Expression
    name: str
    arguments: list[Expression]


@dataclass(slots=True)
class Run(Expression):
    """A thread that starts; its value is the handle."""

    call: Call


@dataclass(slots=True)
class Unary(Expression):
    """`-`, `+` or `not`."""

    operator: str
    operand: Expression


@dataclass(slots=True)
class Chain(Expression):
    """Operators of one rank, from left to right; not nested, so long sums stay shallow."""

    first: Expression
    rest: list[tuple[str, Expression]]


@dataclass(slots=True)
class Statement(Node):
    """Something to do."""


@dataclass(slots=True)
class Do(Statement):
    """An expression for its effect."""

    expression: Expression


@dataclass(slots=True)
class Assign(Statement):
    """A variable, or an element of one, gets a value."""

    name: str
    indices: list[Expression]
    value: Expression
    scope: str
    """`global`, `local` or empty."""


@dataclass(slots=True)
class If(Statement):
    """Conditions with their blocks, and what is done otherwise."""

    branches: list[tuple[Expression, list[Statement]]]
    otherwise: list[Statement]


@dataclass(slots=True)
class While(Statement):
    """A loop."""

    condition: Expression
    body: list[Statement]


@dataclass(slots=True)
class Return(Statement):
    """The end of a function."""

    value: Expression | None


@dataclass(slots=True)
class Simple(Statement):
    """`break`, `continue`, `halt`, `enter_critical` or `exit_critical`."""

    word: str


@dataclass(slots=True)
class OnThread(Statement):
    """`kill` or `join`."""

    word: str
    handle: Expression


@dataclass(slots=True)
class Definition(Statement):
    """A `def`, `thread` or `sec`."""

    kind: str
    name: str
    parameters: list[str]
    defaults: dict[str, Expression]
    body: list[Statement]
    inner: list[Definition] = field(default_factory=list["Definition"])


@dataclass(slots=True)
class Script:
    """A whole text: definitions and what stands between them."""

    definitions: list[Definition]
    statements: list[Statement]
