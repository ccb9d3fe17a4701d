"""One door for every recording: find out what a file is, read it, repair it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from dynid.core import RecordError, file_hash
from dynid.recording.csv import read_csv
from dynid.recording.detect import FORMATS, content_kind
from dynid.recording.frame import read_frame
from dynid.recording.given import given_files
from dynid.recording.hdf5 import read_hdf5
from dynid.recording.jsonfile import read_json
from dynid.recording.mat import read_mat
from dynid.recording.npz import read_npz
from dynid.recording.opening import unreadable
from dynid.recording.own import read_own
from dynid.recording.record import ExperimentRecord
from dynid.recording.repair.pipeline import RepairSettings, repair
from dynid.recording.rosbag import read_bag
from dynid.recording.table import RawTable
from dynid.recording.unpack import unpacked
from dynid.robot import RobotModel

_TEXT = ("auto", "csv", "ur-csv", "ur-rtde-csv")

MAX_RATE_HZ = 1e6


def read_recording(
    paths: str | Path | Sequence[str | Path],
    *,
    robot: RobotModel | None = None,
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
        robot: The robot: its number of joints, names, limits, and drives. Where its drives
            say so, motor positions and torques become joint values.
        format: `auto` (by content, then by extension), `ur-csv`, `ur-rtde-csv`, `csv`,
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
    given = given_files(paths)
    known = _gains(gains)
    if rate_hz is not None and not 0 < rate_hz < MAX_RATE_HZ:
        raise RecordError(
            "the rate must be positive and finite",
            where="--rate",
            value=rate_hz,
            limit=f"0 to {MAX_RATE_HZ:g} Hz",
        )
    settings = RepairSettings(
        robot=robot,
        gains=known,
        rate_hz=rate_hz,
        degrees=degrees,
        joint_order=tuple(joint_order) if joint_order is not None else None,
    )
    with unpacked(given) as files:
        kind = _format(files, format)
        if kind == "parquet":
            if columns is not None or degrees or joint_order is not None:
                raise RecordError(
                    "a dynid recording is complete: columns, degrees and joint order do not apply",
                    where=files[0].name,
                )
            return read_own(files, robot, known)
        order = settings.joint_order
        table = _read(files, kind, robot, columns, header, delimiter, topic, order)
    record = repair(table, settings)
    metadata = replace(
        record.metadata, origin=", ".join(str(file) for file in given), input_hash=_hash(given)
    )
    return replace(record, metadata=metadata)


def _format(files: list[Path], wanted: str) -> str:
    """The format to read; `auto` for any text, whose header says more."""
    if wanted not in ("auto", *FORMATS):
        raise RecordError("unknown format", value=wanted, limit=("auto", *FORMATS))
    kinds = {content_kind(file) for file in files}
    kind = min(kinds)
    if len(kinds) > 1 and not kinds <= {"rosbag", "mcap"}:
        raise RecordError(
            "files of different formats cannot stand side by side", value=sorted(kinds)
        )
    if len(files) > 1 and kind not in ("csv", "rosbag", "mcap"):
        raise RecordError(
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
        raise RecordError(
            f"the content is {kind}, not {wanted}",
            where=files[0].name,
            next_step="Leave --format out to go by the content.",
        )
    return wanted


def _gains(gains: Sequence[float] | None) -> tuple[float, ...] | None:
    if gains is None:
        return None
    try:
        return tuple(float(gain) for gain in gains)
    except (TypeError, ValueError) as error:
        raise RecordError("drive gains must be numbers", value=gains) from error


def _read(
    files: list[Path],
    kind: str,
    robot: RobotModel | None,
    columns: str | Mapping[str, str] | None,
    header: bool | None,
    delimiter: str | None,
    topic: str | None,
    order: tuple[str, ...] | None,
) -> RawTable:
    joints = robot.joints if robot is not None else None
    names = robot.joint_names if robot is not None else ()
    if kind in _TEXT:
        return read_csv(
            files,
            joints=names,
            columns=columns,
            header=header,
            delimiter=delimiter,
            format=kind,
        )
    if kind in ("rosbag", "mcap"):
        return read_bag(
            files,
            joints=names,
            columns=columns,
            topic=topic,
            joint_order=order,
            format=kind,
        )
    if kind == "arrow":
        return read_frame(files[0], joints=names, columns=columns)
    if kind == "json":
        return read_json(files[0], columns=columns, joints=joints, names=names)
    if kind == "hdf5":
        return read_hdf5(files[0], columns=columns, joints=joints, names=names)
    if kind == "npz":
        return read_npz(files[0], columns=columns, joints=joints, names=names)
    return read_mat(files[0], columns=columns, joints=joints, names=names)


def _hash(files: list[Path]) -> str:
    """SHA-256 of the file; of several, of their hashes one after the other."""
    try:
        hashes = [file_hash(file) for file in files]
    except OSError as error:
        raise unreadable(files[0], error) from error
    return hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()
