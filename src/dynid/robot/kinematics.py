"""Where the joint frames are."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array
from dynid.core.errors import RobotError
from dynid.robot.model import RobotModel
from dynid.robot.transforms import joint_motion


def joint_poses(robot: RobotModel, q: ArrayLike) -> Array:
    """The joint frames in the base frame.

    Args:
        robot: The robot.
        q: (..., n) joint positions [rad or m].

    Returns:
        (..., n, 4, 4) poses [m].

    Raises:
        RobotError: The last axis of `q` is not n long.
    """
    positions = np.asarray(q, dtype=np.float64)
    if positions.shape[-1:] != (robot.joints,):
        raise RobotError(
            "joint positions do not fit the robot", value=positions.shape, limit=robot.joints
        )
    poses = np.empty((*positions.shape, 4, 4))
    pose: Array = np.eye(4)
    for k in range(robot.joints):
        motion = joint_motion(robot.axes[k], robot.prismatic[k], positions[..., k])
        pose = pose @ robot.placements[k] @ motion
        poses[..., k, :, :] = pose
    return poses


def flange_pose(robot: RobotModel, q: ArrayLike) -> Array:
    """The flange in the base frame (..., 4, 4) at q (..., n).

    Raises:
        RobotError: The last axis of `q` is not n long.
    """
    return joint_poses(robot, q)[..., -1, :, :] @ robot.flange
