"""From tokens to the syntax tree: expressions and statements.

By hand, not with lark: its LALR parser behind `tokenize` makes a bare tree of the script of UR's
drivers (50 kB) in 0.10 to 0.14 s of processor time, this the final tree in 0.02 to 0.04 s. UR's
client library waits 0.5 s for that program, which is compiled while control cycles go on. A
grammar would save some 100 lines.
"""

from collections.abc import Iterator

from urtwin.urscript import syntax
from urtwin.urscript.values import ScriptError

MAX_NESTING = 40
"""Deepest nesting of brackets, signs and blocks."""
_RANKS = {
    **dict.fromkeys(("or", "xor"), 1),
    "and": 2,
    **dict.fromkeys(("==", "!=", "<", ">", "<=", ">="), 4),
    **dict.fromkeys(("+", "-"), 5),
    **dict.fromkeys(("*", "/", "%"), 6),
}
"""How strongly operators bind."""
_NOT, _STRONGEST = 3, 7
"""`not` binds weaker than comparisons and stronger than `and`."""
_POSE = 6
_DEFINITIONS = ("def", "thread", "sec")
_SETTABLE = ("get_digital_out", "get_analog_out")
_ALONE = ("break", "continue", "halt", "enter_critical", "exit_critical")
SIGNALS = ("digital_in", "digital_out", "analog_in", "analog_out")
"""Names that stand for the signals of the controller where they have an index."""


