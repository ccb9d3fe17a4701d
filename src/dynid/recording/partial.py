"""The file of a recording in progress: checked segments, so that a crash costs the last only.

A Parquet file is worthless without its footer, which a killed writer never wrote. While a
recording runs, rows go to `NAME.partial` instead: a mark, then segments of one letter, a
length and a CRC-32 each. `H` is the description (JSON), `R` rows of little-endian doubles,
`N` a notice (JSON).
"""

from __future__ import annotations

import fcntl
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Finding, JobError, RecordError, parse_json
from dynid.recording.content import unreadable
from dynid.recording.record import (
    ExperimentRecord,
    check_quantities,
    metadata_from_json,
    notices_from_json,
)

MARK = b"DYNIDREC\x01"
_HEAD = struct.Struct("<cII")


def partial_path(path: Path) -> Path:
    """Where the rows of a recording in progress are kept."""
    return path.with_name(path.name + ".partial")


def read_partial(path: Path) -> str:
    """The command that makes a recording of a `.partial` file."""
    return f"What is there can be read: dynid import {path} -o RECORD.parquet"


def is_partial(path: Path) -> bool:
    """Whether a file is a recording in progress, by its first bytes."""
    with path.open("rb") as stream:
        return stream.read(len(MARK)) == MARK


def pack(kind: bytes, payload: bytes) -> bytes:
    """One segment.

    Args:
        kind: `b"H"`, `b"R"` or `b"N"`.
        payload: Its content.
    """
    return _HEAD.pack(kind, len(payload), zlib.crc32(kind + payload)) + payload


def recover(path: Path, *, finished: bool = False) -> ExperimentRecord:
    """The recording that a `.partial` file holds, up to its first damaged segment.

    Args:
        path: The file.
        finished: The writer ended in good order: do not report the file as cut off.

    Raises:
        RecordError: The description is lost, or there are fewer than two rows.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    description: Any = None
    blocks: list[bytes] = []
    notices: list[Any] = []
    used = len(MARK)
    try:
        for kind, payload in _segments(data):
            used += _HEAD.size + len(payload)
            if kind == b"H":
                description = parse_json(payload.decode())
            elif kind == b"R":
                blocks.append(payload)
            elif kind == b"N":
                notices.append(parse_json(payload.decode()))
    except ValueError as error:
        raise RecordError("the recording's description is damaged", where=path.name) from error
    if not isinstance(description, dict):
        raise RecordError("the recording's description is lost", where=path.name)
    record = _record(path, description, b"".join(blocks), notices)
    if finished:
        return record
    lost = f", {len(data) - used} bytes after them are lost" if len(data) > used else ""
    message = f"the recording was interrupted; {record.samples} samples were kept{lost}"
    return replace(record, problems=(*record.problems, Finding("truncated_file", message)))


def _segments(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    offset = len(MARK)
    while offset + _HEAD.size <= len(data):
        kind, length, checksum = _HEAD.unpack_from(data, offset)
        offset += _HEAD.size
        payload = data[offset : offset + length]
        if len(payload) != length or zlib.crc32(kind + payload) != checksum:
            return
        yield kind, payload
        offset += length


def _record(path: Path, description: Any, rows: bytes, notices: list[Any]) -> ExperimentRecord:
    try:
        quantities = check_quantities(description["quantities"])
        joints = int(description["joints"])
        channels = [str(name) for name in description["channels"]]
        width = 1 + joints * len(quantities) + len(channels)
        table = np.frombuffer(rows, dtype="<f8").reshape(-1, width)
        start = 1 + joints * len(quantities)
        return ExperimentRecord(
            t=table[:, 0],
            signals={
                name: table[:, 1 + k * joints : 1 + (k + 1) * joints]
                for k, name in enumerate(quantities)
            },
            metadata=metadata_from_json(description["metadata"]),
            problems=notices_from_json(notices),
            channels={name: table[:, start + k] for k, name in enumerate(channels)},
        )
    except (KeyError, TypeError, ValueError) as error:
        raise RecordError(
            "the recording's description is damaged", where=path.name, value=str(error)
        ) from error


def create_partial(path: Path) -> int:
    """Create and lock a `.partial` file; one that a crash left is renamed, never overwritten.

    Args:
        path: The `.partial` file.

    Returns:
        A file descriptor open for writing.

    Raises:
        RecordError: Another program is recording there.
        JobError: The file cannot be created.
    """
    try:
        if path.exists():
            _set_aside(path)
        file = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o644)
    except OSError as error:
        raise JobError(
            "the recording cannot be started", where=str(path), value=error.strerror
        ) from error
    # The lock only tells other writers; a file system without locks can still record.
    with suppress(OSError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return file


def _set_aside(path: Path) -> None:
    old = os.open(path, os.O_RDONLY)
    try:
        # A file system without locks cannot say; the old rows are kept in any case.
        with suppress(OSError):
            _lock_or_refuse(old, path)
    finally:
        os.close(old)
    number = 1
    while (aside := path.with_name(f"{path.name}.{number}")).exists():
        number += 1
    os.rename(path, aside)


def _lock_or_refuse(file: int, path: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise RecordError("another program is recording there", where=str(path)) from error
