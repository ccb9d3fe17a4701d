"""Values of a script and their arithmetic, built-in functions, and what can be wrong with a script.

Values are numbers, truth values, strings, lists and poses (lists of six numbers). Integers have
32 bits and wrap around; `/` always gives a float.
"""

import inspect
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from dynid.core import InputError, JobError

_NAMES = ("unknown name", "unknown function", "unknown thread")
UNKNOWN_NAME, UNKNOWN_FUNCTION, UNKNOWN_THREAD = _NAMES


class ScriptError(InputError):
    """A script that does not compile; the program never starts."""

    def __init__(self, what: str, line: int, *, value: object = None, limit: object = None) -> None:
        super().__init__(what, where=f"line {line}", value=value, limit=limit)
        self.line = line

    @property
    def code(self) -> str:
        """What UR's controller calls it."""
        if self.what in _NAMES:
            return f"compile_error_name_not_found:{self.value}:"
        return (
            f"syntax_error_on_line:{self.line}:{self.what if self.value is None else self.value}:"
        )


class ScriptFault(JobError):
    """A script that failed while it ran; the program stops."""


class ScriptHalt(Exception):
    """The program ended itself with `halt`."""


MAX_LENGTH = 1_000
"""Most elements of a list, and characters of a string."""
Value = Any
"""float | int | bool | str | list | Pose; None where a function returned nothing."""


class Pose(list[float]):
    """x, y, z [m], rx, ry, rz [rad]."""

    __slots__ = ()


class Struct(list[Any]):
    """Values with names, in their order."""

    __slots__ = ("names",)

    def __init__(self, names: tuple[str, ...], values: Sequence[Any]) -> None:
        super().__init__(values)
        self.names = names


def copied(value: Value) -> Value:
    """The value itself, or a copy of it where it could be changed."""
    kind = value.__class__
    if kind is list:
        nested = any(isinstance(item, list) for item in value)
        return [copied(item) for item in value] if nested else value[:]
    if kind is Struct:
        return Struct(value.names, [copied(item) for item in value])
    return Pose(value) if kind is Pose else value


def size(value: Value) -> int:
    """How many numbers and characters a value holds."""
    if isinstance(value, list):
        items = cast("list[Any]", value)
        plain = not any(isinstance(item, list | str) for item in items)
        return 1 + (len(items) if plain else sum(size(item) for item in items))
    return 1 + len(value) if isinstance(value, str) else 1


def shown(value: Value) -> str:
    """A value as `textmsg` and `to_str` write it."""
    kind = value.__class__
    if kind is Struct:
        members = zip(value.names, value, strict=True)
        return f"struct({', '.join(f'{name}={shown(item)}' for name, item in members)})"
    if kind is Pose or kind is list:
        inside = ", ".join(shown(item) for item in value)
        return f"p[{inside}]" if kind is Pose else f"[{inside}]"
    if kind is float:
        return f"{value:.9g}"
    return str(value)


def truth(value: Value) -> bool:
    """A condition's value; `ScriptFault` if it is neither a truth value nor a number."""
    if value is True or value is False:
        return value
    return bool(number(value))


def number(value: Value) -> float:
    """A number; `ScriptFault` if it is none."""
    if value.__class__ is float or value.__class__ is int:
        return value
    raise ScriptFault("a number expected", value=described(value))


def within(what: str, value: Value, least: float, most: float) -> float:
    """A number within limits; a `ScriptFault` that says what it is, if it is none."""
    found = float(number(value))
    if not least <= found <= most:
        raise ScriptFault(what, value=found, limit=(least, most))
    return found


def whole(what: str, value: Value, least: int, most: int) -> int:
    """As `within`, for a whole number."""
    if value.__class__ is not int or not least <= value <= most:
        raise ScriptFault(what, value=shown(value), limit=(least, most))
    return value


def limited(text: str) -> str:
    """A string that is not too long; else a `ScriptFault`."""
    if len(text) > MAX_LENGTH:
        raise ScriptFault("the string is too long", value=len(text), limit=MAX_LENGTH)
    return text


def is_matrix(value: Value) -> bool:
    """Whether a value is a list of rows of one length."""
    rows = cast("list[Any]", value) if value.__class__ is list else []
    if not rows or any(row.__class__ is not list for row in rows):
        return False
    return len(rows[0]) > 0 and all(len(row) == len(rows[0]) for row in rows)


def described(value: Value) -> str:
    """What kind of value this is, in words."""
    if value is None:
        return "nothing: the function returns no value"
    kinds = {
        bool: "a truth value",
        str: "a string",
        list: "a list",
        Pose: "a pose",
        Struct: "a struct",
    }
    return kinds.get(value.__class__, f"the number {value}")


