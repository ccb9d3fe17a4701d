"""ROS 1 bags (`.bag`, version 2.0): messages in a stream, also from a cut-off file.

Written here because rosbags refuses every file that is cut off.
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from dynid.recording.bagfiles import Catalog, Message, Topic
from dynid.recording.content import MAX_BYTES, InflateError, inflate, unreadable

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = 0x02, 0x05, 0x07
_BAG_HEADER = b"\x03"


@dataclass(slots=True)
class _State:
    catalog: Catalog
    connections: dict[int, str] = field(default_factory=dict[int, str])
    """Connection to topic, of those that are wanted."""
    expected: int = 0
    """Chunks that the bag's own header counts; 0 where the recorder was killed."""
    chunks: int = 0
    damaged: int = 0
    cut: bool = False


def ros1_messages(path: Path, catalog: Catalog) -> Iterator[Message]:
    """The wanted messages in the order in which they were written.

    Args:
        path: The `.bag` file.
        catalog: Says which topics are wanted; gets all topics, and a notice for each kind of
            damage.

    Yields:
        Topic, receive time [ns] and bytes.

    Raises:
        RecordError: The file cannot be read.
        MissingExtraError: A bag compressed by lz4 without the decompressor.
    """
    state = _State(catalog)
    try:
        with path.open("rb") as stream:
            size = path.stat().st_size
            stream.seek(len(MAGIC))
            yield from _records(stream, size, state)
    except OSError as error:
        raise unreadable(path, error) from error
    state.cut |= state.chunks < state.expected
    if state.damaged:
        catalog.report(
            "corrupt_rows", f"{state.damaged} damaged pieces of {path.name} are left out"
        )
    if state.cut:
        catalog.report("truncated_file", f"{path.name} is cut off; what precedes the cut is taken")


def _records(stream: BinaryIO, size: int, state: _State) -> Iterator[Message]:
    while start := stream.read(4):
        length = struct.unpack("<I", start)[0] if len(start) == 4 else MAX_BYTES + 1
        header = stream.read(min(length, size))
        tail = stream.read(4)
        if len(header) < length or len(tail) < 4:
            state.cut = True
            return
        (count,) = struct.unpack("<I", tail)
        fields = _fields(header)
        if count > size - stream.tell():
            state.cut = True
            return
        if fields.get(b"op") == _BAG_HEADER and len(fields.get(b"chunk_count", b"")) == 4:
            (state.expected,) = struct.unpack("<I", fields[b"chunk_count"])
        if fields.get(b"op", b"\x00")[:1] in (b"\x02", b"\x05", b"\x07") and count <= MAX_BYTES:
            yield from _record(fields, stream.read(count), state)
        else:
            stream.seek(count, 1)


def _record(fields: dict[bytes, bytes], data: bytes, state: _State) -> Iterator[Message]:
    operation = fields[b"op"][0]
    try:
        if operation == _CONNECTION:
            (number,) = struct.unpack("<I", fields[b"conn"])
            if number in state.connections:
                return
            inner = _fields(data)
            topic = Topic(
                name=fields[b"topic"].decode(errors="replace"),
                kind=inner.get(b"type", b"").decode(errors="replace"),
                encoding="ros1",
                language="ros1msg",
                definition=inner.get(b"message_definition", b"").decode(errors="replace"),
            )
            state.connections[number] = topic.name if state.catalog.add(topic) else ""
        elif operation == _MESSAGE:
            (number,) = struct.unpack("<I", fields[b"conn"])
            seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
            if topic := state.connections.get(number):
                yield topic, seconds * 1_000_000_000 + nanoseconds, data
        elif operation == _CHUNK:
            state.chunks += 1
            yield from _chunk(fields, data, state)
    except (KeyError, struct.error, InflateError):
        state.damaged += 1


def _chunk(fields: dict[bytes, bytes], data: bytes, state: _State) -> Iterator[Message]:
    (size,) = struct.unpack("<I", fields[b"size"])
    method = fields[b"compression"].decode(errors="replace")
    if method == "bz2":
        data = _bunzip(data, size)
    else:
        data = inflate(data, "" if method == "none" else method, size)
    offset = 0
    while offset + 8 <= len(data):
        (length,) = struct.unpack_from("<I", data, offset)
        header = data[offset + 4 : offset + 4 + length]
        (count,) = struct.unpack_from("<I", data, offset + 4 + length)
        start = offset + 8 + length
        inner = _fields(header)
        if inner.get(b"op", b"\x00")[0] in (_MESSAGE, _CONNECTION):
            yield from _record(inner, data[start : start + count], state)
        offset = start + count
    if offset != len(data):
        state.damaged += 1


def _bunzip(data: bytes, size: int) -> bytes:
    if size > MAX_BYTES:
        raise InflateError("too large")
    try:
        result = bz2.BZ2Decompressor().decompress(data, size + 1)
    except (OSError, ValueError) as error:
        raise InflateError("damaged") from error
    if len(result) != size:
        raise InflateError("wrong size")
    return result


def _fields(header: bytes) -> dict[bytes, bytes]:
    """The `name=value` fields of a record's header; those before any damage."""
    fields: dict[bytes, bytes] = {}
    offset = 0
    while offset + 4 <= len(header):
        (length,) = struct.unpack_from("<I", header, offset)
        name, equals, value = header[offset + 4 : offset + 4 + length].partition(b"=")
        if not equals or offset + 4 + length > len(header):
            break
        fields[name] = value
        offset += 4 + length
    return fields
