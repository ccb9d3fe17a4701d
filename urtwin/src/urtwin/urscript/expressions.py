"""From the syntax tree of an expression to code.

Elements, assignment and methods of lists, poses and structs.

A list may grow to the longest that there is; capacities are not kept.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Concatenate, cast

from urtwin.urscript import syntax, values
from urtwin.urscript.execution import Frame, ScriptRun

Runner = Callable[[ScriptRun, Frame], Any]
"""Compiled code: gives a value; where it takes time, other threads run meanwhile."""
Combine = Callable[Concatenate[ScriptRun, ...], Any]
"""Takes the execution and the values of the operands."""


def compose(operands: list[Runner], combine: Combine) -> Runner:
    """Runner that combines the values of operands, which are evaluated in order."""
    match operands:
        case []:
            return lambda x, v: combine(x)
        case [one]:
            return lambda x, v: combine(x, one(x, v))
        case [first, second]:
            return lambda x, v: combine(x, first(x, v), second(x, v))
        case _:
            return lambda x, v: combine(x, *[run(x, v) for run in operands])


@dataclass(slots=True)
class Function:
    """A `def` or `thread` of a script; its body is compiled after those who call it."""

    definition: syntax.Definition
    places: dict[str, int]
    """Its own variables."""
    body: Runner = field(init=False)
    """Its code, once that is compiled."""

    def caller(self) -> Callable[..., Any]:
        """What a call does with the arguments."""
        blank: list[values.Value] = [None] * (len(self.places) - len(self.definition.parameters))

        def call(x: ScriptRun, *given: values.Value) -> values.Value:
            frame = [*given, *blank]
            x.enter(frame)
            signal = self.body(x, frame)
            x.leave()
            return signal[0] if signal.__class__ is tuple else None

        return call

    def starter(self) -> Callable[..., int]:
        """What `run` does with the arguments: it gives the handle of the new thread."""
        call = self.caller()

        def start(x: ScriptRun, *given: values.Value) -> int:
            return x.start(lambda: call(x, *given), self)

        return start


_LOGIC = ("and", "or", "xor")


def _arithmetic(head: Runner, others: list[Runner], signs: list[str]) -> Runner:
    """Operators of one rank, from left to right."""
    steps = [(values.OPERATORS[sign], other) for sign, other in zip(signs, others, strict=True)]
    if len(steps) == 1:
        only, other = steps[0]
        return lambda x, v: only(head(x, v), other(x, v))

    def run(x: ScriptRun, v: Frame) -> values.Value:
        value = head(x, v)
        for operation, operand in steps:
            value = operation(value, operand(x, v))
        return value

    return run


def _logic(head: Runner, others: list[Runner], signs: list[str]) -> Runner:
    """`and`, `or` and `xor` from left to right; what cannot matter is not looked at."""
    parts = list(zip(signs, others, strict=True))

    def run(x: ScriptRun, v: Frame) -> bool:
        value = values.truth(head(x, v))
        for sign, part in parts:
            if sign == "xor":
                value = value != values.truth(part(x, v))
            elif value is (sign == "and"):
                value = values.truth(part(x, v))
        return value

    return run


def _listed(x: ScriptRun, *items: values.Value) -> values.Value:
    found: list[Any] = list(items)
    for place, item in enumerate(found):
        if item is None:
            raise values.ScriptFault("an element has no value", value=values.described(item))
        if item.__class__ is str:
            x.charge(item)
        elif isinstance(item, list):
            x.charge(cast("list[Any]", item))
            found[place] = values.copied(item)
    _check_size(found)
    return found


def _posed(x: ScriptRun, *items: values.Value) -> values.Value:
    return values.Pose([values.number(item) for item in items])


def _element(x: ScriptRun, base: values.Value, *indices: values.Value) -> values.Value:
    for index in indices:
        base = _base_list(base)[_place(base, index)]
    return base


def store(base: values.Value, indices: list[values.Value], value: values.Value) -> None:
    """Change an element; `ScriptFault` for no list, no such element, or no value for one."""
    for index in indices[:-1]:
        base = _base_list(base)[_place(base, index)]
    items = _base_list(base)
    if value is None:
        raise values.ScriptFault("an element has no value", value=values.described(value))
    if items.__class__ is values.Pose:
        values.number(value)
    items[_place(items, indices[-1])] = value
    if isinstance(value, list):
        _check_size(items)


def _base_list(value: values.Value) -> list[Any]:
    if isinstance(value, list):
        return cast("list[Any]", value)
    raise values.ScriptFault("a list expected", value=values.described(value))


def _place(items: list[Any], index: values.Value) -> int:
    """A checked index, or the place of a struct's member."""
    if isinstance(items, values.Struct) and index.__class__ is str:
        if index not in items.names:
            raise values.ScriptFault(
                "the struct has no such member", value=index, limit=items.names
            )
        return items.names.index(index)
    if index.__class__ is float and index.is_integer():
        index = int(index)
    if index.__class__ is not int:
        raise values.ScriptFault("an index must be a whole number", value=index)
    if not 0 <= index < len(items):
        raise values.ScriptFault("no such element", value=index, limit=(0, len(items) - 1))
    return index


