"""Lists, poses and their elements."""

from __future__ import annotations

from typing import Any, cast

from dynid.simulation.controller.urscript.errors import ScriptFault
from dynid.simulation.controller.urscript.execution import Execution
from dynid.simulation.controller.urscript.values import (
    MAX_LENGTH,
    Pose,
    Struct,
    Value,
    copied,
    described,
    number,
    size,
)


def listed(x: Execution, *items: Value) -> Value:
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


def posed(x: Execution, *items: Value) -> Value:
    """A pose.

    Raises:
        ScriptFault: An element is no number.
    """
    return Pose([number(item) for item in items])


def element(x: Execution, base: Value, *indices: Value) -> Value:
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
