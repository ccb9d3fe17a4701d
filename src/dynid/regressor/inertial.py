"""The inertial columns of the regressor, batched over samples in compiled kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dynid.core import Array, read_only
from dynid.regressor.spatial import (
    LANES,
    dot,
    force_cross,
    momentum,
    origin_motion,
    outward,
    plus,
    read,
    to_child,
    to_parent,
    write,
)
from dynid.robot import RobotModel


def turns(q: Array) -> Array:
    """(2, n, N) cosine and sine of angles (n, N) [rad]."""
    return np.stack([np.cos(q), np.sin(q)])


Places = NDArray[np.int64]
"""Row numbers, below 0 for none."""


@njit(cache=True, fastmath=True, boundscheck=False, error_model="numpy")
def inertial_rows(
    geom: Array,
    screw: Array,
    grav: Array,
    turn: Array,
    state: Array,
    out: Array,
    places: Places,
) -> None:
    """Write chosen entries of the inertial columns to rows of out (R, N), in any order.

    Shapes are trusted, N is at least `LANES`. See `ChainConstants` for the chain (n, 39), (n, 6),
    (3), `turns` for the cosines and sines (2, n, N); the state q, dq, ddq is (3, n, N), contiguous.
    The places (n, n, 10) are the row of out for link i, joint row k up to i, parameter c; below 0
    for none. Rows that no place names are left alone.
    """
    n, samples = state.shape[1], state.shape[2]
    pose = np.empty((n, 12, LANES))
    vel = np.empty((n, 6, LANES))
    acc = np.empty((n, 6, LANES))
    screws = np.empty((n, 6, LANES))
    origin = np.empty((3, LANES))
    b = np.empty((9, LANES))
    o = np.empty((10, LANES))
    for block in range((samples + LANES - 1) // LANES):
        # The last lanes overlap the ones before: a few samples are written twice, alike.
        first = min(block * LANES, samples - LANES)
        outward(geom, screw, grav, turn, state, first, pose, vel, acc)
        for i in range(n):
            origin_motion(vel[i], acc[i], origin, b)
            here, w, dw = pose[i], vel[i], acc[i]
            for k in range(i):
                s = screws[k]
                for x in range(LANES):
                    write(s, x, to_child(here, x, read(s, x)))
            for r in range(6):
                screws[i, r] = screw[i, r]
            for k in range(i + 1):
                s = screws[k]
                for x in range(LANES):
                    s0, s1, s2, f0, f1, f2 = s[0, x], s[1, x], s[2, x], s[3, x], s[4, x], s[5, x]
                    c0, c1, c2 = origin[0, x], origin[1, x], origin[2, x]
                    w0, w1, w2 = w[0, x], w[1, x], w[2, x]
                    d0, d1, d2 = dw[0, x], dw[1, x], dw[2, x]
                    u0 = s1 * w2 - s2 * w1
                    u1 = s2 * w0 - s0 * w2
                    u2 = s0 * w1 - s1 * w0
                    o[0, x] = f0 * c0 + f1 * c1 + f2 * c2
                    o[1, x] = f0 * b[0, x] + f1 * b[3, x] + f2 * b[6, x] + c1 * s2 - c2 * s1
                    o[2, x] = f0 * b[1, x] + f1 * b[4, x] + f2 * b[7, x] + c2 * s0 - c0 * s2
                    o[3, x] = f0 * b[2, x] + f1 * b[5, x] + f2 * b[8, x] + c0 * s1 - c1 * s0
                    o[4, x] = s0 * d0 + u0 * w0
                    o[5, x] = s1 * d1 + u1 * w1
                    o[6, x] = s2 * d2 + u2 * w2
                    o[7, x] = s1 * d2 + s2 * d1 + u1 * w2 + u2 * w1
                    o[8, x] = s0 * d2 + s2 * d0 + u0 * w2 + u2 * w0
                    o[9, x] = s0 * d1 + s1 * d0 + u0 * w1 + u1 * w0
                for c in range(10):
                    place = places[i, k, c]
                    if place >= 0:
                        for x in range(LANES):
                            out[place, first + x] = o[c, x]


@njit(cache=True, fastmath=True, boundscheck=False, error_model="numpy")
def torque_kernel(
    geom: Array, screw: Array, grav: Array, links: Array, turn: Array, state: Array, out: Array
) -> None:
    """Write the torques (n, N) of rigid links, by the recursion of Newton and Euler.

    Shapes are trusted, N is at least `LANES`. See `ChainConstants` for the chain (n, 39), (n, 6),
    (3) and `turns` for the cosines and sines (2, n, N); the links are (n, 10), the state (3, n, N).
    """
    n, samples = out.shape
    pose = np.empty((n, 12, LANES))
    vel = np.empty((n, 6, LANES))
    acc = np.empty((n, 6, LANES))
    carried = np.empty((6, LANES))
    for block in range((samples + LANES - 1) // LANES):
        # The last lanes overlap the ones before: a few samples are written twice, alike.
        first = min(block * LANES, samples - LANES)
        outward(geom, screw, grav, turn, state, first, pose, vel, acc)
        carried[:] = 0.0
        for k in range(n):
            i = n - 1 - k
            link = links[i]
            s = (screw[i, 0], screw[i, 1], screw[i, 2], screw[i, 3], screw[i, 4], screw[i, 5])
            for x in range(LANES):
                v = read(vel[i], x)
                wrench = plus(momentum(link, read(acc[i], x)), read(carried, x), 1.0)
                wrench = plus(wrench, force_cross(v, momentum(link, v)), 1.0)
                out[i, first + x] = dot(s, wrench)
                write(carried, x, to_parent(pose[i], x, wrench))


class ChainConstants(NamedTuple):
    """What kernels need of a robot, for one choice of parameter frames, in their order."""

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


def inertial_columns(constants: ChainConstants, state: Array, out: Array) -> None:
    """Write the inertial columns to out (10 n, n, N): column, joint row, sample.

    Of q, dq, ddq (3, n, N); shapes are trusted. Columns are link-major. Entries that are
    structurally zero are left alone where N is `LANES` or more and out is contiguous.
    """
    _, n, samples = state.shape
    if samples < LANES or not out.flags.c_contiguous:
        whole = np.zeros((*out.shape[:2], max(samples, LANES)))
        inertial_columns(constants, in_lanes(state), whole)
        out[:] = whole[:, :, :samples]
        return
    rows = out.reshape(10 * n * n, samples)
    inertial_rows(*constants, turns(state[0]), state, rows, every_row(n))


def in_lanes(state: Array) -> Array:
    """(.., n, N or `LANES`) of (.., n, N): the kernels' samples, zero where they are too few."""
    missing = LANES - state.shape[2]
    return state if missing <= 0 else np.pad(state, ((0, 0), (0, 0), (0, missing)))


def every_row(joints: int) -> Places:
    """(n, n, 10) where `inertial_columns` keeps the entries of link i, joint row k, parameter c."""
    link, row, parameter = np.ogrid[:joints, :joints, :10]
    return np.where(row <= link, (10 * link + parameter) * joints + row, -1)
