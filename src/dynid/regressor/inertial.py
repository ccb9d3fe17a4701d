"""The inertial columns of the regressor, batched over samples in compiled kernels."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.core import Array, compiled
from dynid.regressor.spatial import (
    LANES,
    dot,
    force_cross,
    momentum,
    outward,
    plus,
    read,
    to_parent,
    write,
)
from dynid.robot import RobotModel, joint_turns

QUARTERS = 2.0 / math.pi
# Half pi in three parts; whole numbers of quarter turns times the first are exact up to 2^20.
PART1, PART2, PART3 = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063e-21
S1, S2, S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
S4, S5, S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
C1, C2, C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
C4, C5, C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11


# Not fastmath, nor called from what is: the parts of half pi must not be added up.
@compiled(boundscheck=False, error_model="numpy")
def cosines_sines(angles: Array, out: Array) -> None:
    """Write cosine and sine of angles (n, N) [rad] into out (2, n, N)."""
    rows, samples = angles.shape
    for i in range(rows):
        for x in range(samples):
            angle = angles[i, x]
            k = math.floor(angle * QUARTERS + 0.5)
            r = ((angle - k * PART1) - k * PART2) - k * PART3
            z = r * r
            s = S4 + z * (S5 + z * S6)
            s = r + r * (z * (S1 + z * (S2 + z * (S3 + z * s))))
            c = C4 + z * (C5 + z * C6)
            c = 1.0 - (0.5 * z - z * (z * (C1 + z * (C2 + z * (C3 + z * c)))))
            quarter = k - 4.0 * math.floor(0.25 * k)
            turned = quarter == 1.0 or quarter == 3.0
            cosine = s if turned else c
            sine = c if turned else s
            out[0, i, x] = -cosine if quarter == 1.0 or quarter == 2.0 else cosine
            out[1, i, x] = -sine if quarter >= 2.0 else sine


def turns(q: Array) -> Array:
    """(2, n, N) cosine and sine of angles (n, N) [rad]."""
    out = np.empty((2, *q.shape))
    cosines_sines(q, out)
    return out


Places = NDArray[np.int64]
"""Row numbers, below 0 for none."""


@compiled(fastmath=True, boundscheck=False, error_model="numpy")
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
    q, dq, ddq = state[0], state[1], state[2]
    o = np.empty((10, LANES))
    s = np.empty((n, 6, LANES))
    w = np.empty((3, LANES))
    v = np.empty((3, LANES))
    dw = np.empty((3, LANES))
    dv = np.empty((3, LANES))
    rot = np.empty((9, LANES))
    p = np.empty((3, LANES))
    acc = np.empty((3, LANES))
    b = np.empty((9, LANES))
    for block in range((samples + LANES - 1) // LANES):
        # The last lanes overlap the ones before: a few samples are written twice, alike.
        first = min(block * LANES, samples - LANES)
        for x in range(LANES):
            for r in range(3):
                w[r, x] = 0.0
                v[r, x] = 0.0
                dw[r, x] = 0.0
                dv[r, x] = -grav[r]
        for i in range(n):
            g = geom[i]
            a0, a1, a2 = screw[i, 0], screw[i, 1], screw[i, 2]
            b0, b1, b2 = screw[i, 3], screw[i, 4], screw[i, 5]
            for x in range(LANES):
                c, sn, qx = turn[0, i, first + x], turn[1, i, first + x], q[i, first + x]
                for r in range(9):
                    rot[r, x] = g[r] + g[9 + r] * c + g[18 + r] * sn
                for r in range(3):
                    p[r, x] = g[27 + r] + g[30 + r] * c + g[33 + r] * sn + g[36 + r] * qx
            for x in range(LANES):
                r0, r1, r2 = rot[0, x], rot[1, x], rot[2, x]
                r3, r4, r5 = rot[3, x], rot[4, x], rot[5, x]
                r6, r7, r8 = rot[6, x], rot[7, x], rot[8, x]
                p0, p1, p2 = p[0, x], p[1, x], p[2, x]
                w0, w1, w2 = w[0, x], w[1, x], w[2, x]
                d0, d1, d2 = dw[0, x], dw[1, x], dw[2, x]
                x0 = v[0, x] + w1 * p2 - w2 * p1
                x1 = v[1, x] + w2 * p0 - w0 * p2
                x2 = v[2, x] + w0 * p1 - w1 * p0
                y0 = dv[0, x] + d1 * p2 - d2 * p1
                y1 = dv[1, x] + d2 * p0 - d0 * p2
                y2 = dv[2, x] + d0 * p1 - d1 * p0
                u = dq[i, first + x]
                uu = ddq[i, first + x]
                n0 = r0 * w0 + r3 * w1 + r6 * w2 + a0 * u
                n1 = r1 * w0 + r4 * w1 + r7 * w2 + a1 * u
                n2 = r2 * w0 + r5 * w1 + r8 * w2 + a2 * u
                v0 = r0 * x0 + r3 * x1 + r6 * x2 + b0 * u
                v1 = r1 * x0 + r4 * x1 + r7 * x2 + b1 * u
                v2 = r2 * x0 + r5 * x1 + r8 * x2 + b2 * u
                e0 = r0 * d0 + r3 * d1 + r6 * d2 + a0 * uu + (n1 * a2 - n2 * a1) * u
                e1 = r1 * d0 + r4 * d1 + r7 * d2 + a1 * uu + (n2 * a0 - n0 * a2) * u
                e2 = r2 * d0 + r5 * d1 + r8 * d2 + a2 * uu + (n0 * a1 - n1 * a0) * u
                f0 = n1 * b2 - n2 * b1 + v1 * a2 - v2 * a1
                f1 = n2 * b0 - n0 * b2 + v2 * a0 - v0 * a2
                f2 = n0 * b1 - n1 * b0 + v0 * a1 - v1 * a0
                z0 = r0 * y0 + r3 * y1 + r6 * y2 + b0 * uu + f0 * u
                z1 = r1 * y0 + r4 * y1 + r7 * y2 + b1 * uu + f1 * u
                z2 = r2 * y0 + r5 * y1 + r8 * y2 + b2 * uu + f2 * u
                w[0, x], w[1, x], w[2, x] = n0, n1, n2
                v[0, x], v[1, x], v[2, x] = v0, v1, v2
                dw[0, x], dw[1, x], dw[2, x] = e0, e1, e2
                dv[0, x], dv[1, x], dv[2, x] = z0, z1, z2
                # Classical acceleration of the frame origin, gravity included.
                acc[0, x] = z0 + n1 * v2 - n2 * v1
                acc[1, x] = z1 + n2 * v0 - n0 * v2
                acc[2, x] = z2 + n0 * v1 - n1 * v0
                # b = [dw]x + [w]x [w]x
                b[0, x] = -n1 * n1 - n2 * n2
                b[1, x] = n0 * n1 - e2
                b[2, x] = n0 * n2 + e1
                b[3, x] = n0 * n1 + e2
                b[4, x] = -n0 * n0 - n2 * n2
                b[5, x] = n1 * n2 - e0
                b[6, x] = n0 * n2 - e1
                b[7, x] = n1 * n2 + e0
                b[8, x] = -n0 * n0 - n1 * n1
            for k in range(i):
                for x in range(LANES):
                    s0, s1, s2 = s[k, 0, x], s[k, 1, x], s[k, 2, x]
                    p0, p1, p2 = p[0, x], p[1, x], p[2, x]
                    f0 = s[k, 3, x] + s1 * p2 - s2 * p1
                    f1 = s[k, 4, x] + s2 * p0 - s0 * p2
                    f2 = s[k, 5, x] + s0 * p1 - s1 * p0
                    r0, r1, r2 = rot[0, x], rot[1, x], rot[2, x]
                    r3, r4, r5 = rot[3, x], rot[4, x], rot[5, x]
                    r6, r7, r8 = rot[6, x], rot[7, x], rot[8, x]
                    s[k, 0, x] = r0 * s0 + r3 * s1 + r6 * s2
                    s[k, 1, x] = r1 * s0 + r4 * s1 + r7 * s2
                    s[k, 2, x] = r2 * s0 + r5 * s1 + r8 * s2
                    s[k, 3, x] = r0 * f0 + r3 * f1 + r6 * f2
                    s[k, 4, x] = r1 * f0 + r4 * f1 + r7 * f2
                    s[k, 5, x] = r2 * f0 + r5 * f1 + r8 * f2
            for x in range(LANES):
                for r in range(6):
                    s[i, r, x] = screw[i, r]
            for k in range(i + 1):
                for x in range(LANES):
                    s0, s1, s2 = s[k, 0, x], s[k, 1, x], s[k, 2, x]
                    f0, f1, f2 = s[k, 3, x], s[k, 4, x], s[k, 5, x]
                    c0, c1, c2 = acc[0, x], acc[1, x], acc[2, x]
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


@compiled(fastmath=True, boundscheck=False, error_model="numpy")
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
    links = robot.parameter_frames[frames]
    before = np.linalg.inv(np.concatenate([np.eye(4)[None], links[:-1]])) @ robot.placements
    inner, outer = links[:, :3, :3], before[:, :3, :3]
    slides = np.array(robot.prismatic)[:, None]
    terms = outer[:, None] @ joint_turns(robot).swapaxes(0, 1)
    geometry = np.zeros((n, 39))
    geometry[:, :27] = (terms @ inner[:, None]).reshape(n, 27)
    geometry[:, 27:36] = (terms @ links[:, None, :3, 3:]).reshape(n, 9)
    geometry[:, 27:30] += before[:, :3, 3]
    geometry[:, 36:] = slides * (outer @ robot.axes[:, :, None])[:, :, 0]
    own, place = (inner.transpose(0, 2, 1) @ v[:, :, None] for v in (robot.axes, links[:, :3, 3]))
    axes, places = own[:, :, 0], place[:, :, 0]
    turned = np.concatenate([axes, np.cross(axes, places)], axis=1)
    screws = np.where(slides, np.concatenate([np.zeros((n, 3)), axes], axis=1), turned)
    # Writable, as they come to a worker: Numba compiles all kernels once more for read-only arrays.
    return ChainConstants(geometry=geometry, screws=screws, gravity=robot.gravity.copy())


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
    samples = state.shape[2]
    if samples >= LANES:
        return state
    out = np.zeros((*state.shape[:2], LANES))
    out[:, :, :samples] = state
    return out


def every_row(joints: int) -> Places:
    """(n, n, 10) where `inertial_columns` keeps the entries of link i, joint row k, parameter c."""
    link, row, parameter = np.ogrid[:joints, :joints, :10]
    return np.where(row <= link, (10 * link + parameter) * joints + row, -1)
