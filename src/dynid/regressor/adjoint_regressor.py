"""The derivative of a weighted sum of inertial columns, batched over samples.

The entries of link i in joint row k, weighted, are one function of the screw of joint k and of
the motion of link i: with the weights o_0, o = (o_1 o_2 o_3) and M, the symmetric matrix of the
last six, f.(o_0 c + B o) + s.(o x c) + s.M dw + (s x w).M w, where c is the acceleration of the
frame's origin and B = [dw]x + [w]x [w]x. The adjoints of all screws, velocities and accelerations
go back from tip to base together; turning joint i by dq changes X m by -S_i x X m.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from dynid.core.arrays import Array
from dynid.regressor.inertial_kernel import LANES, Places
from dynid.regressor.spatial import (
    Six,
    dot,
    force_cross,
    load,
    motion_cross,
    place,
    plus,
    read,
    save,
    to_child,
    to_parent,
    write,
)

# Rows of the working array: pose, velocity, acceleration, state; one screw, its adjoint and its
# weights; acceleration of the origin, B, and adjoints; what the screws' adjoints turn.
POSE, VEL, ACC, STATE, SCREW, BAR, WEIGHT = 0, 12, 18, 24, 30, 36, 42
ORIGIN, B, VEL_BAR, ACC_BAR, B_BAR, TWIST = 52, 55, 64, 70, 76, 85
ROWS = 91


@njit(fastmath=True, error_model="numpy")
def _pull_entry(work: Array, x: int) -> None:
    """Gather the adjoints of one link's entries in one joint row."""
    s0, s1, s2, f0, f1, f2 = read(work, SCREW, x)
    w0, w1, w2, v0, v1, v2 = read(work, VEL, x)
    d0, d1, d2 = work[ACC, x], work[ACC + 1, x], work[ACC + 2, x]
    c0, c1, c2 = work[ORIGIN, x], work[ORIGIN + 1, x], work[ORIGIN + 2, x]
    m, o1, o2, o3, xx, yy = read(work, WEIGHT, x)
    zz, yz, xz, xy = (
        work[WEIGHT + 6, x],
        work[WEIGHT + 7, x],
        work[WEIGHT + 8, x],
        work[WEIGHT + 9, x],
    )
    u0, u1, u2 = s1 * w2 - s2 * w1, s2 * w0 - s0 * w2, s0 * w1 - s1 * w0
    z0 = xx * w0 + xy * w1 + xz * w2
    z1 = xy * w0 + yy * w1 + yz * w2
    z2 = xz * w0 + yz * w1 + zz * w2
    e0 = m * f0 + s1 * o3 - s2 * o2
    e1 = m * f1 + s2 * o1 - s0 * o3
    e2 = m * f2 + s0 * o2 - s1 * o1
    b0, b1, b2, b3, b4, b5 = read(work, B, x)
    b6, b7, b8 = work[B + 6, x], work[B + 7, x], work[B + 8, x]
    bar = (
        o2 * c2 - o3 * c1 + xx * d0 + xy * d1 + xz * d2 + w1 * z2 - w2 * z1,
        o3 * c0 - o1 * c2 + xy * d0 + yy * d1 + yz * d2 + w2 * z0 - w0 * z2,
        o1 * c1 - o2 * c0 + xz * d0 + yz * d1 + zz * d2 + w0 * z1 - w1 * z0,
        m * c0 + b0 * o1 + b1 * o2 + b2 * o3,
        m * c1 + b3 * o1 + b4 * o2 + b5 * o3,
        m * c2 + b6 * o1 + b7 * o2 + b8 * o3,
    )
    v_bar = (
        z1 * s2 - z2 * s1 + xx * u0 + xy * u1 + xz * u2 + v1 * e2 - v2 * e1,
        z2 * s0 - z0 * s2 + xy * u0 + yy * u1 + yz * u2 + v2 * e0 - v0 * e2,
        z0 * s1 - z1 * s0 + xz * u0 + yz * u1 + zz * u2 + v0 * e1 - v1 * e0,
        e1 * w2 - e2 * w1,
        e2 * w0 - e0 * w2,
        e0 * w1 - e1 * w0,
    )
    a_bar = (
        xx * s0 + xy * s1 + xz * s2,
        xy * s0 + yy * s1 + yz * s2,
        xz * s0 + yz * s1 + zz * s2,
        e0,
        e1,
        e2,
    )
    b_bar = (f0 * o1, f0 * o2, f0 * o3, f1 * o1, f1 * o2, f1 * o3)
    write(work, BAR, x, plus(read(work, BAR, x), bar, 1.0))
    write(work, VEL_BAR, x, plus(read(work, VEL_BAR, x), v_bar, 1.0))
    write(work, ACC_BAR, x, plus(read(work, ACC_BAR, x), a_bar, 1.0))
    write(work, B_BAR, x, plus(read(work, B_BAR, x), b_bar, 1.0))
    work[B_BAR + 6, x] += f2 * o1
    work[B_BAR + 7, x] += f2 * o2
    work[B_BAR + 8, x] += f2 * o3


