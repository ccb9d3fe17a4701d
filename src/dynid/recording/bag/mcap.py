"""MCAP files: messages in a stream, also from a file that was cut off."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from dynid.recording.bag.catalog import Catalog, Message, Topic
from dynid.recording.bag.inflate import MAX_BYTES, InflateError, inflate
from dynid.recording.opening import unreadable

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F


@dataclass(slots=True)
class _State:
    catalog: Catalog
    schemas: dict[int, tuple[str, str]] = field(default_factory=dict[int, tuple[str, str]])
    """Schema to type and definition."""
    channels: dict[int, str] = field(default_factory=dict[int, str])
    """Channel to topic, of those that are wanted."""
    chunks: int = 0
    damaged: int = 0
    ended: bool = False


def mcap_messages(path: Path, catalog: Catalog) -> Iterator[Message]:
    """The wanted messages in the order in which they were written.

    Args:
        path: The `.mcap` file.
        catalog: Says which topics are wanted; gets all topics, and a notice for each kind of
            damage.

    Yields:
        Topic, receive time [ns] and bytes.

    Raises:
        RecordError: The file cannot be read.
        MissingExtraError: A compressed file without the decompressor.
    """
    state = _State(catalog)
    try:
        with path.open("rb") as stream:
            size = path.stat().st_size
            stream.seek(len(MAGIC))
            for opcode, content in _records(stream, size):
                if opcode in (_DATA_END, _FOOTER):
                    state.ended = True
                    break
                yield from _messages(opcode, content, state)
    except OSError as error:
        raise unreadable(path, error) from error
    if state.damaged:
        catalog.report(
            "corrupt_rows",
            f"{state.damaged} damaged pieces of {path.name} ({state.chunks} chunks) are left "
            "out with their messages",
        )
    if not state.ended:
        catalog.report("truncated_file", f"{path.name} is cut off; what precedes the cut is taken")


def _records(stream: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Opcode and content of each record that is whole."""
    while len(head := stream.read(9)) == 9:
        opcode, length = struct.unpack("<BQ", head)
        if length > size - stream.tell() or opcode == 0:
            return
        if opcode not in (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK) or length > MAX_BYTES:
            stream.seek(length, 1)
            yield opcode, b""
            continue
        yield opcode, stream.read(length)


def _messages(opcode: int, content: bytes, state: _State) -> Iterator[Message]:
    try:
        if opcode == _SCHEMA:
            (number,) = struct.unpack_from("<H", content)
            state.schemas.setdefault(number, _schema(content))
        elif opcode == _CHANNEL:
            number, schema = struct.unpack_from("<HH", content)
            if number not in state.channels:
                topic = _topic(content, *state.schemas.get(schema, ("unknown", "")))
                state.channels[number] = topic.name if state.catalog.add(topic) else ""
        elif opcode == _MESSAGE:
            number, _, stamp = struct.unpack_from("<HIQ", content)
            topic = state.channels.get(number)
            if topic and stamp < 1 << 62:
                yield topic, stamp, content[22:]
        elif opcode == _CHUNK:
            state.chunks += 1
            yield from _chunk(content, state)
    except (struct.error, InflateError):
        state.damaged += 1


def _chunk(content: bytes, state: _State) -> Iterator[Message]:
    size, checksum = struct.unpack_from("<QI", content, 16)
    method = _text(content, 28)
    start = 32 + len(method.encode())
    (length,) = struct.unpack_from("<Q", content, start)
    data = inflate(content[start + 8 : start + 8 + length], method, size)
    if checksum and zlib.crc32(data) != checksum:
        raise InflateError("checksum")
    offset = 0
    while offset + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, offset)
        offset += 9
        if opcode != _CHUNK:
            yield from _messages(opcode, data[offset : offset + length], state)
        offset += length


def _schema(content: bytes) -> tuple[str, str]:
    """A schema's type, and its definition where it is written as ROS writes it."""
    kind = _text(content, 2)
    # Without its definition a type that is known can still be read.
    with suppress(struct.error):
        start = 6 + len(kind.encode())
        encoding = _text(content, start)
        if encoding in ("ros1msg", "ros2msg"):
            return kind, _text(content, start + 4 + len(encoding))
    return kind, ""


def _topic(content: bytes, kind: str, definition: str) -> Topic:
    name = _text(content, 4)
    encoding = ""
    with suppress(struct.error):
        encoding = _text(content, 8 + len(name.encode()))
    return Topic(name=name, kind=kind, encoding=encoding, definition=definition)


def _text(content: bytes, offset: int) -> str:
    (length,) = struct.unpack_from("<I", content, offset)
    raw = content[offset + 4 : offset + 4 + length]
    if len(raw) != length:
        raise struct.error("text is cut off")
    return raw.decode(errors="replace")
