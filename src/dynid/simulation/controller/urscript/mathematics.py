"""The arithmetic that every script knows."""

from __future__ import annotations

import math
from typing import Any, cast

from dynid.simulation.controller.urscript.builtin import Builtin, Kind, builtin
from dynid.simulation.controller.urscript.errors import ScriptFault
from dynid.simulation.controller.urscript.values import MAX_LENGTH, Value, number, shown, truth


def _floor(f: Value) -> int:
    return math.floor(number(f))


def _ceil(f: Value) -> int:
    return math.ceil(number(f))


def _log(b: Value, f: Value) -> float:
    return math.log(number(f), number(b))


def _pow(base: Value, exponent: Value) -> float:
    return math.pow(number(base), number(exponent))


def _norm(a: Value) -> float:
    if isinstance(a, list):
        return math.sqrt(sum(number(item) ** 2 for item in cast("list[Any]", a)))
    return abs(number(a))


def _length(v: Value) -> int:
    if isinstance(v, list | str):
        return len(cast("list[Any]", v))
    raise ScriptFault("length needs a list or a string")


def _normalize(a: Value) -> list[float]:
    scale = _norm(a)
    return [number(item) / scale for item in a]


def _make_list(length: Value, initial_value: Value, capacity: Value = 0) -> list[Value]:
    if not 0 <= _whole(length) <= MAX_LENGTH:
        raise ScriptFault("length of a list", value=length, limit=(0, MAX_LENGTH))
    return [initial_value] * length


def _whole(value: Value) -> int:
    if value.__class__ is not int:
        raise ScriptFault("a whole number expected", value=value)
    return value


def _integer_to_binary_list(x: Value) -> Value:
    return [bool(_whole(x) >> k & 1) for k in range(32)]


def _binary_list_to_integer(l: Value) -> int:  # noqa: E741 - its name in URScript
    bits = sum(1 << k for k, bit in enumerate(l[:32]) if truth(bit))
    return bits - 2**32 if bits >= 2**31 else bits


def _text(value: Value) -> str:
    if value.__class__ is not str:
        raise ScriptFault("a string expected", value=value)
    return value


def _to_str(val: Value) -> str:
    text = shown(val)
    if len(text) > MAX_LENGTH:
        raise ScriptFault("the string is too long", value=len(text), limit=MAX_LENGTH)
    return text


def _to_num(str: Value) -> Value:
    text = _text(str).strip()
    return int(text) if text.lstrip("+-").isdigit() and len(text) < 10 else float(text)


def _str_at(src: Value, index: Value) -> str:
    text, place = _text(src), _whole(index)
    if not 0 <= place < len(text):
        raise ScriptFault("no such character", value=place, limit=(0, len(text) - 1))
    return text[place]


def _str_cat(op1: Value, op2: Value) -> str:
    return _to_str(shown(op1) + shown(op2))


def _str_find(src: Value, target: Value, start_from: Value = 0) -> int:
    return _text(src).find(_text(target), max(_whole(start_from), 0))


def _str_sub(src: Value, index: Value, len: Value = -1) -> str:
    text, place, count = _text(src), _whole(index), _whole(len)
    return text[place:] if count < 0 else text[place : place + count]


def _real(function: Any) -> Any:
    def apply(f: Value) -> float:
        return function(number(f))

    return apply


def _atan2(x: Value, y: Value) -> float:
    # Named as in URScript's manual, where the first argument is the ordinate.
    return math.atan2(number(x), number(y))


def _str_empty(str: Value) -> bool:
    return _text(str) == ""


def _str_len(str: Value) -> int:
    return len(_text(str))


_TABLE: dict[str, Any] = {
    "acos": _real(math.acos),
    "asin": _real(math.asin),
    "atan": _real(math.atan),
    "atan2": _atan2,
    "ceil": _ceil,
    "cos": _real(math.cos),
    "d2r": _real(math.radians),
    "floor": _floor,
    "length": _length,
    "get_list_length": _length,
    "log": _log,
    "make_list": _make_list,
    "norm": _norm,
    "normalize": _normalize,
    "size": _length,
    "pow": _pow,
    "r2d": _real(math.degrees),
    "sin": _real(math.sin),
    "sqrt": _real(math.sqrt),
    "tan": _real(math.tan),
    "integer_to_binary_list": _integer_to_binary_list,
    "binary_list_to_integer": _binary_list_to_integer,
    "str_at": _str_at,
    "str_cat": _str_cat,
    "str_empty": _str_empty,
    "str_find": _str_find,
    "str_len": _str_len,
    "str_sub": _str_sub,
}
MATHEMATICS: list[Builtin] = [
    *(builtin(function, Kind.PURE, name=name) for name, function in _TABLE.items()),
    builtin(_to_str, Kind.PURE, name="to_str", weight=200),
    builtin(_to_num, Kind.PURE, name="to_num"),
]
"""Built-ins that only compute."""
