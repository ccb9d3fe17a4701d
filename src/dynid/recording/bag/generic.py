"""Decode any message whose definition the bag carries, into numbers by their paths."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from dynid.recording.bag.catalog import Topic
from dynid.recording.bag.cdr import CdrError
from dynid.recording.bag.definitions import SIZES, Field, parse_definition, plain_kind

_MAX_ITEMS = 100_000_000
_MOST_KEPT = 200
"""Longer arrays are images and the like: they are passed over."""
_MAX_TEXT = 1 << 20
_MAX_DEPTH = 16
_STAMPS = ("builtin_interfaces/Time", "builtin_interfaces/Duration")


@dataclass(slots=True)
class Decoded:
    """One message."""

    stamp_ns: int = 0
    """Stamp of its header; 0 where it has none."""
    names: list[str] = field(default_factory=list[str])
    """Paths of its numbers: `q[0]`, `feedback.positions[3]`."""
    values: list[float] = field(default_factory=list[float])
    texts: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    """Path to a list of strings, which may be joint names."""


class GenericDecoder:
    """Decodes the messages of one topic.

    Args:
        topic: The topic, with its definition.

    Raises:
        CdrError: A definition that makes no sense.
    """

    def __init__(self, topic: Topic) -> None:
        self._types = parse_definition(topic.definition, topic.kind)
        self._root = plain_kind(topic.kind)
        self._ros1 = topic.encoding == "ros1"
        self._paths: dict[tuple[str, int], list[str]] = {}
        self._data = b""
        self._at = 0
        self._origin = 0
        self._widest = 8
        self._order = "<"

    def decode(self, data: bytes) -> Decoded:
        """Decode one message.

        Args:
            data: Its bytes; with the encapsulation header where they are CDR.

        Raises:
            CdrError: Bytes that do not fit the definition.
        """
        self._data, self._at, self._origin, self._order = data, 0, 0, "<"
        if not self._ros1:
            if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1, 6, 7):
                raise CdrError("not CDR")
            self._order = "<" if data[1] & 1 else ">"
            self._widest = 8 if data[1] < 2 else 4
            self._at = self._origin = 4
        result = Decoded()
        try:
            self._message(self._root, "", result, 0)
        except struct.error as error:
            raise CdrError("too short") from error
        # Writers pad the end up to 4 bytes.
        if len(data) - self._at > (0 if self._ros1 else 3):
            raise CdrError("longer than its definition")
        return result

    def _message(self, kind: str, path: str, into: Decoded, depth: int) -> None:
        fields = self._types.get(kind)
        if fields is None and kind in _STAMPS:
            fields = (Field(name="sec", kind="int32"), Field(name="nanosec", kind="uint32"))
        if fields is None or depth > _MAX_DEPTH:
            raise CdrError(f"no definition of {kind}")
        if kind == "std_msgs/Header":
            self._header(into, depth, fields)
            return
        if not fields:
            # CDR has no empty structures: a byte stands for one.
            self._at += 0 if self._ros1 else 1
        for item in fields:
            inner = f"{path}.{item.name}" if path else item.name
            count = 1
            if item.array:
                count = item.size if item.size is not None else int(self._numbers("uint32", 1)[0])
            if count > _MAX_ITEMS:
                raise CdrError("too many items")
            self._field(item, inner, count, into, depth)

    def _field(self, item: Field, path: str, count: int, into: Decoded, depth: int) -> None:
        if item.kind in SIZES:
            values = self._numbers(item.kind, count)
            if item.kind in ("float64", "float32", "int32", "int64", "int16") and values:
                into.names += self._named(path, count if item.array else -1)
                into.values += values
        elif item.kind == "string":
            into.texts[path] = [self._text() for _ in range(count)]
        elif item.kind in ("time", "duration") and self._ros1:
            self._numbers("uint32", 2 * count)
        else:
            for k in range(count):
                inner = f"{path}[{k}]" if item.array else path
                self._message(item.kind, inner, into, depth + 1)

    def _header(self, into: Decoded, depth: int, fields: tuple[Field, ...]) -> None:
        """The first header's stamp; what else it holds is nobody's quantity."""
        if self._ros1:
            seconds, nanoseconds = self._numbers("uint32", 3)[1:]
        else:
            seconds = self._numbers("int32", 1)[0]
            nanoseconds = self._numbers("uint32", 1)[0]
        self._text()
        if nanoseconds >= 1_000_000_000:
            raise CdrError("impossible stamp")
        if depth == 1:
            into.stamp_ns = int(seconds) * 1_000_000_000 + int(nanoseconds)

    def _numbers(self, kind: str, count: int) -> tuple[float, ...]:
        if count == 0:
            return ()
        letter = SIZES[kind]
        size = struct.calcsize(f"<{letter}")
        if not self._ros1:
            self._at += (self._origin - self._at) % min(size, self._widest)
        if count > _MOST_KEPT:
            self._skip(count * size)
            return ()
        values = struct.unpack_from(f"{self._order}{count}{letter}", self._data, self._at)
        self._at += count * size
        return values

    def _skip(self, size: int) -> None:
        if self._at + size > len(self._data):
            raise CdrError("too short")
        self._at += size

    def _text(self) -> str:
        length = int(self._numbers("uint32", 1)[0])
        if length > _MAX_TEXT:
            raise CdrError("text too long")
        start = self._at
        self._skip(length)
        return self._data[start : self._at].rstrip(b"\0").decode(errors="replace")

    def _named(self, path: str, count: int) -> list[str]:
        known = self._paths.get((path, count))
        if known is None:
            known = [path] if count < 0 else [f"{path}[{k}]" for k in range(count)]
            self._paths[path, count] = known
        return known
