"""Expressions of a script, from words to a tree."""

from __future__ import annotations

from dynid.simulation.controller.urscript.errors import ScriptError
from dynid.simulation.controller.urscript.syntax import (
    Call,
    Chain,
    Constant,
    Expression,
    Index,
    ListOf,
    Method,
    Name,
    Run,
    Signal,
    Unary,
)
from dynid.simulation.controller.urscript.tokens import Token, number_of

MAX_NESTING = 40
"""Deepest nesting of brackets, signs and blocks."""
_RANKS: tuple[tuple[str, ...], ...] = (
    ("or", "xor"),
    ("and",),
    ("==", "!=", "<", ">", "<=", ">="),
    ("+", "-"),
    ("*", "/", "%"),
)
_POSE = 6
SIGNALS = ("digital_in", "digital_out", "analog_in", "analog_out")
"""Names that stand for the signals of the controller where they have an index."""


class ExpressionParser:
    """Reads expressions, one word of look-ahead; two where a name may be an argument's.

    Args:
        tokens: The words.
    """

    def __init__(self, tokens: list[Token]) -> None:
        self._tokens, self._place, self._depth = tokens, 0, 0

    @property
    def token(self) -> Token:
        """The next word."""
        return self._tokens[self._place]

    def peek(self) -> Token:
        """The word after the next."""
        return self._tokens[min(self._place + 1, len(self._tokens) - 1)]

    def take(self) -> Token:
        """The next word, taken."""
        token = self._tokens[self._place]
        if self._place < len(self._tokens) - 1:
            self._place += 1
        return token

    def at(self, *texts: str) -> bool:
        """Whether the next word is one of these signs or keywords."""
        token = self.token
        return token.kind in ("sign", "keyword") and token.text in texts

    def accept(self, text: str) -> bool:
        """Take the next word if it is this one."""
        if self.at(text):
            self.take()
            return True
        return False

    def expect(self, text: str) -> Token:
        """Take this very word.

        Raises:
            ScriptError: The next word is another.
        """
        if not self.at(text):
            raise self.wrong(f"'{text}' expected")
        return self.take()

    def name(self) -> str:
        """Take a name.

        Raises:
            ScriptError: The next word is none.
        """
        if self.token.kind != "name":
            raise self.wrong("a name expected")
        return self.take().text

    def wrong(self, what: str) -> ScriptError:
        """An error at the next word."""
        token = self.token
        return ScriptError(what, token.line, value=token.text or token.kind)

    def deeper(self) -> None:
        """One level down.

        Raises:
            ScriptError: Too deep.
        """
        self._depth += 1
        if self._depth > MAX_NESTING:
            raise ScriptError("nested too deeply", self.token.line, limit=MAX_NESTING)

    def higher(self) -> None:
        """One level up."""
        self._depth -= 1

    def expression(self) -> Expression:
        """Read an expression.

        Raises:
            ScriptError: There is none, or it is nested too deeply.
        """
        self.deeper()
        found = self._rank(0)
        self.higher()
        return found

    def call(self) -> Call:
        """Read a call.

        Raises:
            ScriptError: There is none.
        """
        line, name = self.token.line, self.name()
        self.expect("(")
        positional: list[Expression] = []
        named: dict[str, Expression] = {}
        while not self.accept(")"):
            if self.token.kind == "name" and self.peek().text == "=" and self.peek().kind == "sign":
                key = self.name()
                self.expect("=")
                if key in named:
                    raise self.wrong(f"argument '{key}' repeats")
                named[key] = self.expression()
            elif named:
                raise self.wrong("an argument with a name expected")
            else:
                positional.append(self.expression())
            if not self.at(")"):
                self.expect(",")
        return Call(line, name, positional, named)

    def indices(self) -> list[Expression]:
        """Read what stands between square brackets, separated by commas."""
        self.expect("[")
        items: list[Expression] = []
        while not self.accept("]"):
            items.append(self.expression())
            if not self.at("]"):
                self.expect(",")
        return items

    def _rank(self, rank: int) -> Expression:
        if rank == len(_RANKS):
            return self._unary()
        first = self._negation(rank)
        rest: list[tuple[str, Expression]] = []
        while self.at(*_RANKS[rank]):
            operator = self.take().text
            rest.append((operator, self._negation(rank)))
        return Chain(first.line, first, rest) if rest else first

    def _negation(self, rank: int) -> Expression:
        # `not` binds weaker than comparisons and stronger than `and`.
        if rank == 1 and self.at("not"):
            line = self.take().line
            self.deeper()
            operand = self._negation(rank)
            self.higher()
            return Unary(line, "not", operand)
        return self._rank(rank + 1)

    def _unary(self) -> Expression:
        if self.at("-", "+", "not"):
            token = self.take()
            self.deeper()
            operand = self._unary()
            self.higher()
            if (
                token.text == "-"
                and isinstance(operand, Constant)
                and isinstance(operand.value, int | float)
                and not isinstance(operand.value, bool)
            ):
                return Constant(token.line, -operand.value)
            return Unary(token.line, token.text, operand)
        found = self._atom()
        depth = 0
        while self.at("[", "."):
            depth += 1
            if depth > MAX_NESTING:
                raise ScriptError("nested too deeply", self.token.line, limit=MAX_NESTING)
            if self.at("."):
                found = self._member(found)
                continue
            indices = self.indices()
            pose_head = isinstance(found, Name) and found.name == "p"
            if pose_head and len(indices) == _POSE:
                found = ListOf(found.line, indices, True)
                continue
            if not 1 <= len(indices) <= 2:
                raise self.wrong("one or two indices expected")
            if isinstance(found, Name) and found.name in SIGNALS:
                found = Signal(found.line, f"get_{found.name}", indices, {})
            else:
                found = Index(found.line, found, indices)
        return found

    def _member(self, base: Expression) -> Expression:
        """A member of a struct, or a call of a method."""
        line = self.expect(".").line
        if self.peek().kind == "sign" and self.peek().text == "(":
            call = self.call()
            if call.named:
                raise ScriptError("a method takes no names", line, value=call.name)
            return Method(line, base, call.name, call.positional)
        return Index(line, base, [Constant(line, self.name())])

    def _atom(self) -> Expression:
        token = self.token
        if token.kind == "number":
            self.take()
            return Constant(token.line, number_of(token.text))
        if token.kind == "string":
            self.take()
            return Constant(token.line, token.text)
        if self.at("True", "False"):
            self.take()
            return Constant(token.line, token.text == "True")
        if self.accept("("):
            inside = self.expression()
            self.expect(")")
            return inside
        if self.at("["):
            return ListOf(token.line, self.indices(), False)
        if self.accept("run"):
            return Run(token.line, self.call())
        if token.kind == "name":
            if self.peek().kind == "sign" and self.peek().text == "(":
                return self.call()
            self.take()
            return Name(token.line, token.text)
        raise self.wrong("an expression expected")
