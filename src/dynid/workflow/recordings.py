"""Recordings and the robots they belong to, whatever files they come in.

`dynid import`: convert a recording.
"""

import math
import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import InputError, JobError, RecordError, like_named, require_absent, told
from dynid.recording import (
    LONG,
    AnyRecording,
    ExperimentRecord,
    StoredRecording,
    content_kind,
    open_stored,
    read_record,
    read_recording,
    stored_rows,
    write_record,
)
from dynid.robot import RobotModel, builtin_names, load_robot
from dynid.workflow.shared_inertias import TARGETS, identify_gains

RecordLike = ExperimentRecord | str | Path
"""A recording, or its file in any format that is read without options."""
AnyRecordLike = RecordLike | StoredRecording
"""A recording that may stay in its file, too."""
_HEAD = 400
_TEXT_SUFFIXES = (".csv", ".tsv", ".txt")
_RESULTS = {
    b'"kind": "dynid.': "a design or another motion",
    b'"format": "dynid-estimate"': "an estimate",
}
"""What the files begin with that dynid writes and nobody recorded."""
_NEXT = "Pass --robot: a built-in name (dynid robots), a URDF or a robot file."


def robot_reference(name_or_path: str | Path) -> str:
    """What a recording remembers of its robot: a built-in name, or an absolute path."""
    text = str(name_or_path)
    if text.lower() in builtin_names():
        return text.lower()
    return str(Path(text).expanduser().resolve())


def of_robot(record: ExperimentRecord, robot: str | Path) -> ExperimentRecord:
    """The recording, which remembers its robot so that its file is found again."""
    return replace(record, metadata=replace(record.metadata, robot=robot_reference(robot)))


def open_record(
    record: RecordLike, robot: RobotModel, gains: Sequence[float] | None = None
) -> ExperimentRecord:
    """A recording of a robot: our own Parquet, or anything else that can be read without options.

    Args:
        record: The recording or its file, or a folder with the text files of one run.
        robot: The robot it was made on.
        gains: (n) drive gains [N.m/A]; they override those of the recording and of the robot.

    Raises:
        RecordError: Not a recording, or not one of this robot.
        InputError: Gains that do not fit the robot.
    """
    if isinstance(record, ExperimentRecord):
        found = record
    elif not isinstance(record, str | Path):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError("not a recording or its file", value=record)
    elif _was_cut_off(record):
        found = read_record(record)
    else:
        _refuse_results(Path(record))
        try:
            # A folder stands for the text files of one run.
            files = sorted(Path(record).iterdir()) if os.path.isdir(record) else []
            tables = [file for file in files if file.suffix.lower() in _TEXT_SUFFIXES]
            found = read_recording(tables or Path(record), robot=robot)
        except RecordError as error:
            if error.next_step is None or not os.path.exists(record):
                raise
            command = f"dynid import {shlex.quote(str(record))} --robot ROBOT -o RECORD.parquet"
            raise RecordError(
                error.what,
                where=error.where,
                value=error.value,
                limit=error.limit,
                next_step=f"{error.next_step} (Options for reading a file: {command})",
            ) from error
    return found if gains is None else _with_gains(found, robot, gains)


def as_list(records: AnyRecordLike | Sequence[AnyRecordLike]) -> list[AnyRecordLike]:
    """One or several recordings as a list."""
    single = isinstance(records, ExperimentRecord | StoredRecording | str | Path)
    return [records] if single else list(records)


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


def _with_gains(
    record: ExperimentRecord, robot: RobotModel, gains: Sequence[float]
) -> ExperimentRecord:
    """The recording with (n) drive gains of its own [N.m/A].

    Raises:
        InputError: Not one finite gain a joint, other than zero.
    """
    values = tuple(float(gain) for gain in gains)
    if len(values) != robot.joints or not all(math.isfinite(gain) and gain for gain in values):
        raise InputError(
            "one drive gain a joint is needed, finite and not zero [N.m/A]",
            where="--gains",
            value=",".join(f"{gain:g}" for gain in values),
            limit=f"{robot.joints} joints",
        )
    return replace(record, metadata=replace(record.metadata, drive_gains=values))


def known_gains(record: ExperimentRecord, robot: RobotModel) -> tuple[ExperimentRecord, str]:
    """The recording with the drive gains that its torque needs, and where they come from.

    Where neither the recording nor the robot has gains, they are found in the recording itself:
    from the target currents and target moments of the controller. They come from `effort` (no
    gains needed), `recording`, `robot` or `targets`.

    Raises:
        InputError: No gains, and no targets to find them in.
        JobError: Targets that do not show the gain of every joint.
    """
    if "effort" in record.signals:
        return record, "effort"
    if record.metadata.drive_gains is not None:
        return record, "recording"
    if np.isfinite(robot.drives.gain).all():
        return record, "robot"
    if not {"current", *TARGETS} <= set(record.signals):
        raise InputError(
            "torque from current needs drive gains [N.m/A], and neither the robot nor the"
            " recording has them",
            where=robot.name,
            next_step="Pass --gains g1,..,gn, or record target_current and target_moment too.",
        )
    found = identify_gains(record, robot)
    missing = [robot.joint_names[j] for j in np.flatnonzero(~np.isfinite(found.gain))]
    if missing:
        raise JobError(
            "the targets do not determine the drive gain of every joint",
            where=robot.name,
            value=", ".join(missing),
            next_step="Pass --gains g1,..,gn, or record a motion that loads every joint.",
        )
    return _with_gains(record, robot, found.gain.tolist()), "targets"