@njit(fastmath=True, error_model="numpy")
def _pull_link(work: Array, x: int, s: Six) -> None:
    """Take the adjoints of one link to its joint and to its parent."""
    v, a = read(work, VEL, x), read(work, ACC, x)
    v_bar, a_bar = read(work, VEL_BAR, x), read(work, ACC_BAR, x)
    b0, b1, b2, b3, b4, b5 = read(work, B_BAR, x)
    b6, b7, b8 = work[B_BAR + 6, x], work[B_BAR + 7, x], work[B_BAR + 8, x]
    trace = 2.0 * (b0 + b4 + b8)
    by_b = (
        (2.0 * b0 - trace) * v[0] + (b1 + b3) * v[1] + (b2 + b6) * v[2],
        (b1 + b3) * v[0] + (2.0 * b4 - trace) * v[1] + (b5 + b7) * v[2],
        (b2 + b6) * v[0] + (b5 + b7) * v[1] + (2.0 * b8 - trace) * v[2],
        0.0,
        0.0,
        0.0,
    )
    speed = work[STATE, x]
    a_bar = plus(a_bar, (b7 - b5, b2 - b6, b3 - b1, 0.0, 0.0, 0.0), 1.0)
    v_bar = plus(plus(v_bar, by_b, 1.0), force_cross(s, a_bar), speed)
    turning = motion_cross(v, s)
    carried = plus(a, turning, -speed)
    total = plus(force_cross(v, v_bar), force_cross(carried, a_bar), 1.0)
    work[STATE + 1, x] = -dot(s, plus(total, read(work, TWIST, x), 1.0))
    work[STATE + 2, x] = dot(s, v_bar) + dot(turning, a_bar)
    work[STATE + 3, x] = dot(s, a_bar)
    write(work, VEL_BAR, x, to_parent(work, POSE, x, v_bar))
    write(work, ACC_BAR, x, to_parent(work, POSE, x, a_bar))


