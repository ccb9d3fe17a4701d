"""The native file: Parquet with a description, written atomically, checked when read.

A Parquet file is worthless without its footer, which a killed writer never wrote. While a
recording runs, rows go to `NAME.partial` instead: a mark, then segments of one letter, a
length and a CRC-32 each, so that a crash costs the last only. `H` is the description (JSON), `R`
rows of little-endian doubles, `N` a notice (JSON).
"""

import fcntl
import importlib
import json
import os
import shlex
import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from dynid import core
from dynid.recording import content, records
from dynid.robot import RobotModel

MARK = b"DYNIDREC\x01"
_HEAD = struct.Struct("<cII")
_LONGEST_HEAD = 1 << 20
"""Bytes before the first row; a longer file holds rows, and hours of them are not read."""


def partial_path(path: Path) -> Path:
    """Where the rows of a recording in progress are kept."""
    return path.with_name(path.name + ".partial")


def read_partial(path: Path) -> str:
    """The command that makes a recording of a `.partial` file."""
    return f"What is there can be read: dynid import {shlex.quote(str(path))} -o RECORD.parquet"


def is_partial(path: Path) -> bool:
    """Whether a file is a recording in progress, by its first bytes."""
    return content.first_bytes(path, len(MARK)) == MARK


def pack(kind: bytes, payload: bytes) -> bytes:
    """One segment of kind `b"H"`, `b"R"` or `b"N"`."""
    return _HEAD.pack(kind, len(payload), zlib.crc32(kind + payload)) + payload


def recover(
    path: Path, file: int | None = None, *, finished: bool = False
) -> records.ExperimentRecord:
    """The recording that a `.partial` file holds, up to its first damaged segment.

    It is read from the open `file`, if there is one. Where its writer `finished` in good order,
    the file is not reported as cut off.

    Raises:
        RecordError: The description is lost, or there are fewer than two rows.
    """
    with (
        content.located(path.name),
        open(path if file is None else file, "rb", closefd=file is None) as stream,
    ):
        stream.seek(0)
        data = stream.read()
    segments = list(_segments(data))
    parts = {kind: [part for own, part in segments if own == kind] for kind in (b"H", b"R", b"N")}
    if not parts[b"H"]:
        raise core.RecordError("the recording's description is lost", where=path.name)
    with content.refused("the recording's description is damaged", where=path.name):
        description = core.parse_json(parts[b"H"][-1].decode())
        notices = [core.parse_json(part.decode()) for part in parts[b"N"]]
    found = records.Description.of(description, notices)
    with content.refused("the recording's rows are damaged", where=path.name):
        table = np.frombuffer(b"".join(parts[b"R"]), dtype="<f8").reshape(-1, len(found.names))
    record = found.record(list(table.T))
    if finished:
        return record
    used = _size(segments)
    lost = f", {len(data) - used} bytes after them are lost" if len(data) > used else ""
    message = f"the recording was interrupted; {record.samples} samples were kept{lost}"
    return replace(record, problems=(*record.problems, core.Finding("truncated_file", message)))


def _is_empty(file: IO[bytes]) -> bool:
    """Whether a file is a recording in progress, undamaged and without a row."""
    data = file.read(_LONGEST_HEAD)
    segments = list(_segments(data))
    whole = data.startswith(MARK) and _size(segments) == len(data) < _LONGEST_HEAD
    return whole and all(kind != b"R" for kind, _ in segments)


def _size(segments: list[tuple[bytes, bytes]]) -> int:
    return len(MARK) + sum(_HEAD.size + len(part) for _, part in segments)


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


def create_partial(path: Path) -> tuple[int, Path | None]:
    """Create and lock a `.partial` file, open for writing; rows that a crash left are renamed.

    Returns:
        The file, and where the one before is now; None where there was none.

    Raises:
        RecordError: Another program is recording there.
        JobError: The file cannot be created.
    """
    kept = None
    try:
        if path.exists():
            with path.open("rb") as old:
                _lock(old.fileno(), path)
                empty = _is_empty(old)
            if empty:
                path.unlink()
            else:
                kept = core.free_name(path, f"{path.name}.")
                os.rename(path, kept)
        file = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o644)
    except OSError as error:
        what = "the recording cannot be started"
        raise core.JobError(what, where=str(path), value=error.strerror) from error
    _lock(file, path)
    return file, kept


def _lock(file: int, path: Path) -> None:
    """Tell other writers; a file system without locks can still record."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise core.RecordError("another program writes this recording", where=str(path)) from error
    except OSError:
        return


KEY = b"dynid"
"""Key of the description in the Parquet schema's metadata."""
ROWS_A_GROUP = 1 << 16
"""Rows that a reader of parts decodes at a time."""
_FOREIGN = "Import it with: dynid import FILE -o RECORD.parquet"


