"""Our own recordings, read again for a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from dynid.core import RecordError
from dynid.recording.parquet import read_record
from dynid.recording.record import ExperimentRecord
from dynid.robot import RobotModel


def read_own(
    files: Sequence[Path], robot: RobotModel | None, gains: tuple[float, ...] | None
) -> ExperimentRecord:
    """Read a Parquet recording of ours and fit it to a robot.

    Args:
        files: The one file.
        robot: The robot; its joints must be those of the recording.
        gains: Drive gains [N.m/A] that override those of the recording.

    Raises:
        RecordError: Foreign or damaged, or another number of joints or gains.
    """
    record = read_record(files[0])
    if robot is not None:
        if record.joints != robot.joints:
            raise RecordError(
                f"the recording has {record.joints} joints but {robot.name} has {robot.joints}",
                where=files[0].name,
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