class _Parser:
    """Reads a script; where it breaks the grammar, methods raise a `ScriptError`.

    One word of look-ahead, two where a name may be an argument's.
    """

    def __init__(self, tokens: list[syntax.Token]) -> None:
        self._tokens, self._place, self._depth = tokens, 0, 0

    @property
    def token(self) -> syntax.Token:
        return self._tokens[self._place]

    def peek(self) -> syntax.Token:
        return self._tokens[min(self._place + 1, len(self._tokens) - 1)]

    def take(self) -> syntax.Token:
        token = self._tokens[self._place]
        if self._place < len(self._tokens) - 1:
            self._place += 1
        return token

    def at(self, *texts: str) -> bool:
        """Whether the next word is one of these signs or keywords."""
        return self.token.text in texts

    def accept(self, text: str) -> bool:
        if self.at(text):
            self.take()
            return True
        return False

    def expect(self, text: str) -> syntax.Token:
        if not self.at(text):
            raise self.wrong(f"'{text}' expected")
        return self.take()

    def name(self) -> str:
        if self.token.kind != "name":
            raise self.wrong("a name expected")
        return self.take().text

    def wrong(self, what: str) -> ScriptError:
        token = self.token
        return ScriptError(what, token.line, value=token.text or token.kind)

    def deeper(self) -> None:
        """One level down, if that is not too deep."""
        self._depth += 1
        if self._depth > MAX_NESTING:
            raise ScriptError("nested too deeply", self.token.line, limit=MAX_NESTING)

    def higher(self) -> None:
        """One level up."""
        self._depth -= 1

    def expression(self) -> syntax.Expression:
        self.deeper()
        found = self._chain(1)
        self.higher()
        return found

    def call(self) -> syntax.Call:
        line, name = self.token.line, self.name()
        self.expect("(")
        positional: list[syntax.Expression] = []
        named: dict[str, syntax.Expression] = {}
        for _ in self._items(")"):
            if self.token.kind == "name" and self.peek().text == "=":
                key = self.name()
                self.expect("=")
                if key in named:
                    raise self.wrong(f"argument '{key}' repeats")
                named[key] = self.expression()
            elif named:
                raise self.wrong("an argument with a name expected")
            else:
                positional.append(self.expression())
        return syntax.Call(line, name, positional, named)

    def indices(self) -> list[syntax.Expression]:
        """Read what stands between square brackets, separated by commas."""
        self.expect("[")
        return [self.expression() for _ in self._items("]")]

    def _items(self, end: str) -> Iterator[None]:
        """Once for each item up to the end, which is taken; commas stand between them."""
        while not self.accept(end):
            yield
            if not self.at(end):
                self.expect(",")

    def _rank(self) -> int:
        return _RANKS.get(self.token.text, 0)

    def _chain(self, least: int) -> syntax.Expression:
        """Operands between operators that bind as strongly as that, or more."""
        found = self._unary(least)
        while (rank := self._rank()) >= least:
            rest: list[tuple[str, syntax.Expression]] = []
            while self._rank() == rank:
                rest.append((self.take().text, self._chain(rank + 1)))
            found = syntax.Chain(found.line, found, rest)
        return found

    def _unary(self, least: int) -> syntax.Expression:
        if self.at("-", "+", "not"):
            token = self.take()
            self.deeper()
            weak = token.text == "not" and least <= _NOT
            operand = self._chain(_NOT) if weak else self._unary(_STRONGEST)
            self.higher()
            if (
                token.text == "-"
                and isinstance(operand, syntax.Constant)
                and isinstance(operand.value, int | float)
                and not isinstance(operand.value, bool)
            ):
                return syntax.Constant(token.line, -operand.value)
            return syntax.Unary(token.line, token.text, operand)
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
            pose_head = isinstance(found, syntax.Variable) and found.name == "p"
            if pose_head and len(indices) == _POSE:
                found = syntax.ListOf(found.line, indices, True)
                continue
            if not 1 <= len(indices) <= 2:
                raise self.wrong("one or two indices expected")
            if isinstance(found, syntax.Variable) and found.name in SIGNALS:
                found = syntax.Signal(found.line, f"get_{found.name}", indices, {})
            else:
                found = syntax.Index(found.line, found, indices)
        return found

    def _member(self, base: syntax.Expression) -> syntax.Expression:
        """A member of a struct, or a call of a method."""
        line = self.expect(".").line
        if self.peek().text == "(":
            call = self.call()
            if call.named:
                raise ScriptError("a method takes no names", line, value=call.name)
            return syntax.Method(line, base, call.name, call.positional)
        return syntax.Index(line, base, [syntax.Constant(line, self.name())])

    def _atom(self) -> syntax.Expression:
        token = self.token
        if token.kind == "number":
            self.take()
            return syntax.Constant(token.line, syntax.number_of(token.text))
        if token.kind == "string":
            self.take()
            return syntax.Constant(token.line, token.text[1:-1])
        if self.at("True", "False"):
            self.take()
            return syntax.Constant(token.line, token.text == "True")
        if self.accept("("):
            inside = self.expression()
            self.expect(")")
            return inside
        if self.at("["):
            return syntax.ListOf(token.line, self.indices(), False)
        if self.accept("run"):
            call = self.call()
            return syntax.StartThread(call.line, call.name, call.positional, call.named)
        if token.kind == "name":
            if self.peek().text == "(":
                return self.call()
            self.take()
            return syntax.Variable(token.line, token.text)
        raise self.wrong("an expression expected")

    def script(self) -> syntax.Definition:
        found = syntax.Definition(self.token.line, "def", "unnamed", [], {}, [])
        while self.token.kind != "end of text":
            self._part(found)
        return found

    def _part(self, whole: syntax.Definition) -> None:
        """A definition or a statement of a definition."""
        if self.at(*_DEFINITIONS):
            whole.inner.append(self._definition())
        else:
            whole.body.append(self._statement())

    def _definition(self) -> syntax.Definition:
        self.deeper()
        head = self.take()
        name = self.name()
        self.expect("(")
        parameters: list[str] = []
        defaults: dict[str, syntax.Expression] = {}
        for _ in self._items(")"):
            parameter = self.name()
            if parameter in parameters:
                raise self.wrong(f"parameter '{parameter}' repeats")
            parameters.append(parameter)
            if self.accept("="):
                defaults[parameter] = self.expression()
            elif defaults:
                raise self.wrong("a default value expected")
        self.expect(":")
        found = syntax.Definition(head.line, head.text, name, parameters, defaults, [])
        while not self.accept("end"):
            self._part(found)
        self.higher()
        return found

    def _block(self, *ends: str) -> list[syntax.Node]:
        self.deeper()
        found: list[syntax.Node] = []
        while not self.at(*ends):
            found.append(self._statement())
        self.higher()
        return found

    def _statement(self) -> syntax.Node:
        token = self.token
        if self.accept("if"):
            return self._if(token.line)
        if self.accept("while"):
            condition = self._condition()
            body = self._block("end")
            self.expect("end")
            return syntax.While(token.line, condition, body)
        if self.at(*_ALONE):
            return syntax.Control(token.line, self.take().text)
        if self.at("return", "kill", "join"):
            word = self.take().text
            # Without a value when the line ends here: the only place where a line end counts.
            bare = self.at("end", "elif", "else") or self.token.line != token.line
            value = None if bare and word == "return" else self.expression()
            return syntax.Control(token.line, word, value)
        if self.at("global", "local"):
            scope = self.take().text
            return self._assignment(syntax.Variable(self.token.line, self.name()), scope)
        if self.at(*_DEFINITIONS):
            raise self.wrong("a definition must not stand inside a block")
        if self.token.kind == "end of text":
            raise self.wrong("'end' expected")
        expression = self.expression()
        if self.at("="):
            return self._signal(expression) or self._assignment(expression, "")
        return expression

    def _signal(self, target: syntax.Expression) -> syntax.Call | None:
        """`digital_out[2] = True` and its like."""
        if not isinstance(target, syntax.Signal) or target.name not in _SETTABLE:
            return None
        self.expect("=")
        values = [*target.positional, self.expression()]
        return syntax.Call(target.line, target.name.replace("get", "set"), values, {})

    def _if(self, line: int) -> syntax.If:
        branches = [(self._condition(), self._block("elif", "else", "end"))]
        while self.accept("elif"):
            branches.append((self._condition(), self._block("elif", "else", "end")))
        otherwise: list[syntax.Node] = []
        if self.accept("else"):
            self.expect(":")
            otherwise = self._block("end")
        self.expect("end")
        return syntax.If(line, branches, otherwise)

    def _condition(self) -> syntax.Expression:
        condition = self.expression()
        self.expect(":")
        return condition

    def _assignment(self, target: syntax.Expression, scope: str) -> syntax.Assign:
        indices: list[syntax.Expression] = []
        base = target
        while isinstance(base, syntax.Index):
            indices, base = [*base.indices, *indices], base.base
        if not isinstance(base, syntax.Variable):
            raise self.wrong("only a variable or an element of one can be assigned to")
        if not self.at("=") and scope:
            raise ScriptError("'=' expected", target.line, value=base.name)
        self.expect("=")
        return syntax.Assign(target.line, base.name, indices, self.expression(), scope)


def parse(text: str) -> syntax.Definition:
    """The tree of a script: what stands in it, as if it were the body of a function.

    A `ScriptError` tells where it breaks the grammar, is too long or nested too deeply.
    """
    return _Parser(syntax.tokenize(text)).script()
