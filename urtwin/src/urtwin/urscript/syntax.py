"""Tokens and the syntax tree of a script; line ends mean nothing in URScript."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import cast

from urtwin.urscript.values import ScriptError


@dataclass(slots=True)
class Node:
    """Any part of a script."""

    line: int


def nodes(tree: object, kind: type[Node] = Node) -> Iterator[Node]:
    """The parts of a kind in a tree or a list of trees and below them, in the order of the text."""
    left = [tree]
    while left:
        part = left.pop()
        if isinstance(part, kind):
            yield part
            left += [getattr(part, name) for name in part.__match_args__[:0:-1]]
        elif isinstance(part, list | tuple):
            left += cast("list[object]", part)[::-1]
        elif isinstance(part, dict):
            left += reversed(cast("dict[str, object]", part).values())


@dataclass(slots=True)
class Expression(Node):
    """Something with a value."""


@dataclass(slots=True)
class Constant(Expression):
    """A number, truth value or string."""

    value: float | int | bool | str


@dataclass(slots=True)
class Variable(Expression):
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
class StartThread(Call):
    """A thread that starts; its value is the handle."""


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
    """Something to do; an expression may stand in its place, for its effect."""


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

    branches: list[tuple[Expression, list[Node]]]
    otherwise: list[Node]


@dataclass(slots=True)
class While(Statement):
    """A loop."""

    condition: Expression
    body: list[Node]


@dataclass(slots=True)
class Control(Statement):
    """A keyword alone (`break`, `halt`, ...) or with a value (`return`, `kill`, `join`)."""

    word: str
    value: Expression | None = None


@dataclass(slots=True)
class Definition(Statement):
    """A `def`, `thread` or `sec`."""

    kind: str
    name: str
    parameters: list[str]
    defaults: dict[str, Expression]
    body: list[Node]
    inner: "list[Definition]" = field(default_factory=list["Definition"])


MAX_CHARACTERS = 1_000_000
"""Longest script."""
MAX_STRING = 1_000
"""Longest string."""
_WORDS = (
    "def sec thread end if elif else while break continue return halt run kill join global local "
    "enter_critical exit_critical and or not xor True False"
)
_LONG_NUMBER, _LARGEST_INTEGER = 12, 2**31 - 1
KEYWORDS = frozenset(_WORDS.split(" "))

_TOKEN = re.compile(
    r"""(?P<space>[ \t\r\f\v]+|\#[^\n]*)
    |(?P<newline>\n)
    |(?P<number>(?:\d+\.\d*|\.\d+|\d+)(?:[eE][+-]?\d+)?)
    |(?P<name>[A-Za-z_]\w*)
    |(?P<string>"[^"\n]*")
    |(?P<label>\$[ \t]*\d+[ \t]*"[^"\n]*"(?:[ \t]*"noBreak")?)
    |(?P<sign>==|!=|<=|>=|[-+*/%<>=()\[\],:.])
    |(?P<unknown>.)""",
    re.VERBOSE | re.ASCII,
)


@dataclass(frozen=True, slots=True)
class Token:
    """One word."""

    kind: str
    """`number`, `name`, `keyword`, `string`, `sign` or `end of text`."""
    text: str
    """As it stands in the script; that of no kind is that of another."""
    line: int
    """Counted from one."""


def tokenize(text: str) -> list[Token]:
    """The words of a script; the last one is the end of the text.

    Too long a script or string, or a character that begins no word, is a `ScriptError`.
    """
    if len(text) > MAX_CHARACTERS:
        raise ScriptError("the script is too long", 1, value=len(text), limit=MAX_CHARACTERS)
    tokens: list[Token] = []
    line = 1
    for match in _TOKEN.finditer(text):
        kind, word = str(match.lastgroup), match.group()
        if kind == "newline":
            line += 1
        elif kind == "unknown":
            raise ScriptError("unexpected character", line, value=word)
        elif kind == "string" and len(word) > MAX_STRING:
            raise ScriptError("the string is too long", line, limit=MAX_STRING)
        elif kind not in ("space", "label"):
            tokens.append(Token("keyword" if word in KEYWORDS else kind, word, line))
    tokens.append(Token("end of text", "", line))
    return tokens


def number_of(text: str) -> int | float:
    """The value of a number in a script; a whole one that 32 bits do not hold is a float."""
    whole = text.isdigit() and len(text) < _LONG_NUMBER
    value = int(text) if whole else float(text)
    return value if value <= _LARGEST_INTEGER else float(value)
