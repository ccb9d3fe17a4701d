"""Rotations in the forms that robot files use."""

from __future__ import annotations

import math

import numpy as np

from dynid.core.arrays import Array


def roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """Angles about the fixed axes x, y, z, in that order [rad], as URDF has them.

    Args:
        rotation: (3, 3) rotation.
    """
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    # Of the rotation turned back by the yaw: near upright, where the yaw is all rounding, the
    # roll takes its error back.
    roll = math.atan2(
        s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1]
    )
    return roll, pitch, yaw


def quaternion(rotation: Array) -> Array:
    """(4) w, x, y, z of a rotation (3, 3), w not negative."""
    # The eigenvector of Bar-Itzhack's symmetric matrix: no case is badly conditioned.
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    matrix = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, b + d, c + g],
            [c - g, b + d, e - a - i, f + h],
            [d - b, c + g, f + h, i - a - e],
        ]
    )
    largest: Array = np.linalg.eigh(matrix)[1][:, -1]
    return np.copysign(1.0, largest[0]) * largest


def upright(gravity: Array) -> Array:
    """(3, 3) the rotation that takes a gravity vector (3) to straight down, -z."""
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        return np.eye(3)
    z = -gravity / size
    if z[2] > 1.0 - 1e-15:
        return np.eye(3)
    helper = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    across = helper - (helper @ z) * z
    x = across / float(np.linalg.norm(across))
    return np.array([x, np.cross(z, x), z], dtype=np.float64)
