"""The native file: Parquet with a description, written atomically, checked when read."""

from __future__ import annotations

import importlib
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import (
    Array,
    Finding,
    RecordError,
    cannot_write,
    file_behind,
    parse_json,
    require_absent,
)
from dynid.recording.partial import is_partial, partial_path, read_partial, recover
from dynid.recording.record import (
    UNITS,
    VERSION,
    ExperimentRecord,
    check_quantities,
    column_names,
    digest,
    metadata_from_json,
    metadata_to_json,
    notices_from_json,
)
from dynid.robot import RobotModel

KEY = b"dynid"
"""Key of the description in the Parquet schema's metadata."""
ROWS_A_GROUP = 1 << 17
"""Rows that a reader of parts decodes at a time."""
_FOREIGN = "Import it with: dynid import FILE -o RECORD.parquet"


def write_record(record: ExperimentRecord, path: str | Path, *, force: bool = True) -> None:
    """Write a recording; the file appears whole or not at all.

    Args:
        record: The recording.
        path: The file to write.
        force: Whether an existing file is replaced.

    Raises:
        InputError: A place where no such file can be, or where one is.
        JobError: The disk does not take it.
    """
    target = file_behind(Path(path))
    require_absent(target, force=force)
    names, columns = _columns(record)
    description: dict[str, Any] = {
        "schema": VERSION,
        "joints": record.joints,
        "quantities": list(record.signals),
        "channels": list(record.channels),
        "units": {
            name: unit for name, unit in UNITS.items() if name == "t" or name in record.signals
        },
        "metadata": metadata_to_json(record.metadata),
        "problems": [notice.to_json() for notice in record.problems],
    }
    description["digest"] = digest(description, columns)
    arrow = importlib.import_module("pyarrow")
    parquet = importlib.import_module("pyarrow.parquet")
    table = arrow.table(
        [arrow.array(column) for column in columns],
        schema=arrow.schema(
            [(name, arrow.float64()) for name in names],
            metadata={KEY: json.dumps(description).encode()},
        ),
    )
    draft = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        try:
            with draft.open("wb") as stream:
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
            os.replace(draft, target)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise cannot_write(target, error) from error


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


def read_own(file: Path) -> ExperimentRecord:
    """Read a recording of ours, finished or not; `read_record` bounds what that costs.

    Raises:
        RecordError: Foreign, or damaged.
    """
    if is_partial(file):
        return recover(file)
    parquet = importlib.import_module("pyarrow.parquet")
    try:
        with parquet.ParquetFile(file, page_checksum_verification=True, pre_buffer=False) as source:
            entries: dict[bytes, bytes] = source.schema_arrow.metadata or {}
            if KEY not in entries:
                raise RecordError(
                    "this Parquet file is not a dynid recording",
                    where=file.name,
                    next_step=_FOREIGN,
                )
            table = source.read(use_threads=False)
            columns = {
                name: np.asarray(table.column(name).to_numpy(), dtype=np.float64)
                for name in table.column_names
            }
        description: dict[str, Any] = parse_json(entries[KEY].decode())
    except (RecordError, MemoryError):
        raise
    # pyarrow raises many kinds on damaged bytes (ArrowInvalid, OSError, UnicodeError, ...).
    except Exception as error:
        raise RecordError(
            "the Parquet file is damaged or no Parquet",
            where=file.name,
            value=" ".join(str(error).split())[:200] or type(error).__name__,
        ) from error
    record = _record(file, description, columns)
    waiting = partial_path(file)
    if not waiting.is_file():
        return record
    note = Finding(
        "truncated_file",
        f"rows of another run, which was cut off, wait in {waiting.name}",
        severity="info",
        next_step=read_partial(waiting),
    )
    return replace(record, problems=(*record.problems, note))


def _columns(record: ExperimentRecord) -> tuple[list[str], list[Array]]:
    names = ["t", *column_names(record.signals, record.joints)]
    columns = [record.t, *(column for value in record.signals.values() for column in value.T)]
    for k, (name, value) in enumerate(record.channels.items()):
        names.append(f"channel_{k}" if name in names or not name else name)
        columns.append(value)
    return names, [np.ascontiguousarray(column) for column in columns]


def _record(file: Path, description: Any, columns: dict[str, Array]) -> ExperimentRecord:
    try:
        version = description["schema"]
        if version != VERSION:
            raise RecordError(
                "the recording was written by another version of dynid",
                where=file.name,
                value=version,
                limit=VERSION,
            )
        joints = int(description["joints"])
        quantities = check_quantities(description["quantities"])
        expected = str(description.pop("digest"))
        ordered = list(columns.values())
        names = ["t", *column_names(quantities, joints)]
        channels = [str(name) for name in description["channels"]]
        if list(columns)[: len(names)] != names or len(ordered) != len(names) + len(channels):
            raise RecordError(
                "columns are missing", where=file.name, value=list(columns)[:40], limit=names
            )
        if digest(description, ordered) != expected:
            raise RecordError(
                "the recording was changed or damaged after it was written", where=file.name
            )
        signals = {
            quantity: np.column_stack(ordered[1 + k * joints : 1 + (k + 1) * joints])
            for k, quantity in enumerate(quantities)
        }
        return ExperimentRecord(
            t=columns["t"],
            signals=signals,
            metadata=metadata_from_json(description["metadata"]),
            problems=notices_from_json(description["problems"]),
            channels=dict(zip(channels, ordered[len(names) :], strict=True)),
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RecordError(
            "the recording's description is damaged", where=file.name, value=str(error)
        ) from error


def fitted(
    record: ExperimentRecord,
    robot: RobotModel | None,
    gains: tuple[float, ...] | None,
    where: str,
) -> ExperimentRecord:
    """A recording of ours, fitted to a robot.

    Args:
        record: The recording.
        robot: The robot; its joints must be those of the recording.
        gains: Drive gains [N.m/A] that override those of the recording.
        where: The file, for messages.

    Raises:
        RecordError: Another number of joints or gains.
    """
    if robot is not None:
        if record.joints != robot.joints:
            raise RecordError(
                f"the recording has {record.joints} joints but {robot.name} has {robot.joints}",
                where=where,
            )
        names = record.metadata.joint_names
        if set(names) == set(robot.joint_names) and names != robot.joint_names:
            place = [names.index(name) for name in robot.joint_names]
            own = record.metadata.drive_gains
            record = replace(
                record,
                signals={name: value[:, place] for name, value in record.signals.items()},
                metadata=replace(
                    record.metadata,
                    joint_names=robot.joint_names,
                    drive_gains=None if own is None else tuple(own[k] for k in place),
                ),
            )
        record = replace(record, metadata=replace(record.metadata, robot=robot.name))
    if gains is not None:
        if len(gains) != record.joints:
            raise RecordError(
                "the number of gains is not the number of joints", value=gains, limit=record.joints
            )
        record = replace(record, metadata=replace(record.metadata, drive_gains=gains))
    return record
