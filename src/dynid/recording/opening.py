"""Recordings as callers give them: objects, files of any format, folders, and files of hours."""

import os
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar, cast

from dynid.core import InputError, RecordError, like_named
from dynid.recording.content import changed
from dynid.recording.formats import content_kind
from dynid.recording.reading import read_record, read_recording
from dynid.recording.record import ExperimentRecord, with_gains
from dynid.recording.stored import LONG, AnyRecording, StoredRecording, open_stored, stored_rows
from dynid.robot import RobotModel

RecordLike = ExperimentRecord | str | Path
"""A recording, or its file in any format that is read without options."""
AnyRecordLike = RecordLike | StoredRecording
"""A recording that may stay in its file, too."""
One = TypeVar("One", bound=AnyRecordLike)
_HEAD = 400
_RESULTS = {
    b'"kind": "dynid.': "a design or another motion",
    b'"format": "dynid-estimate"': "an estimate",
}
"""What the files begin with that dynid writes and nobody recorded."""


def open_record(
    record: RecordLike, robot: RobotModel, gains: Sequence[float] | None = None
) -> ExperimentRecord:
    """A recording of a robot: our own Parquet, or anything else that can be read without options.

    Args:
        record: The recording or its file, or a folder with the text files of one run.
        robot: The robot it was made on.
        gains: (n) drive gains [N.m/A]; they override those of the recording and of the robot.

    Raises:
        RecordError: Not a recording, not one of this robot, or gains that do not fit it.
        InputError: No recording and no path.
    """
    if isinstance(record, ExperimentRecord):
        found = record
    elif not isinstance(record, str | Path):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError("not a recording or its file", value=record)
    else:
        _refuse_results(Path(record))
        try:
            found = read_recording(record, robot=robot)
        except RecordError as error:
            if error.next_step is None or not os.path.exists(record):
                raise
            command = f"dynid import {shlex.quote(str(record))} --robot ROBOT -o RECORD.parquet"
            step = f"{error.next_step} (Options for reading a file: {command})"
            raise changed(error, next_step=step) from error
    if gains is None:
        return found
    return replace(found, metadata=with_gains(found.metadata, robot.joints, gains))


def as_list(records: One | Sequence[One]) -> list[One]:
    """One or several recordings as a list."""
    if isinstance(records, ExperimentRecord | StoredRecording | str | Path):
        return [cast("One", records)]
    return list(records)


def open_several(
    records: RecordLike | Sequence[RecordLike],
    robot: RobotModel,
    gains: Sequence[float] | None = None,
) -> list[ExperimentRecord]:
    """As `open_record`, one or several."""
    return [open_record(record, robot, gains) for record in as_list(records)]


def open_any(
    records: Sequence[AnyRecordLike], robot: RobotModel, gains: Sequence[float] | None = None
) -> list[AnyRecording]:
    """As `open_record`, several; those of ours that are long together stay in their files."""
    rows = [stored_rows(Path(r)) if isinstance(r, str | Path) else 0 for r in records]
    found: list[AnyRecording] = []
    for record, count in zip(records, rows, strict=True):
        if isinstance(record, StoredRecording):
            found.append(record)
        elif isinstance(record, str | Path) and count and sum(rows) > LONG:
            found.append(open_stored(record, robot, gains))
        else:
            found.append(open_record(record, robot, gains))
    return found


def remembered_robot(path: str | Path) -> str | None:
    """The robot that the recording in a file says it is of; None where it does not.

    Args:
        path: A recording in any format, or a folder with the text files of one run.

    Raises:
        RecordError: No such file, or one that cannot be read.
    """
    # os.path says False where Path raises, as for names that no file can have.
    if not os.path.exists(path) and not os.path.isfile(f"{path}.partial"):
        raise RecordError(
            "there is no such file", where=str(path), next_step=like_named(Path(path))
        )
    _refuse_results(Path(path))
    if stored_rows(Path(path)) > LONG:
        return open_stored(path).metadata.robot
    foreign = os.path.isfile(path) and content_kind(Path(path)) != "parquet"
    return None if foreign or os.path.isdir(path) else read_record(path).metadata.robot


def _refuse_results(path: Path) -> None:
    """Say of a design or an estimate what it is, before anyone asks for its robot."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
    for mark, kind in _RESULTS.items():
        if mark in head:
            raise RecordError(
                f"this is {kind}, not a recording",
                where=str(path),
                next_step="Give a recording: dynid run and dynid import write them.",
            )