def _elementwise(operation: Callable[[Value, Value], Value], a: Value, b: Value) -> Value:
    """Lists with lists of the same length, or with a number."""
    if a.__class__ is not list:
        return [operation(a, item) for item in b]
    if b.__class__ is not list:
        return [operation(item, b) for item in a]
    if len(a) != len(b):
        raise ScriptFault("lists of different length", value=(len(a), len(b)))
    return [operation(x, y) for x, y in zip(a, b, strict=True)]


def _operator(
    on_numbers: Callable[[float, float], float],
    special: Callable[[Value, Value], Value] | None = None,
) -> Callable[[Value, Value], Value]:
    """An operator on numbers that goes through lists element by element.

    `special` is asked before lists and whole numbers, not within lists; it gives None for what is
    not its own.
    """
    within = _operator(on_numbers) if special is not None else None

    def operate(a: Value, b: Value) -> Value:
        if a.__class__ is float and b.__class__ is float:
            return on_numbers(a, b)
        if special is not None and (value := special(a, b)) is not None:
            return value
        if a.__class__ is list or b.__class__ is list:
            return _elementwise(within or operate, a, b)
        return _number_result(on_numbers(number(a), number(b)))

    return operate


def _joined(a: Value, b: Value) -> Value:
    if a.__class__ is not str and b.__class__ is not str:
        return None
    if isinstance(a, list) or isinstance(b, list):
        raise ScriptFault("a list must be turned into text with to_str first")
    return limited(shown(a) + shown(b))


def _product(a: Value, b: Value) -> Value:
    """A matrix times a matrix, or times a list, which gives a list."""
    if b.__class__ is not list or not is_matrix(a):
        return None
    columns: list[Any] = list(zip(*b, strict=True)) if is_matrix(b) else [b]
    if len(a[0]) != len(b):
        raise ScriptFault("rows and columns that do not fit", value=(len(a[0]), len(b)))
    work = len(a) * len(b) * len(columns)
    if work > MAX_LENGTH:
        raise ScriptFault("the matrices are too big", value=work, limit=MAX_LENGTH)
    found = [[_dot(row, column) for column in columns] for row in a]
    return found if is_matrix(b) else [row[0] for row in found]


def _dot(row: list[Any], column: list[Any]) -> Value:
    whole = sum(number(x) * number(y) for x, y in zip(row, column, strict=True))
    return _number_result(whole)


def _remainder(a: Value, b: Value) -> Value:
    # Like C: the sign of the dividend.
    result = math.fmod(number(a), number(b))
    return int(result) if a.__class__ is int and b.__class__ is int else result


def _number_result(value: float) -> Value:
    return (value + 0x80000000) % 0x100000000 - 0x80000000 if value.__class__ is int else value


OPERATORS: dict[str, Callable[[Value, Value], Value]] = {
    "+": _operator(operator.add, _joined),
    "-": _operator(operator.sub),
    "*": _operator(operator.mul, _product),
    "/": _operator(lambda a, b: a / b),
    "%": _remainder,
    "==": lambda a, b: a == b,
    "!=": lambda a, b: a != b,
    "<": lambda a, b: number(a) < number(b),
    ">": lambda a, b: number(a) > number(b),
    "<=": lambda a, b: number(a) <= number(b),
    ">=": lambda a, b: number(a) >= number(b),
    "xor": lambda a, b: truth(a) != truth(b),
}
"""Operators of two values; `and` and `or` look at the second only if they must."""


def _negated(value: Value) -> Value:
    if value.__class__ is list:
        return [_negated(item) for item in value]
    return _number_result(-number(value))


SIGNS: dict[str, Callable[[Value], Value]] = {
    "-": _negated,
    "+": number,
    "not": lambda value: not truth(value),
}
"""Operators of one value."""


Function = Callable[..., Any]


@dataclass(frozen=True, slots=True)
class Builtin:
    """A function that every script knows."""

    function: Function
    parameters: tuple[str, ...]
    """Names of its arguments in a script."""
    defaults: Mapping[str, Any]
    """Values of those that need not be given."""
    controls: bool
    """Whether it asks or changes the controller, which it takes first; else it only computes."""
    takes_time: bool
    """Whether it is a generator: one yield a control cycle."""


def builtins(functions: Mapping[str, Function]) -> dict[str, Builtin]:
    """Built-ins from Python functions by their names in scripts.

    Arguments in a script are those of the function, but for a first one with the name `core`.
    Generator functions take time.
    """
    found: dict[str, Builtin] = {}
    for name, function in functions.items():
        own = dict(inspect.signature(function).parameters)
        controls = own.pop("core", None) is not None
        defaults = {
            key: each.default for key, each in own.items() if each.default is not each.empty
        }
        takes_time = inspect.isgeneratorfunction(function)
        found[name] = Builtin(function, tuple(own), defaults, controls, takes_time)
    return found
