"""Methods of lists: `list.append(4)` and its like (software 5.15).

A list may grow to the longest that there is; capacities are not kept.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dynid.simulation.controller.urscript.access import base_list, check_size, listed, place
from dynid.simulation.controller.urscript.errors import ScriptFault
from dynid.simulation.controller.urscript.execution import Execution
from dynid.simulation.controller.urscript.values import Pose, Struct, Value, shown

WEIGHT = 20
"""What a call costs, in operations."""


def _append(x: Execution, items: list[Any], value: Value) -> None:
    _insert(x, items, len(items), value)


def _insert(x: Execution, items: list[Any], index: Value, value: Value) -> None:
    (kept,) = listed(x, value)
    where = len(items) if index == len(items) else place(items, index)
    check_size([*items, kept])
    items.insert(where, kept)


def _extend(x: Execution, items: list[Any], others: Value) -> None:
    more = listed(x, *base_list(others))
    check_size([*items, *more])
    items.extend(more)


def _pop(x: Execution, items: list[Any]) -> Value:
    if not items:
        raise ScriptFault("the list is empty")
    return items.pop()


def _remove(x: Execution, items: list[Any], index: Value) -> None:
    del items[place(items, index)]


def _clear(x: Execution, items: list[Any]) -> None:
    items.clear()


def _slice(x: Execution, items: list[Any], begin: Value, end: Value) -> Value:
    first = len(items) if begin == len(items) else place(items, begin)
    last = len(items) if end == len(items) else place(items, end)
    return listed(x, *items[first:last])


def _length(x: Execution, items: list[Any]) -> int:
    return len(items)


def _to_string(x: Execution, items: list[Any]) -> str:
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

    def call(x: Execution, base: Value, *arguments: Value) -> Value:
        items = base_list(base)
        if items.__class__ in (Pose, Struct) and name not in _LEAVE_IT:
            raise ScriptFault("a pose or a struct keeps its length", value=name)
        return method(x, items, *arguments)

    return call
