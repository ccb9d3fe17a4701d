"""Where each joint frame stands in the previous one, as a sum of three fixed matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.robot.model import RobotModel


@dataclass(frozen=True, slots=True, kw_only=True)
class JointTurns:
    """Rotation fixed + sine sin(q) + cosine cos(q) and place origin + slide q of each joint.

    Rodrigues' formula with the placement multiplied in: the generated code needs no more.
    """

    fixed: Array
    """(n, 3, 3)"""
    sine: Array
    """(n, 3, 3) zero where the joint slides."""
    cosine: Array
    """(n, 3, 3) zero where the joint slides."""
    origin: Array
    """(n, 3) [m]"""
    slide: Array
    """(n, 3) unit vector where the joint slides, zero where it turns."""


def joint_turns(robot: RobotModel) -> JointTurns:
    """The matrices of a robot."""
    n = robot.joints
    fixed, sine, cosine = (np.zeros((n, 3, 3)) for _ in range(3))
    slide = np.zeros((n, 3))
    for i, (placement, axis) in enumerate(zip(robot.placements, robot.axes, strict=True)):
        rotation = placement[:3, :3]
        if robot.prismatic[i]:
            fixed[i], slide[i] = rotation, rotation @ axis
            continue
        x, y, z = axis
        along = np.outer(axis, axis)
        fixed[i] = rotation @ along
        sine[i] = rotation @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        cosine[i] = rotation @ (np.eye(3) - along)
    return JointTurns(
        fixed=fixed, sine=sine, cosine=cosine, origin=robot.placements[:, :3, 3], slide=slide
    )
