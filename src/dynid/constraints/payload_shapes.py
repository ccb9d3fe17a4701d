"""Capsules around what the flange carries."""

from __future__ import annotations

import numpy as np

from dynid.constraints.shapes import BOX, SPHERE, Shape
from dynid.robot.capsule import Capsule
from dynid.robot.model import RobotModel


def payload_capsules(robot: RobotModel, payload: tuple[Shape, ...]) -> tuple[Capsule, ...]:
    """A capsule on the last link around each shape (in the flange's frame)."""
    return tuple(_enclosing(robot, shape) for shape in payload)


def _enclosing(robot: RobotModel, shape: Shape) -> Capsule:
    pose = robot.flange @ shape.pose
    if shape.kind == SPHERE:
        along, radius = np.zeros(3), float(shape.size[0])
    elif shape.kind == BOX:
        longest = int(np.argmax(shape.size))
        along = pose[:3, longest] * shape.size[longest]
        radius = float(np.linalg.norm(np.delete(shape.size, longest)))
    else:
        along, radius = pose[:3, 2] * shape.size[1], float(shape.size[0])
    return Capsule(
        name=f"payload {shape.name}",
        link=robot.joints,
        start=pose[:3, 3] - along,
        end=pose[:3, 3] + along,
        radius=radius,
    )
