"""Message definitions as bags carry them: ROS 1 connections, MCAP schemas, newer `.db3` files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from dynid.recording.bag.cdr import CdrError

_SEPARATOR = re.compile(r"^=+\s*$", re.MULTILINE)
_FIELD = re.compile(r"([\w/]+)(?:<=\d+)?(\[(?:<=)?(\d*)\])?\s+([A-Za-z_]\w*)\s*(.*)")
_LONGEST = 1 << 20
_MOST_FIELDS = 2000
SIZES = {
    **{"bool": "?", "byte": "b", "char": "B", "int8": "b", "uint8": "B", "int16": "h"},
    **{"uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q"},
    **{"float32": "f", "float64": "d"},
}
"""Primitive types and how Python's struct calls them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One field of a message."""

    name: str
    kind: str
    """A primitive, `string`, `time`, `duration`, or a message's full name."""
    array: bool = False
    size: int | None = None
    """Items of an array of fixed size; None where each message says how many."""


def parse_definition(text: str, kind: str) -> Mapping[str, tuple[Field, ...]]:
    """The fields of a message and of all messages in it.

    Args:
        text: Definitions one after the other, the first without a name of its own.
        kind: The name of the first.

    Returns:
        Full name (`package/Type`) to fields in their order.

    Raises:
        CdrError: A definition that makes no sense.
    """
    if len(text) > _LONGEST:
        raise CdrError("the definition is too long")
    found: dict[str, tuple[Field, ...]] = {}
    name = plain_kind(kind)
    for number, part in enumerate(_SEPARATOR.split(text)):
        lines = part.strip().splitlines()
        if number:
            if not lines or not lines[0].startswith("MSG:"):
                raise CdrError("a definition has no name")
            name, lines = plain_kind(lines[0][4:].strip()), lines[1:]
        package = name.rpartition("/")[0]
        fields = [_field(line, package) for line in lines]
        found[name] = tuple(item for item in fields if item is not None)
    if sum(map(len, found.values())) > _MOST_FIELDS:
        raise CdrError("the definition has too many fields")
    return found


def plain_kind(kind: str) -> str:
    """`package/Type` of `package/msg/Type`."""
    return kind.replace("/msg/", "/")


def _field(line: str, package: str) -> Field | None:
    text = line.partition("#")[0].strip()
    if not text:
        return None
    match = _FIELD.fullmatch(text)
    if match is None:
        raise CdrError(f"the definition has a strange line: {text[:60]!r}")
    kind, array, size, name, rest = match.groups()
    if rest.startswith("="):
        # A constant, which no message carries.
        return None
    if kind == "Header":
        kind = "std_msgs/Header"
    elif kind not in SIZES and kind not in ("string", "wstring", "time", "duration"):
        kind = plain_kind(kind) if "/" in kind else f"{package}/{kind}"
    bounded = "<=" in (array or "")
    fixed = int(size) if size and not bounded else None
    return Field(name=name, kind=kind, array=array is not None, size=fixed)