def _check_size(items: list[Any]) -> None:
    if len(items) > values.MAX_LENGTH or (
        any(isinstance(item, list) for item in items) and _elements(items) > values.MAX_LENGTH
    ):
        raise values.ScriptFault(
            "the list is too long", value=_elements(items), limit=values.MAX_LENGTH
        )


def _elements(items: list[Any]) -> int:
    """How many there are, those of lists within it too."""
    inner = [cast("list[Any]", item) for item in items if isinstance(item, list)]
    return len(items) + sum(map(_elements, inner))


def _insert(x: ScriptRun, items: list[Any], index: values.Value, value: values.Value) -> None:
    (kept,) = _listed(x, value)
    where = len(items) if index == len(items) else _place(items, index)
    _check_size([*items, kept])
    items.insert(where, kept)


def _extend(x: ScriptRun, items: list[Any], others: values.Value) -> None:
    more = _listed(x, *_base_list(others))
    _check_size([*items, *more])
    items.extend(more)


def _pop(x: ScriptRun, items: list[Any]) -> values.Value:
    if not items:
        raise values.ScriptFault("the list is empty")
    return items.pop()


def _remove(x: ScriptRun, items: list[Any], index: values.Value) -> None:
    del items[_place(items, index)]


def _slice(x: ScriptRun, items: list[Any], begin: values.Value, end: values.Value) -> values.Value:
    first = len(items) if begin == len(items) else _place(items, begin)
    last = len(items) if end == len(items) else _place(items, end)
    return _listed(x, *items[first:last])


_ALONE: dict[str, Callable[[ScriptRun, list[Any]], values.Value]] = {
    "clear": lambda x, items: items.clear(),
    "length": lambda x, items: len(items),
    "pop": _pop,
    "to_string": lambda x, items: values.shown(items),
}
_WITH_ONE: dict[str, Callable[[ScriptRun, list[Any], values.Value], values.Value]] = {
    "append": lambda x, items, value: _insert(x, items, len(items), value),
    "extend": _extend,
    "remove": _remove,
}
_METHODS: dict[str, tuple[Callable[..., values.Value], int]] = {
    **{name: (method, 0) for name, method in _ALONE.items()},
    **{name: (method, 1) for name, method in _WITH_ONE.items()},
    "insert": (_insert, 2),
    "slice": (_slice, 2),
}
"""Each method and how many arguments it takes."""
_LEAVE_IT = frozenset(("length", "slice", "to_string"))
_STRUCT = "struct"


