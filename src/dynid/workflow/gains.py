"""`dynid gains`: drive gains from the controller's own targets."""

from __future__ import annotations

from dynid.core.errors import InputError
from dynid.identification.drive_gains import WIDTH, DriveGains, drive_gains
from dynid.recording.record import ExperimentRecord
from dynid.robot.load import load_robot
from dynid.robot.model import RobotModel

_NEEDED = ("target_current", "target_moment")


def identify_gains(
    record: ExperimentRecord, robot: RobotModel | str, *, width: float = WIDTH
) -> DriveGains:
    """Drive gains from a recording of target currents and target moments.

    Target velocities are used where they were recorded: the controller's friction follows them,
    without the noise of measured ones.

    Args:
        record: The recording.
        robot: The robot, or its name or file.
        width: Speed over which the controller's dry friction changes sign [rad/s].

    Raises:
        InputError: A recording without targets or velocities, or of another number of joints.
        JobError: No joint's gain can be told.
    """
    model = robot if isinstance(robot, RobotModel) else load_robot(robot)
    if record.joints != model.joints:
        raise InputError(
            "the recording is of another robot", value=record.joints, limit=model.joints
        )
    missing = [name for name in _NEEDED if name not in record.signals]
    velocity = record.signals.get("target_qd", record.signals.get("qd"))
    if velocity is None:
        missing.append("target_qd or qd")
    if missing or velocity is None:
        raise InputError(
            "drive gains need the controller's own targets",
            value=f"no {', '.join(missing)}",
            next_step="Record with dynid run, or import with --columns ...,target_current=A:B.",
        )
    return drive_gains(
        record.signals["target_current"],
        record.signals["target_moment"],
        velocity,
        rate_hz=record.rate_hz,
        names=model.joint_names,
        width=width,
    )
