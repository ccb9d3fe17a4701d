"""The inertial columns of the regressor, batched over samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, read_only
from dynid.regressor.inertial_kernel import LANES, Places, column_kernel
from dynid.regressor.trigonometry import turns
from dynid.robot.model import RobotModel


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainConstants:
    """What the kernel needs of a robot, for one choice of parameter frames."""

    geometry: Array
    """(n, 39) R0, R1, R2 (row-major), p0, p1, p2, p3: parameter frame i in frame i - 1 is
    R = R0 + R1 cos q + R2 sin q, p = p0 + p1 cos q + p2 sin q + p3 q."""
    screws: Array
    """(n, 6) joint axis in its own parameter frame: angular, then linear part."""
    gravity: Array
    """(3) [m/s^2] in the base frame."""


def chain_constants(robot: RobotModel, frames: str) -> ChainConstants:
    """The constants of `robot` with parameters expressed in the frames `frames`."""
    n = robot.joints
    geometry = np.zeros((n, 39))
    screws = np.zeros((n, 6))
    previous = np.eye(4)
    for i in range(n):
        link = robot.parameter_frames[frames][i]
        before = np.linalg.inv(previous) @ robot.placements[i]
        axis = robot.axes[i]
        cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        outer = np.outer(axis, axis)
        if robot.prismatic[i]:
            turns = (np.eye(3), np.zeros((3, 3)), np.zeros((3, 3)))
            screws[i, 3:] = link[:3, :3].T @ axis
            geometry[i, 36:39] = before[:3, :3] @ axis
        else:
            turns = (outer, np.eye(3) - outer, cross)
            screws[i, :3] = link[:3, :3].T @ axis
            screws[i, 3:] = np.cross(screws[i, :3], link[:3, :3].T @ link[:3, 3])
        for k, turn in enumerate(turns):
            geometry[i, 9 * k : 9 * k + 9] = (before[:3, :3] @ turn @ link[:3, :3]).ravel()
            geometry[i, 27 + 3 * k : 30 + 3 * k] = before[:3, :3] @ turn @ link[:3, 3]
        geometry[i, 27:30] += before[:3, 3]
        previous = link
    return ChainConstants(
        geometry=read_only(geometry), screws=read_only(screws), gravity=robot.gravity
    )


def inertial_columns(
    constants: ChainConstants, q: Array, dq: Array, ddq: Array, out: Array | None = None
) -> Array:
    """The inertial columns for a batch of states.

    Shapes are not checked here and the compiled kernel trusts them; `InverseDynamicModel.stack`
    checks.

    Args:
        constants: From `chain_constants`.
        q: (n, N) positions [rad or m], contiguous like the next two.
        dq: (n, N) velocities.
        ddq: (n, N) accelerations.
        out: (10 n, n, N) where to write; entries that are structurally zero are left alone.

    Returns:
        (10 n, n, N): column (link-major, paper order), joint row, sample.
    """
    n, samples = q.shape
    if out is None:
        out = np.zeros((10 * n, n, samples))
    if samples < LANES:
        state = np.zeros((3, n, LANES))
        state[:, :, :samples] = q, dq, ddq
        out[:] = inertial_columns(constants, *state)[:, :, :samples]
        return out
    if not out.flags.c_contiguous:
        out[:] = inertial_columns(constants, q, dq, ddq, out.copy())
        return out
    rows = out.reshape(10 * n * n, samples)
    inertial_rows(constants, turns(q), q, dq, ddq, rows, every_row(n))
    return out


def every_row(joints: int) -> Places:
    """(n, n, 10) where `inertial_columns` keeps the entries of link i, joint row k, parameter c."""
    link, row, parameter = np.ogrid[:joints, :joints, :10]
    return np.where(row <= link, (10 * link + parameter) * joints + row, -1)


def inertial_rows(
    constants: ChainConstants,
    turn: Array,
    q: Array,
    dq: Array,
    ddq: Array,
    out: Array,
    places: Places,
) -> None:
    """Chosen entries of the inertial columns, in any order.

    Args:
        constants: From `chain_constants`.
        turn: (2, n, N) from `turns`, cosine and sine of q.
        q: (n, N) positions [rad or m], contiguous like the next three; N is `LANES` or more.
        dq: (n, N) velocities.
        ddq: (n, N) accelerations.
        out: (R, N) where to write; rows that no place names are left alone.
        places: (n, n, 10) the row of out for link i, joint row k up to i, parameter c; below 0
            for none.
    """
    geometry, screws, gravity = constants.geometry, constants.screws, constants.gravity
    column_kernel(geometry, screws, gravity, turn, q, dq, ddq, out, places)
