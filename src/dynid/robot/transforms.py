"""Rigid transforms as 4x4 matrices, exact where the angle is a multiple of 90 degrees."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dynid.core.arrays import Array

_EXACT_WITHIN = 1e-12
"""Angles this close to a multiple of 90 degrees are that multiple [rad]: a float pi/2 is not."""


def cos_sin(angle: float) -> tuple[float, float]:
    """Cosine and sine, with exact zeros and ones at multiples of 90 degrees.

    Args:
        angle: Angle [rad].
    """
    quarter = round(angle / (math.pi / 2))
    if abs(angle - quarter * math.pi / 2) <= _EXACT_WITHIN:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarter % 4]
    return math.cos(angle), math.sin(angle)


def translation(x: float, y: float, z: float) -> Array:
    """A pure translation [m]."""
    matrix = np.eye(4)
    matrix[:3, 3] = (x, y, z)
    return matrix


def rotation_x(angle: float) -> Array:
    """A rotation about x by `angle` [rad]."""
    c, s = cos_sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]], dtype=np.float64)


def rotation_y(angle: float) -> Array:
    """A rotation about y by `angle` [rad]."""
    c, s = cos_sin(angle)
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]], dtype=np.float64)


def rotation_z(angle: float) -> Array:
    """A rotation about z by `angle` [rad]."""
    c, s = cos_sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=np.float64)


def from_xyz_rpy(xyz: Sequence[float], rpy: Sequence[float]) -> Array:
    """The transform of a URDF `origin`.

    Args:
        xyz: Three coordinates [m].
        rpy: Roll, pitch and yaw about the fixed axes x, y, z, in that order [rad].
    """
    return (
        translation(xyz[0], xyz[1], xyz[2])
        @ rotation_z(rpy[2])
        @ rotation_y(rpy[1])
        @ rotation_x(rpy[0])
    )


def from_axes(x: Array, z: Array, origin: Array) -> Array:
    """The frame with these x (3) and z (3) axes and this origin (3) [m]."""
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = x, np.cross(z, x), z
    matrix[:3, 3] = origin
    return matrix


def inverse(matrix: Array) -> Array:
    """The inverse of rigid transforms (..., 4, 4)."""
    rotation = matrix[..., :3, :3].swapaxes(-1, -2)
    result = np.zeros_like(matrix)
    result[..., :3, :3] = rotation
    result[..., :3, 3] = -(rotation @ matrix[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def joint_motion(axis: Array, prismatic: bool, position: Array | float) -> Array:
    """The transform that joints make at given positions.

    Args:
        axis: (3) unit axis.
        prismatic: Whether the joint slides along the axis instead of turning about it.
        position: (...) positions [rad or m].

    Returns:
        (..., 4, 4) transforms.
    """
    position = np.asarray(position, dtype=np.float64)
    result = np.zeros((*position.shape, 4, 4))
    result[..., 3, 3] = 1.0
    if prismatic:
        result[..., :3, :3] = np.eye(3)
        result[..., :3, 3] = position[..., None] * axis
        return result
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=np.float64)
    sine, cosine = np.sin(position), np.cos(position)
    result[..., :3, :3] = (
        cosine[..., None, None] * np.eye(3)
        + sine[..., None, None] * cross
        + (1 - cosine)[..., None, None] * np.outer(axis, axis)
    )
    return result
