"""Statements of a script, from words to a tree."""

from __future__ import annotations

from dynid.simulation.controller.urscript.errors import ScriptError
from dynid.simulation.controller.urscript.expressions import ExpressionParser
from dynid.simulation.controller.urscript.syntax import (
    Assign,
    Call,
    Definition,
    Do,
    Expression,
    If,
    Index,
    Name,
    OnThread,
    Return,
    Script,
    Signal,
    Simple,
    Statement,
    While,
)
from dynid.simulation.controller.urscript.tokens import tokenize

_DEFINITIONS = ("def", "thread", "sec")
_SETTABLE = ("get_digital_out", "get_analog_out")
_SIMPLE = ("break", "continue", "halt", "enter_critical", "exit_critical")


def parse(text: str) -> Script:
    """The tree of a script.

    Raises:
        ScriptError: The script breaks the grammar, is too long or nested too deeply.
    """
    return _Parser(tokenize(text)).script()


class _Parser(ExpressionParser):
    def script(self) -> Script:
        definitions: list[Definition] = []
        statements: list[Statement] = []
        while self.token.kind != "end of text":
            if self.at(*_DEFINITIONS):
                definitions.append(self._definition())
            else:
                statements.append(self._statement())
        return Script(definitions, statements)

    def _definition(self) -> Definition:
        self.deeper()
        head = self.take()
        name = self.name()
        self.expect("(")
        parameters: list[str] = []
        defaults: dict[str, Expression] = {}
        while not self.accept(")"):
            parameter = self.name()
            if parameter in parameters:
                raise self.wrong(f"parameter '{parameter}' repeats")
            parameters.append(parameter)
            if self.accept("="):
                defaults[parameter] = self.expression()
            elif defaults:
                raise self.wrong("a default value expected")
            if not self.at(")"):
                self.expect(",")
        self.expect(":")
        found = Definition(head.line, head.text, name, parameters, defaults, [])
        while not self.accept("end"):
            if self.at(*_DEFINITIONS):
                found.inner.append(self._definition())
            else:
                found.body.append(self._statement())
        self.higher()
        return found

    def _block(self, *ends: str) -> list[Statement]:
        self.deeper()
        found: list[Statement] = []
        while not self.at(*ends):
            found.append(self._statement())
        self.higher()
        return found

    def _statement(self) -> Statement:
        token = self.token
        if self.accept("if"):
            return self._if(token.line)
        if self.accept("while"):
            condition = self._condition()
            body = self._block("end")
            self.expect("end")
            return While(token.line, condition, body)
        if self.accept("return"):
            # Without a value when the line ends here: the only place where a line end counts.
            bare = self.at("end", "elif", "else") or self.token.line != token.line
            return Return(token.line, None if bare else self.expression())
        if self.at(*_SIMPLE):
            return Simple(token.line, self.take().text)
        if self.at("kill", "join"):
            return OnThread(token.line, self.take().text, self.expression())
        if self.at("global", "local"):
            scope = self.take().text
            return self._assignment(Name(self.token.line, self.name()), scope)
        if self.at(*_DEFINITIONS):
            raise self.wrong("a definition must not stand inside a block")
        if self.token.kind == "end of text":
            raise self.wrong("'end' expected")
        expression = self.expression()
        if self.at("="):
            return self._signal(expression) or self._assignment(expression, "")
        return Do(token.line, expression)

    def _signal(self, target: Expression) -> Do | None:
        """`digital_out[2] = True` and its like."""
        if not isinstance(target, Signal) or target.name not in _SETTABLE:
            return None
        self.expect("=")
        values = [*target.positional, self.expression()]
        return Do(target.line, Call(target.line, target.name.replace("get", "set"), values, {}))

    def _if(self, line: int) -> If:
        branches: list[tuple[Expression, list[Statement]]] = []
        condition = self._condition()
        branches.append((condition, self._block("elif", "else", "end")))
        while self.accept("elif"):
            condition = self._condition()
            branches.append((condition, self._block("elif", "else", "end")))
        otherwise: list[Statement] = []
        if self.accept("else"):
            self.expect(":")
            otherwise = self._block("end")
        self.expect("end")
        return If(line, branches, otherwise)

    def _condition(self) -> Expression:
        condition = self.expression()
        self.expect(":")
        return condition

    def _assignment(self, target: Expression, scope: str) -> Assign:
        indices: list[Expression] = []
        base = target
        while isinstance(base, Index):
            indices, base = [*base.indices, *indices], base.base
        if not isinstance(base, Name):
            raise self.wrong("only a variable or an element of one can be assigned to")
        if not self.at("=") and scope:
            raise ScriptError("'=' expected", target.line, value=base.name)
        self.expect("=")
        return Assign(target.line, base.name, indices, self.expression(), scope)
