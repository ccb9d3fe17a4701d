"""One entry for every recording: find out what a file is, read it, repair it.

Callers give recordings as objects, files of any format, folders, and files of hours.
"""

import hashlib
import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar, cast

import numpy as np

from dynid import core
from dynid.recording import arrayfiles, bags, content, csv, formats, isolation, store, stored
from dynid.recording.columns import parse_columns
from dynid.recording.records import ExperimentRecord, with_gains
from dynid.recording.repair import joints, pipeline
from dynid.recording.table import RawTable, ReadOptions
from dynid.robot import RobotLike, RobotModel, load_robot

_ENDINGS = "csv txt tsv dat log mat npz npy h5 hdf5 json jsonl parquet feather arrow"
_EXTENSIONS = tuple(f".{end}" for end in f"{_ENDINGS} xlsx xls ods gz bz2 xz zst zstd zip".split())


_IN_MEMORY = "Numbers in memory: dynid.ExperimentRecord(t=T, signals={'q': Q, ...})."


def _given_files(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """The files that a user means: themselves, those of a bag, or the one in a folder.

    Raises:
        RecordError: Missing, empty, or a folder that holds several recordings.
    """
    if isinstance(paths, Mapping) or hasattr(paths, "__array__"):
        # A table of pandas is a sequence of its column names.
        kind = type(paths).__name__
        raise core.RecordError("this is no file of a recording", value=kind, next_step=_IN_MEMORY)
    files = [Path(paths)] if isinstance(paths, (str, Path)) else [Path(path) for path in paths]
    if not files:
        raise core.RecordError("no recording was given")
    # os.path says False where Path raises, as for names that no file can have.
    if len(files) == 1 and not os.path.exists(files[0]) and os.path.isfile(f"{files[0]}.partial"):
        # A recording that was interrupted: what there is of it.
        return [store.partial_path(files[0])]
    for file in files:
        try:
            size = file.stat().st_size
        except (OSError, ValueError) as error:
            step = core.like_named(file)
            raise core.RecordError("no such file", where=str(file), next_step=step) from error
        if file.is_dir():
            if len(files) > 1:
                raise core.RecordError("a folder cannot stand beside other files", where=str(file))
            return _in_folder(file)
        if not file.is_file():
            raise core.RecordError("this is no regular file", where=str(file))
        if size == 0:
            raise core.RecordError("the file is empty", where=str(file))
    return files


def _in_folder(folder: Path) -> list[Path]:
    """The storage files of a bag, or the only recording that a folder holds.

    Raises:
        RecordError: The folder holds no recording, or several.
    """
    storage = bags.bag_files(folder)
    files = [path for path in sorted(folder.iterdir()) if path.is_file() and path not in storage]
    others = [path for path in files if path.name.lower().endswith(_EXTENSIONS)]
    if storage or len(others) == 1 or csv.are_one_run(others):
        return storage or others
    if not others:
        known = "a ROS bag, or files that end in " + ", ".join(_EXTENSIONS)
        raise core.RecordError("the folder holds no recording", where=str(folder), limit=known)
    quoted = " ".join(shlex.quote(str(path)) for path in others[:8])
    more = " ..." if len(others) > 8 else ""
    raise core.RecordError(
        f"the folder holds {len(others)} files",
        where=str(folder),
        value=[path.name for path in others[:20]],
        next_step=f"Name one, or those that belong side by side: dynid import {quoted}{more} "
        "--robot ROBOT -o RECORD.parquet",
    )


OWN = "own"
"""Of `ReadOptions.format`: a recording of ours and nothing else."""
_TEXT = ("auto", "csv", "ur-csv", "ur-rtde-csv")
Reader = Callable[[list[Path], ReadOptions, content.Budget], RawTable]
"""Reads the files of one recording, within a budget, as the user says. Of a format that holds
arrays, columns say quantity to path (`q=rec.act_pos,t=rec.time`). Raises RecordError for files that
are damaged or lack the columns, MissingExtraError without the format's extra."""
_READERS: dict[str, Reader] = {
    **dict.fromkeys(_TEXT, csv.read_csv),
    **dict.fromkeys(("rosbag", "mcap"), bags.read_bag),
    "arrow": arrayfiles.read_frame,
    "json": arrayfiles.read_json,
    "hdf5": arrayfiles.read_hdf5,
    "npz": arrayfiles.read_npz,
    "mat": arrayfiles.read_mat,
}

MAX_RATE_HZ = 1e6


def read_recording(
    paths: str | Path | Sequence[str | Path],
    *,
    robot: RobotLike | None = None,
    format: str = "auto",
    columns: str | Mapping[str, str] | None = None,
    header: bool | None = None,
    delimiter: str | None = None,
    gains: Sequence[float] | None = None,
    rate_hz: float | None = None,
    degrees: bool = False,
    joint_order: Sequence[str] | None = None,
    topic: str | None = None,
) -> ExperimentRecord:
    """Read a recording in any format, repair it, and report every repair in `problems`.

    Time starts at 0; the first stamp stands in `metadata.extra["t0"]` [s]. Choices that are
    no problem stand in `metadata.extra["notes"]`.

    Args:
        paths: One file or bag folder; or several text files side by side, whose columns count
            across them; or the files of one split bag.
        robot: The robot, or its name or file: its number of joints, names, limits, and drives.
            Where its drives say so, motor positions and torques become joint values.
        format: `auto` (by content), `ur-csv`, `ur-rtde-csv`, `csv`,
            `rosbag`, `mcap`, `mat`, `npz`, `hdf5`, `json` or `parquet`.
        columns: Quantity to columns: `t=0,q=1:7,current=13:19` (from 0, ranges exclude their
            end), header names, `.mat` paths (`q=rec.act_pos`), or JointState fields
            (`current=effort`).
        header: Whether a text table has a header; None to find out.
        delimiter: Delimiter of a text table; None to find out.
        gains: Drive gains of this recording [N.m/A]; they override the robot's.
        rate_hz: The clock of a recording without time stamps [Hz]. Stamps win where both are
            there (leave t out of `columns` to prefer the rate).
        degrees: Positions, velocities and accelerations are in degrees.
        joint_order: Column numbers base to tip; or joint names: the robot's, in the order of
            the file's columns, or those of a bag's messages, base to tip.
        topic: The bag's topic; None for the JointState topic with most messages.

    Raises:
        RecordError: Not a recording, or not one of this robot; the message says what to do.
        MissingExtraError: A compressed bag without the `ros` extra.
    """
    given = _given_files(paths)
    robot = None if robot is None else load_robot(robot, collision=False)
    if rate_hz is not None and not 0 < rate_hz < MAX_RATE_HZ:
        what, limit = "the rate must be positive and finite", f"0 to {MAX_RATE_HZ:g} Hz"
        raise core.RecordError(what, where="--rate", value=rate_hz, limit=limit)
    options = ReadOptions(
        format=format,
        columns=None if columns is None else parse_columns(columns),
        header=header,
        delimiter=delimiter,
        joints=robot.joint_names if robot is not None else (),
        joint_order=tuple(joint_order) if joint_order is not None else None,
        topic=topic,
        rate_hz=rate_hz,
        degrees=degrees,
    )
    table = isolation.read_isolated(given, options)
    if isinstance(table, ExperimentRecord):
        if columns is not None or degrees or joint_order is not None:
            what = "a dynid recording is complete: columns, degrees and joint order do not apply"
            raise core.RecordError(what, where=given[0].name)
        with content.located(given[0].name):
            record = store.fitted(table, robot)
    else:
        record = pipeline.repair(table, options, robot)
        origin = ", ".join(str(file) for file in given)
        metadata = replace(record.metadata, origin=origin, input_hash=_hash(given))
        record = replace(record, metadata=metadata)
    return replace(record, metadata=with_gains(record.metadata, record.joints, gains))


def serve_requests() -> None:
    """Read files for a parent process; see `read_isolated`."""
    isolation.serve(read_table)


def read_record(path: str | Path) -> ExperimentRecord:
    """Read a dynid recording, or the rows of one whose writer was killed.

    Args:
        path: The Parquet file; its `.partial` file is read where the Parquet was never
            finished (the recording then has a `truncated_file` problem).

    Raises:
        RecordError: Missing, foreign, or damaged.
    """
    if os.path.isdir(path):
        step = "Read it with dynid.read_recording."
        raise core.RecordError("this is a folder, no file", where=str(path), next_step=step)
    found = isolation.read_isolated(_given_files(path), ReadOptions(format=OWN))
    if not isinstance(found, ExperimentRecord):
        raise core.RecordError("this is no dynid recording", where=str(path))
    return found


def read_table(given: list[Path], options: ReadOptions, budget: content.Budget) -> isolation.Read:
    """What files hold, before anything is repaired; an own recording is complete.

    Raises:
        RecordError: Not a recording.
        MissingExtraError: A format whose extra is not installed.
    """
    source = ", ".join(file.name for file in given)
    with content.located(source):
        if options.format == OWN:
            return store.read_own(given[0])
        with formats.unpacked(given, budget) as files:
            kind = _format(files, options.format)
            if kind == "parquet":
                return store.read_own(files[0])
            table = _READERS[kind](files, replace(options, format=kind), budget)
        arrays = (*table.signals.values(), *table.channels.values())
        budget.require_values(sum(value.size for value in arrays))
    return replace(table, source=source, format=table.format or kind)


def _format(files: list[Path], wanted: str) -> str:
    """The format to read; `auto` for any text, whose header says more."""
    if wanted not in ("auto", *formats.FORMATS):
        raise core.RecordError("unknown format", value=wanted, limit=("auto", *formats.FORMATS))
    kinds = {formats.content_kind(file) for file in files}
    kind = min(kinds)
    if len(kinds) > 1 and not kinds <= {"rosbag", "mcap"}:
        raise core.RecordError("the files have different formats", value=sorted(kinds))
    if len(files) > 1 and kind not in ("csv", "rosbag", "mcap"):
        raise core.RecordError(
            f"only one {kind} file can be read at a time",
            value=[file.name for file in files],
            next_step="Import each by itself; dynid identify takes several recordings.",
        )
    if wanted == "auto":
        return "auto" if kind == "csv" else kind
    if (wanted, kind) in (("mat", "hdf5"), ("parquet", "arrow")):
        # MATLAB 7.3 writes HDF5; Parquet may be of others.
        return kind
    if wanted not in kinds and not (kind == "csv" and wanted in _TEXT):
        step = "Leave --format out to go by the content."
        raise core.RecordError(f"the content is {kind}, not {wanted}", next_step=step)
    return wanted


def _hash(files: list[Path]) -> str:
    """SHA-256 of the file; of several, of their hashes one after the other."""
    with content.located(files[0].name):
        hashes = [core.file_hash(file) for file in files]
    return hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()


RecordLike = ExperimentRecord | str | Path
"""A recording, or its file in any format that is read without options."""
AnyRecordLike = RecordLike | stored.StoredRecording
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
        found = store.fitted(record, robot)
        raw = RawTable(rows=np.arange(found.samples), signals=found.signals)
        try:
            joints.refuse_degrees(raw, robot)
        except core.UnclearRecordError as error:
            step = "If they are degrees, give numpy.radians(q)."
            raise error.changed(next_step=step) from error
    elif not isinstance(record, str | Path):  # pyright: ignore[reportUnnecessaryIsInstance]
        kind = type(record).__name__
        raise core.InputError("not a recording or its file", value=kind, next_step=_IN_MEMORY)
    else:
        _refuse_results(Path(record))
        try:
            found = read_recording(record, robot=robot)
        except core.UnclearRecordError as error:
            command = f"dynid import {shlex.quote(str(record))} --robot ROBOT -o RECORD.parquet"
            step = error.next_step or ""
            step += f"{'' if step.endswith('.') else '.'} It is an option of dynid import, which "
            step += "converts the file: "
            raise error.changed(next_step=step + command) from error
    if gains is None:
        return found
    told = found.problems
    if "effort" in found.signals:
        text = "the recording holds torques: the drive gains that were given are not used"
        told = (*told, core.Finding("gains_unused", text))
    metadata = with_gains(found.metadata, robot.joints, gains)
    return replace(found, metadata=metadata, problems=told)


def as_list(records: One | Sequence[One]) -> list[One]:
    """One or several recordings as a list."""
    if isinstance(records, ExperimentRecord | stored.StoredRecording | str | Path):
        return [cast("One", records)]
    one = isinstance(records, Mapping) or hasattr(records, "__array__")
    return [cast("One", records)] if one else list(records)


def open_several(
    records: RecordLike | Sequence[RecordLike],
    robot: RobotModel,
    gains: Sequence[float] | None = None,
) -> list[ExperimentRecord]:
    """As `open_record`, one or several."""
    return [open_record(record, robot, gains) for record in as_list(records)]


def open_any(
    records: Sequence[AnyRecordLike], robot: RobotModel, gains: Sequence[float] | None = None
) -> list[stored.AnyRecording]:
    """As `open_record`, several; those of ours that are long together stay in their files."""
    rows = [stored.stored_rows(Path(r)) if isinstance(r, str | Path) else 0 for r in records]
    found: list[stored.AnyRecording] = []
    for record, count in zip(records, rows, strict=True):
        if isinstance(record, stored.StoredRecording):
            found.append(record)
        elif isinstance(record, str | Path) and count and sum(rows) > stored.LONG:
            found.append(stored.open_stored(record, robot, gains))
        else:
            found.append(open_record(record, robot, gains))
    return found


def remembered_robot(path: str | Path) -> tuple[str | None, str | None]:
    """The robot and the mounting that the recording in a file remembers; None where it does not.

    Args:
        path: A recording in any format, or a folder with the text files of one run.

    Raises:
        RecordError: No such file, an empty one, or one that cannot be read.
    """
    file = _given_files(path)[0]
    _refuse_results(file)
    if stored.stored_rows(file) > stored.LONG:
        metadata = stored.open_stored(file).metadata
    elif os.path.isdir(path) or formats.content_kind(file) != "parquet":
        return None, None
    else:
        metadata = read_record(file).metadata
    return metadata.robot, metadata.extra.get("mount")


def _refuse_results(path: Path) -> None:
    """Say of a design or an estimate what it is, before anyone asks for its robot."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return
    head = content.first_bytes(path, _HEAD)
    for mark, kind in _RESULTS.items():
        if mark in head:
            what, step = f"this is {kind}, not a recording", "Give what dynid run or import wrote."
            raise core.RecordError(what, where=str(path), next_step=step)
