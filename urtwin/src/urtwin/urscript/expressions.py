"""From the syntax tree of an expression to code.

Elements, assignment and methods of lists, poses and structs.

A list may grow to the longest that there is; capacities are not kept.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

from urtwin.urscript import syntax
from urtwin.urscript.code import LOGIC, Code, Combine, Function, arithmetic, compose, logic
from urtwin.urscript.execution import Frame, ScriptRun
from urtwin.urscript.values import (
    MAX_LENGTH,
    SIGNS,
    UNKNOWN_FUNCTION,
    UNKNOWN_NAME,
    UNKNOWN_THREAD,
    Builtin,
    Calling,
    Pose,
    ScriptError,
    ScriptFault,
    Struct,
    Value,
    copied,
    described,
    number,
    shown,
    size,
)


def listed(x: ScriptRun, *items: Value) -> Value:
    """A list.

    Raises:
        ScriptFault: It would hold nothing's value, or too much.
    """
    found: list[Any] = list(items)
    for place, item in enumerate(found):
        if item is None:
            raise ScriptFault("an element has no value", value=described(item))
        if isinstance(item, list):
            x.charge(cast("list[Any]", item))
            found[place] = copied(item)
    check_size(found)
    return found


def posed(x: ScriptRun, *items: Value) -> Value:
    """A pose.

    Raises:
        ScriptFault: An element is no number.
    """
    return Pose([number(item) for item in items])


def element(x: ScriptRun, base: Value, *indices: Value) -> Value:
    """An element of a list, a pose or a matrix.

    Raises:
        ScriptFault: No list, or no such element.
    """
    for index in indices:
        base = base_list(base)[place(base, index)]
    return base


def store(base: Value, indices: list[Value], value: Value) -> None:
    """Change an element.

    Raises:
        ScriptFault: No list, no such element, or a value that does not belong there.
    """
    for index in indices[:-1]:
        base = base_list(base)[place(base, index)]
    items = base_list(base)
    if value is None:
        raise ScriptFault("an element has no value", value=described(value))
    if items.__class__ is Pose:
        number(value)
    items[place(items, indices[-1])] = value
    if isinstance(value, list):
        check_size(items)


def base_list(value: Value) -> list[Any]:
    """The value, if it is a list.

    Raises:
        ScriptFault: It is none.
    """
    if isinstance(value, list):
        return cast("list[Any]", value)
    raise ScriptFault("a list expected", value=described(value))


def place(items: list[Any], index: Value) -> int:
    """A checked index, or the place of a struct's member.

    Raises:
        ScriptFault: Not a whole number, outside the list, or no such member.
    """
    if isinstance(items, Struct) and index.__class__ is str:
        if index not in items.names:
            raise ScriptFault("the struct has no such member", value=index, limit=items.names)
        return items.names.index(index)
    if index.__class__ is float and index.is_integer():
        index = int(index)
    if index.__class__ is not int:
        raise ScriptFault("an index must be a whole number", value=index)
    if not 0 <= index < len(items):
        raise ScriptFault("no such element", value=index, limit=(0, len(items) - 1))
    return index


def check_size(items: list[Any]) -> None:
    """Refuse a list that is too long.

    Raises:
        ScriptFault: It holds too much.
    """
    if len(items) > MAX_LENGTH or (
        any(isinstance(item, list) for item in items) and size(items) > MAX_LENGTH
    ):
        raise ScriptFault("the list is too long", value=size(items), limit=MAX_LENGTH)


WEIGHT = 20
"""What a call costs, in operations."""


def _insert(x: ScriptRun, items: list[Any], index: Value, value: Value) -> None:
    (kept,) = listed(x, value)
    where = len(items) if index == len(items) else place(items, index)
    check_size([*items, kept])
    items.insert(where, kept)


def _extend(x: ScriptRun, items: list[Any], others: Value) -> None:
    more = listed(x, *base_list(others))
    check_size([*items, *more])
    items.extend(more)


def _pop(x: ScriptRun, items: list[Any]) -> Value:
    if not items:
        raise ScriptFault("the list is empty")
    return items.pop()


def _remove(x: ScriptRun, items: list[Any], index: Value) -> None:
    del items[place(items, index)]


def _slice(x: ScriptRun, items: list[Any], begin: Value, end: Value) -> Value:
    first = len(items) if begin == len(items) else place(items, begin)
    last = len(items) if end == len(items) else place(items, end)
    return listed(x, *items[first:last])


_ALONE: dict[str, Callable[[ScriptRun, list[Any]], Value]] = {
    "clear": lambda x, items: items.clear(),
    "length": lambda x, items: len(items),
    "pop": _pop,
    "to_string": lambda x, items: shown(items),
}
_WITH_ONE: dict[str, Callable[[ScriptRun, list[Any], Value], Value]] = {
    "append": lambda x, items, value: _insert(x, items, len(items), value),
    "extend": _extend,
    "remove": _remove,
}
METHODS: dict[str, tuple[Callable[..., Value], int]] = {
    **{name: (method, 0) for name, method in _ALONE.items()},
    **{name: (method, 1) for name, method in _WITH_ONE.items()},
    "insert": (_insert, 2),
    "slice": (_slice, 2),
}
"""Each method and how many arguments it takes."""
_LEAVE_IT = frozenset(("length", "slice", "to_string"))


def caller(name: str) -> Callable[..., Value]:
    """What a call of a method does: it takes the execution, the list and the arguments."""
    method, _ = METHODS[name]

    def call(x: ScriptRun, base: Value, *arguments: Value) -> Value:
        items = base_list(base)
        if items.__class__ in (Pose, Struct) and name not in _LEAVE_IT:
            raise ScriptFault("a pose or a struct keeps its length", value=name)
        return method(x, items, *arguments)

    return call


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

    def expression(self, tree: syntax.Expression) -> Code:
        """Compile an expression.

        Raises:
            ScriptError: An unknown name, or arguments that do not fit.
        """
        if isinstance(tree, syntax.Constant):
            value = tree.value
            return Code(lambda x, v: value, 1)
        if isinstance(tree, syntax.Variable):
            return self._variable(tree)
        if isinstance(tree, syntax.ListOf):
            if len(tree.items) > MAX_LENGTH:
                raise ScriptError(
                    "the list is too long", tree.line, value=len(tree.items), limit=MAX_LENGTH
                )
            return compose(self._all(tree.items), posed if tree.pose else listed)
        if isinstance(tree, syntax.Index):
            code = compose(self._all([tree.base, *tree.indices]), element)
            return Code(code.run, code.weight, fresh=False)
        if isinstance(tree, syntax.StartThread):
            return self._run(tree)
        if isinstance(tree, syntax.Call):
            return self._call(tree)
        if isinstance(tree, syntax.Method):
            return self._method(tree)
        if isinstance(tree, syntax.Unary):
            operation = SIGNS[tree.operator]

            def turn(x: ScriptRun, value: Value) -> Value:
                return operation(value)

            return compose([self.expression(tree.operand)], turn)
        if isinstance(tree, syntax.Chain):
            operands = self._all([tree.first, *(part for _, part in tree.rest)])
            signs = [sign for sign, _ in tree.rest]
            return logic(operands, signs) if signs[0] in LOGIC else arithmetic(operands, signs)
        raise TypeError(tree)

    def kept(self, tree: syntax.Expression) -> Code:
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
        return self._variable(syntax.Variable(line, name))

    def _all(self, trees: list[syntax.Expression]) -> list[Code]:
        return [self.expression(tree) for tree in trees]

    def _variable(self, tree: syntax.Variable) -> Code:
        name = tree.name
        if name in self.own:
            place = self.own[name]

            def own(x: ScriptRun, v: Frame) -> Value:
                value = v[place]
                if value is None:
                    raise ScriptFault(f"variable '{name}' has no value")
                return value

            return Code(own, 1, fresh=False)
        if name not in self.shared:
            raise ScriptError(UNKNOWN_NAME, tree.line, value=name)
        place = self.shared[name]

        def shared(x: ScriptRun, v: Frame) -> Value:
            value = x.shared[place]
            if value is None:
                raise ScriptFault(f"variable '{name}' has no value")
            return value

        return Code(shared, 1, fresh=False)

    def _call(self, tree: syntax.Call) -> Code:
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
        runs: dict[Calling, Combine] = {
            Calling.PURE: lambda x, *values: call(*values),
            Calling.INSTANT: lambda x, *values: call(x.port, *values),
            Calling.BLOCKING: lambda x, *values: x.finish(call(x.port, *values)),
        }
        return compose(operands, runs[known.kind], weight=known.weight)

    def _struct(self, tree: syntax.Call) -> Code:
        names = tuple(tree.named)
        if tree.positional or not names:
            raise ScriptError("a struct needs a name for each value", tree.line)

        def made(x: ScriptRun, *values: Value) -> Value:
            return Struct(names, listed(x, *values))

        return compose([self.kept(value) for value in tree.named.values()], made)

    def _method(self, tree: syntax.Method) -> Code:
        if tree.name not in METHODS:
            raise ScriptError(UNKNOWN_FUNCTION, tree.line, value=tree.name)
        count = METHODS[tree.name][1]
        if len(tree.arguments) != count:
            raise ScriptError(
                f"arguments of {tree.name}", tree.line, value=len(tree.arguments), limit=count
            )
        operands = [self.expression(tree.base), *(self.kept(part) for part in tree.arguments)]
        return compose(operands, caller(tree.name), weight=WEIGHT)

    def _own_call(self, tree: syntax.Call, function: Function) -> Code:
        operands = self._own_arguments(tree, function)
        return compose(operands, function.caller(), weight=_CALL_WEIGHT)

    def _run(self, tree: syntax.StartThread) -> Code:
        function = self.functions.get(tree.name)
        if function is None:
            raise ScriptError(UNKNOWN_THREAD, tree.line, value=tree.name)
        operands = self._own_arguments(tree, function)
        return compose(operands, function.starter(), weight=_CALL_WEIGHT)

    def _own_arguments(self, tree: syntax.Call, function: Function) -> list[Code]:
        definition = function.definition
        defaults = {name: self.expression(value) for name, value in definition.defaults.items()}
        return self._arguments(tree, tuple(definition.parameters), defaults)

    def _arguments(
        self, tree: syntax.Call, parameters: tuple[str, ...], defaults: Mapping[str, Code]
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
        name: Code(lambda x, v, value=value: value, 0)
        for name, value in zip(names, known.defaults, strict=True)
    }


def _copy(x: ScriptRun, value: Value) -> Value:
    if value.__class__ is float:
        return value
    if isinstance(value, list):
        x.charge(value)
        return copied(value)
    return value