@dataclass(frozen=True, slots=True)
class Scope:
    """What an expression can see.

    An unknown name, or arguments that do not fit, are a `ScriptError`.
    """

    own: Mapping[str, int]
    """Variables of the function, by place."""
    shared: Mapping[str, int]
    """Variables of the program, by place."""
    functions: Mapping[str, Function]
    builtins: Mapping[str, values.Builtin]

    def expression(self, tree: syntax.Expression) -> Runner:
        """Compile an expression."""
        if isinstance(tree, syntax.Constant):
            return _constant(tree.value)
        if isinstance(tree, syntax.Variable):
            return self._variable(tree)
        if isinstance(tree, syntax.ListOf):
            if len(tree.items) > values.MAX_LENGTH:
                raise values.ScriptError(
                    "the list is too long",
                    tree.line,
                    value=len(tree.items),
                    limit=values.MAX_LENGTH,
                )
            return compose(self._all(tree.items), _posed if tree.pose else _listed)
        if isinstance(tree, syntax.Index):
            return compose(self._all([tree.base, *tree.indices]), _element)
        if isinstance(tree, syntax.StartThread):
            return self._start(tree)
        if isinstance(tree, syntax.Call):
            return self._call(tree)
        if isinstance(tree, syntax.Method):
            return self._method(tree)
        if isinstance(tree, syntax.Unary):
            operation = values.SIGNS[tree.operator]
            return compose([self.expression(tree.operand)], lambda x, *of: operation(*of))
        if isinstance(tree, syntax.Chain):
            head, others = self.expression(tree.first), self._all([part for _, part in tree.rest])
            signs = [sign for sign, _ in tree.rest]
            return (_logic if signs[0] in _LOGIC else _arithmetic)(head, others, signs)
        raise TypeError(tree)

    def kept(self, tree: syntax.Expression) -> Runner:
        """As `expression`; the value is copied where somebody else owns it."""
        run = self.expression(tree)
        owned = isinstance(tree, syntax.Variable | syntax.Index)
        return compose([run], _copy) if owned else run

    def _all(self, trees: list[syntax.Expression]) -> list[Runner]:
        return [self.expression(tree) for tree in trees]

    def _variable(self, tree: syntax.Variable) -> Runner:
        name = tree.name
        own = name in self.own
        if not own and name not in self.shared:
            raise values.ScriptError(values.UNKNOWN_NAME, tree.line, value=name)
        place = self.own[name] if own else self.shared[name]

        def run(x: ScriptRun, v: Frame) -> values.Value:
            value = (v if own else x.shared)[place]
            if value is None:
                raise values.ScriptFault(f"variable '{name}' has no value")
            return value

        return run

    def _call(self, tree: syntax.Call) -> Runner:
        function = self.functions.get(tree.name)
        if function is not None:
            return compose(self._own(tree, function), function.caller())
        if tree.name == _STRUCT:
            return self._struct(tree)
        known = self.builtins.get(tree.name)
        if known is None:
            raise values.ScriptError(values.UNKNOWN_FUNCTION, tree.line, value=tree.name)
        defaults = {name: _constant(value) for name, value in known.defaults.items()}
        operands = self._arguments(tree, known.parameters, defaults)
        call = known.function
        if known.takes_time:
            return compose(operands, lambda x, *given: x.finish(call(x.port, *given)))
        if known.controls:
            return compose(operands, lambda x, *given: call(x.port, *given))
        return compose(operands, lambda x, *given: call(*given))

    def _struct(self, tree: syntax.Call) -> Runner:
        names = tuple(tree.named)
        if tree.positional or not names:
            raise values.ScriptError("a struct needs a name for each value", tree.line)

        def made(x: ScriptRun, *given: values.Value) -> values.Value:
            return values.Struct(names, _listed(x, *given))

        return compose([self.kept(value) for value in tree.named.values()], made)

    def _method(self, tree: syntax.Method) -> Runner:
        name = tree.name
        if name not in _METHODS:
            raise values.ScriptError(values.UNKNOWN_FUNCTION, tree.line, value=name)
        method, count = _METHODS[name]
        if len(tree.arguments) != count:
            raise values.ScriptError(
                f"arguments of {name}", tree.line, value=len(tree.arguments), limit=count
            )

        def call(x: ScriptRun, base: values.Value, *arguments: values.Value) -> values.Value:
            items = _base_list(base)
            if items.__class__ in (values.Pose, values.Struct) and name not in _LEAVE_IT:
                raise values.ScriptFault("a pose or a struct keeps its length", value=name)
            return method(x, items, *arguments)

        operands = [self.expression(tree.base), *(self.kept(part) for part in tree.arguments)]
        return compose(operands, call)

    def _start(self, tree: syntax.StartThread) -> Runner:
        function = self.functions.get(tree.name)
        if function is None:
            raise values.ScriptError(values.UNKNOWN_THREAD, tree.line, value=tree.name)
        return compose(self._own(tree, function), function.starter())

    def _own(self, tree: syntax.Call, function: Function) -> list[Runner]:
        """The arguments of a function of the script."""
        definition = function.definition
        defaults = {name: self.expression(value) for name, value in definition.defaults.items()}
        return self._arguments(tree, tuple(definition.parameters), defaults)

    def _arguments(
        self, tree: syntax.Call, parameters: tuple[str, ...], defaults: Mapping[str, Runner]
    ) -> list[Runner]:
        if len(tree.positional) > len(parameters):
            raise values.ScriptError(
                f"too many arguments for {tree.name}",
                tree.line,
                value=len(tree.positional),
                limit=len(parameters),
            )
        given = dict(zip(parameters, tree.positional, strict=False))
        for name, value in tree.named.items():
            if name not in parameters or name in given:
                raise values.ScriptError(
                    f"argument of {tree.name}", tree.line, value=name, limit=parameters
                )
            given[name] = value
        found: list[Runner] = []
        for name in parameters:
            if name in given:
                found.append(self.kept(given[name]))
            elif name in defaults:
                found.append(defaults[name])
            else:
                raise values.ScriptError(f"{tree.name} needs its argument", tree.line, value=name)
        return found


def _constant(value: values.Value) -> Runner:
    return lambda x, v: value


def _copy(x: ScriptRun, value: values.Value) -> values.Value:
    if value.__class__ is float:
        return value
    if isinstance(value, list):
        x.charge(value)
        return values.copied(value)
    return value