def open_records(
    paths: Sequence[str | Path],
    robot: str | Path | None = None,
    gains: Sequence[float] | None = None,
) -> tuple[list[ExperimentRecord], RobotModel]:
    """Recordings of one robot, and the robot.

    Args:
        paths: The recordings.
        robot: Built-in name, URDF or robot file; None to take what the recordings say.
        gains: (n) drive gains [N.m/A]; they override those of the recordings and of the robot.

    Raises:
        InputError: No recordings, a robot that is not known, or recordings that do not fit it.
    """
    model = load_robot(stored_robot(paths) if robot is None else robot)
    return [open_record(path, model, gains) for path in paths], model


def stored_robot(paths: Sequence[str | Path]) -> str:
    """The robot that recordings remember.

    Raises:
        InputError: A recording does not say, they disagree, or the robot's file has gone.
    """
    if not paths:
        raise InputError("needs at least one recording")
    found = [_robot_in(path) for path in paths]
    if len(set(found)) > 1:
        value = ", ".join(map(str, found))
        raise InputError("the recordings are of different robots", value=value, next_step=_NEXT)
    name = found[0]
    if name is None:
        raise InputError(
            "the recording does not say which robot it is of", where=str(paths[0]), next_step=_NEXT
        )
    if Path(name).is_absolute() and not Path(name).exists():
        raise InputError(
            "the robot file of the recording does not exist any more",
            where=str(paths[0]),
            value=name,
            next_step=_NEXT,
        )
    return name


def _robot_in(path: str | Path) -> str | None:
    if not os.path.exists(path) and not _was_cut_off(path):
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


def _was_cut_off(path: str | Path) -> bool:
    """Whether only the partial file of a killed writer is there."""
    # os.path says False where Path raises, as for names that no file can have.
    return not os.path.exists(path) and os.path.isfile(f"{path}.partial")


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """Options for files that are not self-describing; see `read_recording`."""

    format: str = "auto"
    """One of the formats of `dynid import`, or `auto`."""
    columns: str | Mapping[str, str] | None = None
    """As `t=0,q=1:7,current=7:13`."""
    header: bool | None = None
    """False: the first line is numbers; None: find out."""
    delimiter: str | None = None
    """Between the cells of a text table."""
    gains: tuple[float, ...] | None = None
    """Drive gains [N.m/A]; they override the robot's."""
    rate_hz: float | None = None
    """The clock of a file without time stamps [Hz]."""
    degrees: bool = False
    """Angles without a unit are in degrees."""
    joint_order: tuple[str, ...] | None = None
    """The file's joints from base to tip: numbers or names."""
    topic: str | None = None
    """Topic of a bag."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """A recording, and the file it was written to."""

    record: ExperimentRecord
    path: Path
    needs: tuple[str, ...] = ()
    """What identification needs beside it, in words."""

    def to_json(self) -> dict[str, Any]:
        """The keys of the design, and what else was found."""
        record, metadata = self.record, self.record.metadata
        return {
            "record": str(self.path),
            "robot": metadata.robot,
            "format": metadata.format,
            "samples": record.samples,
            "joints": record.joints,
            "joint_names": list(metadata.joint_names),
            "rate_hz": record.rate_hz,
            "duration_s": record.duration_s,
            "clock": metadata.clock,
            "signals": list(record.signals),
            "channels": list(record.channels),
            "drive_gains": None if metadata.drive_gains is None else list(metadata.drive_gains),
            "dropped_rows": metadata.dropped_rows,
            "problems": told(record.problems),
            "findings": [finding.to_json() for finding in record.problems],
            "notes": metadata.extra.get("notes", ""),
            "needs": list(self.needs),
        }


def import_recording(
    files: Sequence[str | Path],
    output: str | Path,
    *,
    robot: str | Path | None = None,
    options: ImportOptions | None = None,
    force: bool = False,
) -> Imported:
    """Read a recording in any format, repair it and write it as a dynid recording.

    Args:
        files: One file; or text files side by side; or the files of one split bag.
        output: The Parquet file to write; it appears whole or not at all.
        robot: Built-in name, URDF or robot file. Without one, nothing is checked against the
            robot, motor signals stay as they are, and `identify` has to be told the robot.
        options: How to read the files.
        force: Whether an existing file is replaced.

    Raises:
        InputError: A robot or recording that cannot be read, or a place where no such file can
            be.
        JobError: The disk does not take the recording.
    """
    require_absent(Path(output), force=force)
    model = None if robot is None else load_robot(robot)
    how = asdict(options or ImportOptions())
    record = read_recording([Path(file) for file in files], robot=model, **how)
    if robot is not None:
        record = of_robot(record, robot)
    write_record(record, output, force=force)
    return Imported(record=record, path=Path(output), needs=tuple(_needs(record, model)))


def _needs(record: ExperimentRecord, robot: RobotModel | None) -> Iterator[str]:
    """What identification would refuse a recording for."""
    if record.metadata.robot is None:
        yield f"the recording does not say which robot it is of. {_NEXT}"
    if robot is not None:
        try:
            known_gains(record, robot)
        except (InputError, JobError) as error:
            yield f"{error.what}. {error.next_step}"
