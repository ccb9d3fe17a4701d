"""Typed fields of a JSON document, checked as they are read.

Own code: msgspec takes the last of two equal keys without a word, where a file of safety limits has
to be refused, and leaves the shapes of arrays to be checked by hand.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError, like_named

Made = TypeVar("Made")
_hints = cache(get_type_hints)


@dataclass(frozen=True, slots=True)
class JsonFields:
    """A JSON object whose fields are asked for by type.

    The typed getters raise InputError, naming the field, when it is missing or of another type.
    """

    values: Mapping[str, Any]
    """The object as the JSON module gave it."""
    prefix: str = ""
    """Path of this object in the document, for messages."""

    def get(self, name: str) -> object:
        """The raw value, None if absent."""
        return self.values.get(name)

    def text(self, name: str) -> str:
        """A string."""
        return _text(self.get(name), self.prefix + name)

    def number(self, name: str) -> float:
        """A finite number; true and false are not numbers."""
        return _number(self.get(name), self.prefix + name)

    def whole(self, name: str) -> int:
        """A whole number."""
        return _whole(self.get(name), self.prefix + name)

    def vector(self, name: str) -> Array:
        """(N) finite numbers."""
        label = self.prefix + name
        return np.array([_number(one, label) for one in _list(self.get(name), label)])

    def matrix(self, name: str) -> Array:
        """(N, M) finite numbers, given as rows."""
        label = self.prefix + name
        rows = _list(self.get(name), label)
        return _array([[_number(one, label) for one in _list(row, label)] for row in rows], label)

    def object(self, name: str) -> "JsonFields":
        """A JSON object."""
        label = self.prefix + name
        return JsonFields(_mapping(self.get(name), label), prefix=f"{label}.")

    def objects(self, name: str) -> "list[JsonFields]":
        """A list of JSON objects."""
        label = self.prefix + name
        return [
            JsonFields(_mapping(one, f"{label}[{k}]"), prefix=f"{label}[{k}].")
            for k, one in enumerate(_list(self.get(name), label, of="objects"))
        ]

    def made(self, kind: type[Made], **known: Any) -> Made:
        """A dataclass whose fields are as `plain` wrote them, each read by its annotation.

        Fields that are absent have their defaults; others may be `known`.
        """
        for item in fields(cast("Any", kind)):
            if item.name in known or not item.init:
                continue
            label = self.prefix + item.name
            if item.name in self.values:
                known[item.name] = _typed(_hints(kind)[item.name], self.get(item.name), label)
            elif item.default is MISSING and item.default_factory is MISSING:
                raise InputError(f"{label} is missing")
        return kind(**known)


def _typed(kind: Any, value: object, label: str) -> Any:
    """A value of an annotation; what is of none that is known stays as it is."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        if value is None and NoneType in parts:
            return None
        *others, last = (part for part in parts if part is not NoneType)
        for part in others:
            with suppress(InputError):
                return _typed(part, value, label)
        return _typed(last, value, label)
    if origin is np.ndarray:
        return _array([_nested(one, label) for one in _list(value, label)], label)
    if origin in (tuple, list, frozenset):
        items = _list(value, label, of="values")
        kinds = parts if origin is tuple and parts[-1] is not ... else parts[:1] * len(items)
        if len(kinds) != len(items):
            raise InputError(f"{label}: another number of values", value=items, limit=len(kinds))
        made = cast("Any", origin)
        return made(_typed(own, one, label) for own, one in zip(kinds, items, strict=True))
    if origin in (Mapping, dict):
        items = _mapping(value, label).items()
        return {name: _typed(parts[1], one, f"{label}.{name}") for name, one in items}
    if is_dataclass(kind):
        return JsonFields(_mapping(value, label), f"{label}.").made(cast("type[Any]", kind))
    return _SCALARS[kind](value, label) if kind in _SCALARS else value


