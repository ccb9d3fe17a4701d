"""The compiled kinematics of a chain of revolute joints."""

from __future__ import annotations

import numpy as np
from numba import njit

from dynid.core import Array


@njit(cache=True)
def chain(
    placements: Array, axes: Array, q: Array, tip: Array, tool: Array, jacobian: Array, elbow: Array
) -> None:
    """The tool in the base frame and its velocity per joint speed.

    Args:
        placements: (n, 4, 4) joint frames in the previous one at q = 0 [m].
        axes: (n, 3) unit axes in the joint frames.
        q: (n) joint positions [rad].
        tip: (4, 4) tool in the last joint frame [m].
        tool: (4, 4) tool in the base frame, filled [m].
        jacobian: (6, n) linear, then angular velocity in the base frame, filled.
        elbow: (n, 3) origins of the joint frames in the base frame, filled [m].
    """
    n = len(q)
    pose = np.eye(4)
    turns = np.empty((n, 3))
    turn = np.empty((3, 3))
    moved = np.empty((3, 3))
    for k in range(n):
        pose = pose @ placements[k]
        x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
        c, s = np.cos(q[k]), np.sin(q[k])
        d = 1.0 - c
        turn[0, 0], turn[0, 1], turn[0, 2] = c + d * x * x, d * x * y - s * z, d * x * z + s * y
        turn[1, 0], turn[1, 1], turn[1, 2] = d * x * y + s * z, c + d * y * y, d * y * z - s * x
        turn[2, 0], turn[2, 1], turn[2, 2] = d * x * z - s * y, d * y * z + s * x, c + d * z * z
        for i in range(3):
            turns[k, i] = pose[i, 0] * x + pose[i, 1] * y + pose[i, 2] * z
            elbow[k, i] = pose[i, 3]
            for j in range(3):
                moved[i, j] = (
                    pose[i, 0] * turn[0, j] + pose[i, 1] * turn[1, j] + pose[i, 2] * turn[2, j]
                )
        pose[:3, :3] = moved
    pose = pose @ tip
    tool[:, :] = pose
    for k in range(n):
        a, b, c = turns[k, 0], turns[k, 1], turns[k, 2]
        u = pose[0, 3] - elbow[k, 0]
        v = pose[1, 3] - elbow[k, 1]
        w = pose[2, 3] - elbow[k, 2]
        jacobian[0, k], jacobian[1, k], jacobian[2, k] = b * w - c * v, c * u - a * w, a * v - b * u
        jacobian[3, k], jacobian[4, k], jacobian[5, k] = a, b, c
