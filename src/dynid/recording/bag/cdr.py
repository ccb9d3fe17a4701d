"""Decode `sensor_msgs/JointState` from CDR bytes, which is all that a bag has to give us."""

from __future__ import annotations

import struct
from dataclasses import dataclass

_MAX_JOINTS = 1000
_MAX_TEXT = 4096


class CdrError(ValueError):
    """The bytes are no JointState; the message is left out and counted."""


@dataclass(frozen=True, slots=True)
class JointState:
    """One message; the three lists are as long as they were sent."""

    stamp_ns: int
    """Stamp of the header [ns]."""
    names: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]


class JointStateDecoder:
    """Decodes messages, remembering the names since they rarely change."""

    def __init__(self) -> None:
        self._known: tuple[str, bytes, tuple[str, ...]] | None = None

    def decode(self, data: bytes) -> JointState:
        """Decode one message.

        Args:
            data: The bytes with their 4-byte encapsulation header (CDR or plain CDR2).

        Raises:
            CdrError: Unknown encapsulation, or sizes that do not fit the bytes.
        """
        if len(data) < 24 or data[0] != 0 or data[1] not in (0, 1, 6, 7):
            raise CdrError("not CDR")
        order = "<" if data[1] & 1 else ">"
        wide = 8 if data[1] < 2 else 4
        try:
            seconds, nanoseconds = struct.unpack_from(order + "iI", data, 4)
            if nanoseconds >= 1_000_000_000:
                raise CdrError("impossible stamp")
            offset, _ = _text(data, 12, order)
            offset, names = self._names(data, _align(offset, 4), order)
            lists: list[tuple[float, ...]] = []
            for _ in range(3):
                offset = _align(offset, 4)
                (count,) = struct.unpack_from(order + "I", data, offset)
                if count > _MAX_JOINTS:
                    raise CdrError("too many values")
                # An empty list is not followed by padding.
                offset = _align(offset + 4, wide) if count else offset + 4
                lists.append(struct.unpack_from(f"{order}{count}d", data, offset))
                offset += 8 * count
        except struct.error as error:
            raise CdrError("too short") from error
        stamp = seconds * 1_000_000_000 + nanoseconds
        return JointState(stamp, names, lists[0], lists[1], lists[2])

    def _names(self, data: bytes, offset: int, order: str) -> tuple[int, tuple[str, ...]]:
        if self._known and self._known[0] == order and data.startswith(self._known[1], offset):
            return offset + len(self._known[1]), self._known[2]
        (count,) = struct.unpack_from(order + "I", data, offset)
        if count > _MAX_JOINTS:
            raise CdrError("too many names")
        start, names = offset, list[str]()
        offset += 4
        for _ in range(count):
            offset, name = _text(data, _align(offset, 4), order)
            names.append(name)
        found = tuple(names)
        self._known = (order, data[start:offset], found)
        return offset, found


def _align(offset: int, size: int) -> int:
    """The next multiple of `size`, counted from the end of the 4-byte encapsulation header."""
    return offset + (4 - offset) % size


def _text(data: bytes, offset: int, order: str) -> tuple[int, str]:
    (length,) = struct.unpack_from(order + "I", data, offset)
    end = offset + 4 + length
    if length > _MAX_TEXT or end > len(data):
        raise CdrError("text too long")
    raw = data[offset + 4 : end].rstrip(b"\0")
    try:
        return end, raw.decode()
    except UnicodeDecodeError as error:
        raise CdrError("text is not UTF-8") from error