def write_record(
    record: records.ExperimentRecord, path: str | Path, *, force: bool = False
) -> None:
    """Write a recording; the file appears whole or not at all.

    Args:
        record: The recording.
        path: The file to write.
        force: Whether an existing file is replaced.

    Raises:
        InputError: A place where no such file can be, or where one is.
        JobError: The disk does not take it.
    """
    target = core.file_behind(Path(path))
    core.require_absent(target, force=force)
    names = ["t", *records.column_names(record.signals, record.joints)]
    for k, name in enumerate(record.channels):
        names.append(f"channel_{k}" if name in names or not name else name)
    signals = (column for value in record.signals.values() for column in value.T)
    columns = (record.t, *signals, *record.channels.values())
    columns = [np.ascontiguousarray(column) for column in columns]
    description: dict[str, Any] = {
        "schema": records.VERSION,
        "joints": record.joints,
        "quantities": list(record.signals),
        "channels": list(record.channels),
        "units": {name: records.UNITS[name] for name in ("t", *record.signals)},
        "metadata": records.metadata_to_json(record.metadata),
        "problems": [notice.to_json() for notice in record.problems],
    }
    description["digest"] = records.digest(description, columns)
    arrow = importlib.import_module("pyarrow")
    parquet = importlib.import_module("pyarrow.parquet")
    table = arrow.table(
        [arrow.array(column) for column in columns],
        schema=arrow.schema(
            [(name, arrow.float64()) for name in names],
            metadata={KEY: json.dumps(description).encode()},
        ),
    )
    with core.in_one_piece(target) as draft, draft.open("wb") as stream:
        parquet.write_table(
            table,
            stream,
            compression="zstd",
            use_dictionary=False,
            write_page_checksum=True,
            row_group_size=ROWS_A_GROUP,
        )
        stream.flush()
        os.fsync(stream.fileno())


def is_own(path: Path) -> bool:
    """Whether a file is a recording of ours, whole, unfinished or damaged.

    The key of the description is looked for in the footer's bytes: nothing is decoded.
    """
    if is_partial(path):
        return True
    with path.open("rb") as stream:
        end = stream.seek(0, os.SEEK_END)
        stream.seek(max(end - 8, 0))
        tail = stream.read()
        start = end - 8 - int.from_bytes(tail[:4], "little")
        if tail[4:] != b"PAR1" or start < 4:
            # A file whose footer is damaged may be ours: reading it says what is wrong.
            return True
        stream.seek(start)
        # Thrift writes a text's length before it.
        return bytes([len(KEY)]) + KEY in stream.read()


def described(footer: Any) -> tuple[records.Description, dict[str, Any], str]:
    """What the footer of a Parquet file says of the recording in it: read, as written, its digest.

    Raises:
        RecordError: Foreign, damaged, or of another version.
    """
    entries: dict[bytes, bytes] = footer.metadata or {}
    if KEY not in entries:
        raise core.RecordError("this Parquet file is not a dynid recording", next_step=_FOREIGN)
    written: dict[str, Any] = core.parse_json(entries[KEY].decode())
    if (version := written.get("schema")) != records.VERSION:
        what = "the recording was written by another version of dynid"
        raise core.RecordError(what, value=version, limit=records.VERSION)
    expected = str(written.pop("digest", ""))
    return records.Description.of(written, written.get("problems") or ()), written, expected


def read_own(file: Path) -> records.ExperimentRecord:
    """Read a recording of ours, finished or not; `read_record` bounds what that costs.

    Raises:
        RecordError: Foreign, or damaged.
    """
    if is_partial(file):
        return recover(file)
    parquet = importlib.import_module("pyarrow.parquet")
    with (
        content.refused("the Parquet file is damaged or no Parquet"),
        parquet.ParquetFile(file, page_checksum_verification=True, pre_buffer=False) as source,
    ):
        found, description, expected = described(source.metadata)
        table = source.read(use_threads=False)
        pairs = zip(table.column_names, table.columns, strict=True)
        columns = {name: np.asarray(x.to_numpy(), dtype=np.float64) for name, x in pairs}
        ordered, start = list(columns.values()), len(found.names) - len(found.channels)
        if len(ordered) != len(found.names) or list(columns)[:start] != found.names[:start]:
            there = list(columns)[:40]
            raise core.RecordError("columns are missing", value=there, limit=found.names)
        if records.digest(description, ordered) != expected:
            raise core.RecordError("the recording was changed or damaged after it was written")
        record = found.record(ordered)
    waiting = partial_path(file)
    if not waiting.is_file():
        return record
    text, step = f"rows of another, interrupted run are in {waiting.name}", read_partial(waiting)
    note = core.Finding("truncated_file", text, severity="info", next_step=step)
    return replace(record, problems=(*record.problems, note))


def fitted(record: records.ExperimentRecord, robot: RobotModel | None) -> records.ExperimentRecord:
    """A recording, fitted to a robot; see `of_robot`."""
    metadata, order, told = records.of_robot(record.metadata, record.joints, robot)
    if metadata == record.metadata:
        return record
    signals = {name: value[:, list(order)] for name, value in record.signals.items()}
    problems = (*record.problems, *told)
    return replace(record, signals=signals, metadata=metadata, problems=problems)