def plain(value: Any) -> Any:
    """Dataclasses, mappings, sequences and arrays as JSON has them; null for NaN and infinity."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.ndarray):
        return plain(cast("Array", value).tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in cast("Sequence[Any]", value)]
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in cast("Mapping[str, Any]", value).items()}
    if is_dataclass(value):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    return value


def table(**columns: Any) -> list[dict[str, Any]]:
    """One object a row, of columns of one length; see `plain`."""
    rows = zip(*map(plain, columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]


MAX_JSON_BYTES = 64 << 20
"""Largest document that is not a recording: its objects take up to 30 times as much memory."""


def parse_json(text: str) -> Any:
    """The value of a JSON text, without duplicate keys in an object.

    NaN and Infinity are taken: programs that write recordings use them.

    Raises:
        ValueError: Not JSON, or a duplicate key.
        RecursionError: Nested too deeply.
    """
    return json.loads(text, object_pairs_hook=_once)


def load_object(path: str | Path) -> JsonFields:
    """The JSON object in a file.

    Raises:
        InputError: The file cannot be read, is not strict JSON, or holds no object.
    """
    where = str(path)
    try:
        with Path(path).open("rb") as stream:
            content = stream.read(MAX_JSON_BYTES + 1)
    except OSError as error:
        missing = isinstance(error, FileNotFoundError)
        step = like_named(Path(path)) or f"Looked in {Path.cwd()}." if missing else None
        what = f"the file cannot be read: {error.strerror or error}"
        raise InputError(what, where=where, next_step=step) from error
    except ValueError as error:
        raise InputError("this is not a valid file name", where=where) from error
    if len(content) > MAX_JSON_BYTES:
        limit = f"{MAX_JSON_BYTES >> 20} MB"
        raise InputError("the file is too large", where=where, limit=limit)
    try:
        document = json.loads(
            content.decode("utf-8-sig"), parse_constant=_refuse, object_pairs_hook=_once
        )
    except UnicodeDecodeError as error:
        raise InputError("the file is no text, so not JSON", where=where) from error
    except RecursionError as error:
        raise InputError("the file is nested too deeply for JSON", where=where) from error
    except ValueError as error:
        raise InputError(_fault(error, content), where=where) from error
    try:
        return JsonFields(_mapping(document, "the content"))
    except InputError as error:
        raise error.changed(where=where) from error


def _fault(error: ValueError, content: bytes) -> str:
    if not content.strip():
        return "the file is empty"
    if not isinstance(error, json.JSONDecodeError):
        return f"the file is not JSON: {error}"
    if not error.doc[error.pos :].strip() or error.msg.startswith("Unterminated"):
        return f"the JSON ends early, in line {error.lineno}: the file was cut short"
    said = error.msg[0].lower() + error.msg[1:]
    return f"the file is not JSON: {said} in line {error.lineno}, column {error.colno}"


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))
        raise ValueError(f"an object has the key {twice!r} more than once")
    return found


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is not a JSON number")


def _mapping(value: object, label: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{label} must be a JSON object", value=value)
    return cast("dict[str, Any]", value)


def _list(value: object, label: str, of: str = "numbers") -> list[object]:
    if not isinstance(value, list):
        raise InputError(f"{label} must be a list of {of}", value=value)
    return cast("list[object]", value)


def _nested(value: object, label: str) -> Any:
    """A number, or lists of them; null is NaN."""
    if isinstance(value, list):
        return [_nested(one, label) for one in cast("list[object]", value)]
    return _unknown(value, label)


def _array(values: list[Any], label: str) -> Array:
    try:
        return np.array(values, dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{label} must have rows of one length") from error


def _text(value: object, label: str) -> str:
    if not isinstance(value, str):
        raise InputError(f"{label} must be a text", value=value)
    return value


def _whole(value: object, label: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{label} must be a whole number", value=value)
    return value


def _truth(value: object, label: str) -> bool:
    if not isinstance(value, bool):
        raise InputError(f"{label} must be true or false", value=value)
    return value


def _unknown(value: object, label: str) -> float:
    """A number, NaN for null."""
    return math.nan if value is None or value != value else _number(value, label)


def _number(value: object, label: str) -> float:
    # bool is an int in Python, but no one means true as a number.
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{label} must be a number", value=value)
    try:
        number = float(value)
    except OverflowError as error:
        raise InputError(f"{label} is too large") from error
    if not math.isfinite(number):
        raise InputError(f"{label} must be a finite number", value=number)
    return number


_SCALARS: Mapping[Any, Callable[[object, str], Any]] = {
    float: _unknown,
    int: _whole,
    str: _text,
    bool: _truth,
}
