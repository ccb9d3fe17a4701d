"""Arithmetic of poses."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np

from dynid.core import Array
from dynid.robot import from_xyz_rpy, inverse
from dynid.simulation.controller.motion_poses import (
    rotation_matrix,
    rotation_vector,
    to_matrix,
    to_pose,
)
from dynid.simulation.controller.urscript.builtin import Builtin, Kind, builtin
from dynid.simulation.controller.urscript.errors import ScriptFault
from dynid.simulation.controller.urscript.values import Pose, Value, described, number

_WEIGHT = 400


def matrix_of(pose: Value) -> Array:
    """(4, 4) the transform of a script's pose.

    Raises:
        ScriptFault: No pose.
    """
    return to_matrix(numbers(pose, 6, "a pose"))


def numbers(value: Value, count: int, what: str) -> list[float]:
    """A list of so many numbers.

    Raises:
        ScriptFault: It is none.
    """
    items = cast("list[Any]", value) if isinstance(value, list) else []
    if len(items) != count:
        raise ScriptFault(f"{what} of {count} numbers expected", value=described(value))
    return [float(number(item)) for item in items]


def pose_of(matrix: Array) -> Pose:
    """The script's pose of a transform (4, 4)."""
    return Pose(to_pose(matrix))


def _pose_trans(p_from: Value, p_from_to: Value) -> Pose:
    return pose_of(matrix_of(p_from) @ matrix_of(p_from_to))


def inverse_pose(p_from: Value) -> Pose:
    """The way back.

    Raises:
        ScriptFault: No pose.
    """
    return pose_of(inverse(matrix_of(p_from)))


def _pose_add(p_1: Value, p_2: Value) -> Pose:
    first, second = matrix_of(p_1), matrix_of(p_2)
    return _apart(first[:3, 3] + second[:3, 3], first[:3, :3] @ second[:3, :3])


def _pose_sub(p_to: Value, p_from: Value) -> Pose:
    goal, start = matrix_of(p_to), matrix_of(p_from)
    return _apart(goal[:3, 3] - start[:3, 3], goal[:3, :3] @ start[:3, :3].T)


def _pose_dist(p_from: Value, p_to: Value) -> float:
    return math.sqrt(sum(value * value for value in _pose_sub(p_to, p_from)))


def _point_dist(p_from: Value, p_to: Value) -> float:
    return math.dist(numbers(p_from, 6, "a pose")[:3], numbers(p_to, 6, "a pose")[:3])


def _interpolate_pose(p_from: Value, p_to: Value, alpha: Value) -> Pose:
    start, goal, share = matrix_of(p_from), matrix_of(p_to), number(alpha)
    turn = share * rotation_vector(goal[:3, :3] @ start[:3, :3].T)
    place = start[:3, 3] + share * (goal[:3, 3] - start[:3, 3])
    return _apart(place, rotation_matrix(turn.tolist()) @ start[:3, :3])


def _rpy2rotvec(rpy_vector: Value) -> Value:
    turned = from_xyz_rpy((0.0, 0.0, 0.0), numbers(rpy_vector, 3, "angles"))
    return rotation_vector(turned[:3, :3]).tolist()


def _rotvec2rpy(rotation_vector: Value) -> Value:
    matrix = rotation_matrix(numbers(rotation_vector, 3, "a rotation vector"))
    level = math.hypot(matrix[0, 0], matrix[1, 0])
    if level < 1e-9:
        # Roll and yaw turn about the same axis: all of it is called roll.
        turn = math.atan2(-matrix[1, 2], matrix[1, 1])
        return [turn, math.atan2(-matrix[2, 0], level), 0.0]
    return [
        math.atan2(matrix[2, 1], matrix[2, 2]),
        math.atan2(-matrix[2, 0], level),
        math.atan2(matrix[1, 0], matrix[0, 0]),
    ]


def _apart(place: Array, rotation: Array) -> Pose:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place
    return pose_of(matrix)


_TABLE: dict[str, Any] = {
    "pose_trans": _pose_trans,
    "pose_inv": inverse_pose,
    "pose_add": _pose_add,
    "pose_sub": _pose_sub,
    "pose_dist": _pose_dist,
    "point_dist": _point_dist,
    "interpolate_pose": _interpolate_pose,
    "rpy2rotvec": _rpy2rotvec,
    "rotvec2rpy": _rotvec2rpy,
}
POSES: list[Builtin] = [
    builtin(function, Kind.PURE, name=name, weight=_WEIGHT) for name, function in _TABLE.items()
]
"""Built-ins for poses."""
