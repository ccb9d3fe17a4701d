"""MCAP files: JointState messages in a stream, also from a file that was cut off."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from dynid.core.errors import RecordError
from dynid.core.notices import Notice
from dynid.recording.bag.db3 import JOINT_STATE_TYPES, Message
from dynid.recording.bag.inflate import MAX_BYTES, InflateError, inflate

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F


@dataclass(slots=True)
class _State:
    schemas: dict[int, str] = field(default_factory=dict[int, str])
    channels: dict[int, tuple[str, str]] = field(default_factory=dict[int, tuple[str, str]])
    """Channel to topic and type."""
    chunks: int = 0
    damaged: int = 0
    ended: bool = False


def mcap_messages(path: Path, findings: list[Notice]) -> Iterator[Message]:
    """JointState messages in the order in which they were written.

    Args:
        path: The `.mcap` file.
        findings: Gets a notice for each kind of damage.

    Yields:
        Topic, receive time [ns] and bytes.

    Raises:
        RecordError: The file cannot be read, or has no JointState topic.
        MissingExtraError: A compressed file without the decompressor.
    """
    state = _State()
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
        raise RecordError(
            "the file cannot be read", where=path.name, value=error.strerror
        ) from error
    if state.damaged:
        findings.append(
            Notice(
                "corrupt_rows",
                f"{state.damaged} damaged pieces of {path.name} ({state.chunks} chunks) are left "
                "out with their messages",
            )
        )
    if not state.ended:
        findings.append(
            Notice("truncated_file", f"{path.name} is cut off; what precedes the cut is taken")
        )
    if not any(kind in JOINT_STATE_TYPES for _, kind in state.channels.values()):
        raise RecordError(
            "the file has no readable sensor_msgs/JointState topic",
            where=path.name,
            value=[f"{topic} ({kind})" for topic, kind in state.channels.values()][:20],
            next_step="Record the robot's /joint_states topic.",
        )


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
            state.schemas.setdefault(number, _text(content, 2))
        elif opcode == _CHANNEL:
            number, schema = struct.unpack_from("<HH", content)
            topic = (_text(content, 4), state.schemas.get(schema, "unknown"))
            state.channels.setdefault(number, topic)
        elif opcode == _MESSAGE:
            number, _, stamp = struct.unpack_from("<HIQ", content)
            topic, kind = state.channels.get(number, ("", ""))
            if kind in JOINT_STATE_TYPES and stamp < 1 << 62:
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


def _text(content: bytes, offset: int) -> str:
    (length,) = struct.unpack_from("<I", content, offset)
    raw = content[offset + 4 : offset + 4 + length]
    if len(raw) != length:
        raise struct.error("text is cut off")
    return raw.decode(errors="replace")
