"""Joint torque from what was recorded: effort, or current times drive gain."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.recording.record import ExperimentRecord
from dynid.robot.model import RobotModel


def measured_torque(record: ExperimentRecord, robot: RobotModel) -> Array:
    """Joint torques (N, n) [N.m or N] of a recording.

    Effort wins over current. Gains given with the recording win over the robot's.

    Raises:
        InputError: The joint counts differ, neither effort nor current was recorded, or a
            drive gain is missing.
    """
    if record.joints != robot.joints:
        raise InputError(
            f"the recording has {record.joints} joints, the robot {robot.name} has {robot.joints}",
            next_step="Pass the right --robot, or lock the joints that were not recorded.",
        )
    if "effort" in record.signals:
        return record.signals["effort"]
    if "current" not in record.signals:
        raise InputError(
            "the recording has neither effort nor current",
            value=", ".join(record.signals),
            next_step="Import it again with --columns ...,effort=A:B or current=A:B.",
        )
    given = record.metadata.drive_gains
    gains = robot.drives.gain if given is None else np.array(given, dtype=np.float64)
    if len(gains) != robot.joints:
        raise InputError("one drive gain a joint is needed", value=len(gains), limit=robot.joints)
    missing = [robot.joint_names[j] for j in np.flatnonzero(~np.isfinite(gains))]
    if missing:
        raise InputError(
            "torque from current needs drive gains [N.m/A]",
            where=robot.name,
            value=f"no gain for {', '.join(missing)}",
            next_step="Pass --gains g1,..,gn at import, or record effort.",
        )
    return record.signals["current"] * gains
