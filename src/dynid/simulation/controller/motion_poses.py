"""Poses as UR writes them: x, y, z and a rotation vector."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dynid.core import Array

_SMALL = 1e-12
_PI_ZONE = 1e-4


def rotation_matrix(vector: Sequence[float]) -> Array:
    """(3, 3) the rotation of a rotation vector (3) [rad] (Rodrigues)."""
    x, y, z = (float(value) for value in vector)
    angle = math.sqrt(x * x + y * y + z * z)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < _SMALL:
        return np.eye(3) + cross
    near, far = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2
    return np.eye(3) + near * cross + far * (cross @ cross)


def rotation_vector(matrix: Array) -> Array:
    """(3) the rotation vector of a rotation matrix (3, 3) [rad], no longer than pi."""
    skew = 0.5 * np.array(
        [matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]
    )
    sine = float(np.linalg.norm(skew))
    cosine = 0.5 * (float(np.trace(matrix)) - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > _PI_ZONE or cosine > 0:
        return skew * (angle / sine) if sine > _SMALL else skew
    # Close to half a turn the skew part vanishes; the symmetric part still knows the axis.
    symmetric = 0.5 * (matrix + matrix.T) - cosine * np.eye(3)
    column = int(np.argmax(np.diag(symmetric)))
    axis = symmetric[:, column] / np.linalg.norm(symmetric[:, column])
    return angle * (axis if axis @ skew >= 0 else -axis)


def to_matrix(pose: Sequence[float]) -> Array:
    """(4, 4) the transform of a UR pose x, y, z, rx, ry, rz [m, rad]."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(pose[3:6])
    matrix[:3, 3] = [float(value) for value in pose[:3]]
    return matrix


def to_pose(matrix: Array) -> list[float]:
    """x, y, z, rx, ry, rz of a transform (4, 4) [m, rad]."""
    return [*matrix[:3, 3].tolist(), *rotation_vector(matrix[:3, :3]).tolist()]
