"""A robot of which only the kinematics are known yet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import RobotError
from dynid.robot.drives import direct_drives
from dynid.robot.frames import parameter_frames
from dynid.robot.limits import unknown_limits
from dynid.robot.model import RobotModel
from dynid.robot.mount import mount_gravity

MAX_JOINTS = 64
"""More joints than this are a mistake in the file, not an arm."""


def robot_from_chain(
    *,
    placements: Array,
    axes: Array,
    name: str = "robot",
    joint_names: Sequence[str] | None = None,
    joint_types: Sequence[str] | None = None,
    flange: Array | None = None,
    frames: Mapping[str, Array] | None = None,
    default_frames: str = "urdf",
    notes: tuple[str, ...] = (),
) -> RobotModel:
    """A robot standing on the floor, with limits, drives and inertias left unknown.

    Args:
        placements: (n, 4, 4) joint frames in the previous ones at q = 0 [m].
        axes: (n, 3) unit axes in the joint frames.
        name: Name of the robot.
        joint_names: n names; None for joint_1 ... joint_n.
        joint_types: n times `revolute` or `prismatic`; None for all revolute.
        flange: (4, 4) the chain's end in the last joint frame; None for the same.
        frames: Convention to (n, 4, 4) parameter frames in the joint frames; None to compute
            `dh`, `mdh` and `urdf` from the geometry.
        default_frames: The convention used when none is asked for.
        notes: What was decided while reading.

    Raises:
        RobotError: No joints, too many, or names, types, axes or transforms that do not fit.
        InputError: Arrays of a wrong shape or not finite.
    """
    n = len(placements)
    if not 0 < n <= MAX_JOINTS:
        raise RobotError("number of joints", where=name, value=n, limit=f"1 to {MAX_JOINTS}")
    end = np.eye(4) if flange is None else flange
    return RobotModel(
        name=name,
        joint_names=tuple(joint_names or [f"joint_{k + 1}" for k in range(n)]),
        joint_types=tuple(joint_types or ["revolute"] * n),
        placements=placements,
        axes=axes,
        flange=end,
        parameter_frames=frames or parameter_frames(placements, axes, end),
        default_frames=default_frames,
        gravity=mount_gravity("floor"),
        limits=unknown_limits(n),
        drives=direct_drives(n),
        inertias=np.full((n, 10), np.nan),
        notes=notes,
    )