@njit(cache=True, fastmath=True, boundscheck=False, error_model="numpy")
def regressor_pullback(
    geom: Array,
    screw: Array,
    grav: Array,
    turn: Array,
    state: Array,
    weights: Array,
    places: Places,
    out: Array,
) -> None:
    """Write the gradient of the weighted inertial columns.

    Shapes are trusted, N is at least `LANES`.

    Args:
        geom: (n, 39), see `ChainConstants`.
        screw: (n, 6).
        grav: (3).
        turn: (2, n, N) cosine and sine of q.
        state: (3, n, N) q, dq, ddq.
        weights: (R, N).
        places: (n, n, 10) the row of weights for link i, joint row k up to i, parameter c; below
            0 where the weight is zero.
        out: (3, n, N) gradient by q, dq, ddq, written over.
    """
    n, samples = state.shape[1], state.shape[2]
    work = np.empty((ROWS, LANES))
    kept = np.empty((n, STATE, LANES))
    # Screws of joints k in frames i, and what their adjoints have gathered on the way back.
    screws = np.empty((n, n, 6, LANES))
    bars = np.empty((n, 6, LANES))
    for block in range((samples + LANES - 1) // LANES):
        # The last lanes overlap the ones before: a few samples are written twice, alike.
        first = min(block * LANES, samples - LANES)
        last = first + LANES
        for r in range(6):
            for x in range(LANES):
                work[VEL + r, x] = 0.0
                work[ACC + r, x] = 0.0 if r < 3 else -grav[r - 3]
        for i in range(n):
            s = (screw[i, 0], screw[i, 1], screw[i, 2], screw[i, 3], screw[i, 4], screw[i, 5])
            q = state[0, i, first:last]
            place(work, POSE, geom[i], turn[0, i, first:last], turn[1, i, first:last], q)
            for x in range(LANES):
                work[STATE, x] = state[1, i, first + x]
                work[STATE + 1, x] = state[2, i, first + x]
            for x in range(LANES):
                speed = work[STATE, x]
                v = plus(to_child(work, POSE, x, read(work, VEL, x)), s, speed)
                a = plus(to_child(work, POSE, x, read(work, ACC, x)), s, work[STATE + 1, x])
                write(work, VEL, x, v)
                write(work, ACC, x, plus(a, motion_cross(v, s), speed))
                write(work, SCREW, x, s)
            save(work, POSE, kept[i])
            save(work, SCREW, screws[i, i])
            for k in range(i):
                load(screws[i - 1, k], work, SCREW)
                for x in range(LANES):
                    write(work, SCREW, x, to_child(work, POSE, x, read(work, SCREW, x)))
                save(work, SCREW, screws[i, k])
        bars[:] = 0.0
        work[VEL_BAR:B_BAR] = 0.0
        for step in range(n):
            i = n - 1 - step
            load(kept[i], work, POSE)
            for x in range(LANES):
                v, a = read(work, VEL, x), read(work, ACC, x)
                w0, w1, w2 = v[0], v[1], v[2]
                work[ORIGIN, x] = a[3] + w1 * v[5] - w2 * v[4]
                work[ORIGIN + 1, x] = a[4] + w2 * v[3] - w0 * v[5]
                work[ORIGIN + 2, x] = a[5] + w0 * v[4] - w1 * v[3]
                work[B, x] = -w1 * w1 - w2 * w2
                work[B + 1, x] = w0 * w1 - a[2]
                work[B + 2, x] = w0 * w2 + a[1]
                work[B + 3, x] = w0 * w1 + a[2]
                work[B + 4, x] = -w0 * w0 - w2 * w2
                work[B + 5, x] = w1 * w2 - a[0]
                work[B + 6, x] = w0 * w2 - a[1]
                work[B + 7, x] = w1 * w2 + a[0]
                work[B + 8, x] = -w0 * w0 - w1 * w1
            work[B_BAR:ROWS] = 0.0
            for k in range(i + 1):
                for c in range(10):
                    row = places[i, k, c]
                    if row >= 0:
                        for x in range(LANES):
                            work[WEIGHT + c, x] = weights[row, first + x]
                    else:
                        for x in range(LANES):
                            work[WEIGHT + c, x] = 0.0
                load(screws[i, k], work, SCREW)
                load(bars[k], work, BAR)
                for x in range(LANES):
                    _pull_entry(work, x)
                if k < i:
                    for x in range(LANES):
                        bar = read(work, BAR, x)
                        turned = force_cross(read(work, SCREW, x), bar)
                        write(work, TWIST, x, plus(read(work, TWIST, x), turned, 1.0))
                        write(work, BAR, x, to_parent(work, POSE, x, bar))
                save(work, BAR, bars[k])
            s = (screw[i, 0], screw[i, 1], screw[i, 2], screw[i, 3], screw[i, 4], screw[i, 5])
            for x in range(LANES):
                work[STATE, x] = state[1, i, first + x]
            for x in range(LANES):
                _pull_link(work, x, s)
            for r in range(3):
                for x in range(LANES):
                    out[r, i, first + x] = work[STATE + 1 + r, x]
