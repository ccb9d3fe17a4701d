"""`dynid import`: a foreign recording becomes ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dynid.recording.files import read_recording
from dynid.recording.parquet import write_record
from dynid.recording.record import ExperimentRecord
from dynid.robot.load import load_robot
from dynid.workflow.recordings import robot_reference


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """How to read a file that does not say everything itself; see `read_recording`."""

    format: str = "auto"
    columns: str | Mapping[str, str] | None = None
    header: bool | None = None
    """False: the first line is numbers; None: find out."""
    delimiter: str | None = None
    gains: tuple[float, ...] | None = None
    """Drive gains [N.m/A]; they override the robot's."""
    rate_hz: float | None = None
    """The clock of a file without time stamps [Hz]."""
    degrees: bool = False
    joint_order: tuple[str, ...] | None = None
    topic: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """A recording, and the file it was written to."""

    record: ExperimentRecord
    path: Path

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
            "problems": [notice.to_json() for notice in record.problems],
            "notes": metadata.extra.get("notes", ""),
        }


def import_recording(
    files: Sequence[str | Path],
    output: str | Path,
    *,
    robot: str | Path | None = None,
    options: ImportOptions | None = None,
) -> Imported:
    """Read a recording in any format, repair it, write it as ours.

    Args:
        files: One file; or text files side by side; or the files of one split bag.
        output: The Parquet file to write; it appears whole or not at all.
        robot: Built-in name, URDF or robot file. Without one, nothing is checked against the
            robot, motor signals stay as they are, and `identify` has to be told the robot.
        options: How to read the files.

    Raises:
        InputError: A robot or recording that cannot be read, or a place where no such file can
            be.
        JobError: The disk does not take the recording.
    """
    how = options or ImportOptions()
    record = read_recording(
        [Path(file) for file in files],
        robot=None if robot is None else load_robot(robot),
        format=how.format,
        columns=how.columns,
        header=how.header,
        delimiter=how.delimiter,
        gains=how.gains,
        rate_hz=how.rate_hz,
        degrees=how.degrees,
        joint_order=how.joint_order,
        topic=how.topic,
    )
    if robot is not None:
        # The name alone would not find a robot file again.
        metadata = replace(record.metadata, robot=robot_reference(robot))
        record = replace(record, metadata=metadata)
    write_record(record, output)
    return Imported(record=record, path=Path(output))
