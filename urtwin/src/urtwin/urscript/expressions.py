"""From the syntax tree of an expression to code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from urtwin.urscript.code import LOGIC, Code, Function, arithmetic, compose, logic
from urtwin.urscript.execution import Frame, ScriptRun
from urtwin.urscript.lists import METHODS, caller, element, listed, posed
from urtwin.urscript.lists import WEIGHT as METHOD_WEIGHT
from urtwin.urscript.syntax import (
    Call,
    Chain,
    Constant,
    Expression,
    Index,
    ListOf,
    Method,
    StartThread,
    Unary,
    Variable,
)
from urtwin.urscript.values import (
    MAX_LENGTH,
    SIGNS,
    UNKNOWN_FUNCTION,
    UNKNOWN_NAME,
    UNKNOWN_THREAD,
    Builtin,
    Calling,
    ScriptError,
    ScriptFault,
    Struct,
    Value,
    copied,
)

_CALL_WEIGHT = 12
_STRUCT = "struct"


@dataclass(frozen=True, slots=True)
class Scope:
    """What an expression can see."""

    own: Mapping[str, int]
    """Variables of the function, by place."""
    shared: Mapping[str, int]
    """Variables of the program, by place."""
    functions: Mapping[str, Function]
    builtins: Mapping[str, Builtin]
    may_wait: bool = True
    """Whether code may take time; a secondary program must not."""

    def expression(self, tree: Expression) -> Code:
        """Compile an expression.

        Raises:
            ScriptError: An unknown name, or arguments that do not fit.
        """
        if isinstance(tree, Constant):
            value = tree.value
            return Code(lambda x, v: value, False, 1)
        if isinstance(tree, Variable):
            return self._variable(tree)
        if isinstance(tree, ListOf):
            if len(tree.items) > MAX_LENGTH:
                raise ScriptError(
                    "the list is too long", tree.line, value=len(tree.items), limit=MAX_LENGTH
                )
            return compose(self._all(tree.items), posed if tree.pose else listed)
        if isinstance(tree, Index):
            code = compose(self._all([tree.base, *tree.indices]), element)
            return Code(code.run, code.slow, code.weight, fresh=False)
        if isinstance(tree, Call):
            return self._call(tree)
        if isinstance(tree, Method):
            return self._method(tree)
        if isinstance(tree, StartThread):
            return self._run(tree)
        if isinstance(tree, Unary):
            operation = SIGNS[tree.operator]

            def turn(x: ScriptRun, value: Value) -> Value:
                return operation(value)

            return compose([self.expression(tree.operand)], turn)
        if isinstance(tree, Chain):
            operands = self._all([tree.first, *(part for _, part in tree.rest)])
            signs = [sign for sign, _ in tree.rest]
            return logic(operands, signs) if signs[0] in LOGIC else arithmetic(operands, signs)
        raise TypeError(tree)

    def kept(self, tree: Expression) -> Code:
        """As `expression`; the value is copied where somebody else owns it.

        Raises:
            ScriptError: As `expression`.
        """
        code = self.expression(tree)
        return code if code.fresh else compose([code], _copy)

    def expression_named(self, name: str, line: int) -> Code:
        """The variable of a name.

        Raises:
            ScriptError: An unknown name.
        """
        return self._variable(Variable(line, name))

    def _all(self, trees: list[Expression]) -> list[Code]:
        return [self.expression(tree) for tree in trees]

    def _variable(self, tree: Variable) -> Code:
        name = tree.name
        if name in self.own:
            place = self.own[name]

            def own(x: ScriptRun, v: Frame) -> Value:
                value = v[place]
                if value is None:
                    raise ScriptFault(f"variable '{name}' has no value")
                return value

            return Code(own, False, 1, fresh=False)
        if name not in self.shared:
            raise ScriptError(UNKNOWN_NAME, tree.line, value=name)
        place = self.shared[name]

        def shared(x: ScriptRun, v: Frame) -> Value:
            value = x.shared[place]
            if value is None:
                raise ScriptFault(f"variable '{name}' has no value")
            return value

        return Code(shared, False, 1, fresh=False)

    def _call(self, tree: Call) -> Code:
        function = self.functions.get(tree.name)
        if function is not None:
            return self._own_call(tree, function)
        if tree.name == _STRUCT:
            return self._struct(tree)
        known = self.builtins.get(tree.name)
        if known is None:
            raise ScriptError(UNKNOWN_FUNCTION, tree.line, value=tree.name)
        operands = self._arguments(tree, known.parameters, _constants(known))
        call = known.function
        if known.kind == Calling.PURE:
            return compose(operands, lambda x, *values: call(*values), weight=known.weight)
        if known.kind == Calling.BLOCKING and not self.may_wait:
            raise ScriptError("a secondary program must not take time", tree.line, value=known.name)
        slow = known.kind == Calling.BLOCKING
        return compose(
            operands, lambda x, *values: call(x.port, *values), slow=slow, weight=known.weight
        )

    def _struct(self, tree: Call) -> Code:
        names = tuple(tree.named)
        if tree.positional or not names:
            raise ScriptError("a struct needs a name for each value", tree.line)

        def made(x: ScriptRun, *values: Value) -> Value:
            return Struct(names, listed(x, *values))

        return compose([self.kept(value) for value in tree.named.values()], made)

    def _method(self, tree: Method) -> Code:
        if tree.name not in METHODS:
            raise ScriptError(UNKNOWN_FUNCTION, tree.line, value=tree.name)
        count = METHODS[tree.name][1]
        if len(tree.arguments) != count:
            raise ScriptError(
                f"arguments of {tree.name}", tree.line, value=len(tree.arguments), limit=count
            )
        operands = [self.expression(tree.base), *(self.kept(part) for part in tree.arguments)]
        return compose(operands, caller(tree.name), weight=METHOD_WEIGHT)

    def _own_call(self, tree: Call, function: Function) -> Code:
        if function.slow and not self.may_wait:
            raise ScriptError("a secondary program must not take time", tree.line, value=tree.name)
        operands = self._own_arguments(tree, function)
        return compose(operands, function.caller(), slow=function.slow, weight=_CALL_WEIGHT)

    def _run(self, tree: StartThread) -> Code:
        function = self.functions.get(tree.call.name)
        if function is None:
            raise ScriptError(UNKNOWN_THREAD, tree.line, value=tree.call.name)
        operands = self._own_arguments(tree.call, function)
        return compose(operands, function.starter(), weight=_CALL_WEIGHT)

    def _own_arguments(self, tree: Call, function: Function) -> list[Code]:
        definition = function.definition
        defaults = {name: self.expression(value) for name, value in definition.defaults.items()}
        return self._arguments(tree, tuple(definition.parameters), defaults)

    def _arguments(
        self, tree: Call, parameters: tuple[str, ...], defaults: Mapping[str, Code]
    ) -> list[Code]:
        if len(tree.positional) > len(parameters):
            raise ScriptError(
                f"too many arguments for {tree.name}",
                tree.line,
                value=len(tree.positional),
                limit=len(parameters),
            )
        given = dict(zip(parameters, tree.positional, strict=False))
        for name, value in tree.named.items():
            if name not in parameters or name in given:
                raise ScriptError(
                    f"argument of {tree.name}", tree.line, value=name, limit=parameters
                )
            given[name] = value
        found: list[Code] = []
        for name in parameters:
            if name in given:
                found.append(self.kept(given[name]))
            elif name in defaults:
                found.append(defaults[name])
            else:
                raise ScriptError(f"{tree.name} needs its argument", tree.line, value=name)
        return found


def _constants(known: Builtin) -> dict[str, Code]:
    names = known.parameters[known.required :]
    return {
        name: Code(lambda x, v, value=value: value, False, 0)
        for name, value in zip(names, known.defaults, strict=True)
    }


def _copy(x: ScriptRun, value: Value) -> Value:
    if value.__class__ is float:
        return value
    if isinstance(value, list):
        x.charge(value)
        return copied(value)
    return value
