"""Elements, assignment and methods of lists, poses and structs.

A list may grow to the longest that there is; capacities are not kept.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from urtwin.urscript.execution import ScriptRun
from urtwin.urscript.values import (
    MAX_LENGTH,
    Pose,
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


def _append(x: ScriptRun, items: list[Any], value: Value) -> None:
    _insert(x, items, len(items), value)


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


def _clear(x: ScriptRun, items: list[Any]) -> None:
    items.clear()


def _slice(x: ScriptRun, items: list[Any], begin: Value, end: Value) -> Value:
    first = len(items) if begin == len(items) else place(items, begin)
    last = len(items) if end == len(items) else place(items, end)
    return listed(x, *items[first:last])


def _length(x: ScriptRun, items: list[Any]) -> int:
    return len(items)


def _to_string(x: ScriptRun, items: list[Any]) -> str:
    return shown(items)


METHODS: dict[str, tuple[Callable[..., Value], int]] = {
    "append": (_append, 1),
    "clear": (_clear, 0),
    "extend": (_extend, 1),
    "insert": (_insert, 2),
    "length": (_length, 0),
    "pop": (_pop, 0),
    "remove": (_remove, 1),
    "slice": (_slice, 2),
    "to_string": (_to_string, 0),
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
