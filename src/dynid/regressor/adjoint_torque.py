"""The derivative of weighted joint torques, batched over samples.

With the multipliers taken for joint speeds, nu_i = sum_k S_k multiplier_k is the virtual velocity
of link i, and the weighted torque is the virtual power sum_i nu_i . f_i of the links' wrenches
f = I a + v x* I v. One recursion carries v, a and nu to the tip, one carries their adjoints back;
turning joint i by dq changes X m by -S_i x X m (Featherstone, Rigid Body Dynamics Algorithms,
ch. 2).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from dynid.core.arrays import Array
from dynid.regressor.inertial_kernel import LANES
from dynid.regressor.spatial import (
    dot,
    force_cross,
    load,
    momentum,
    motion_cross,
    place,
    plus,
    read,
    save,
    to_child,
    to_parent,
    write,
)

# Rows of the working array: pose, velocity, acceleration, virtual velocity, their adjoints, state.
POSE, VEL, ACC, VIR, VEL_BAR, ACC_BAR, VIR_BAR, STATE = 0, 12, 18, 24, 30, 36, 42, 48
ROWS = 54


@njit(cache=True, fastmath=True, boundscheck=False, error_model="numpy")
def torque_pullback(
    geom: Array,
    screw: Array,
    grav: Array,
    links: Array,
    turn: Array,
    state: Array,
    multipliers: Array,
    out: Array,
) -> None:
    """Write the gradient of the weighted inertial torques.

    Shapes are trusted, N is at least `LANES`.

    Args:
        geom: (n, 39), screw: (n, 6), grav: (3), see `ChainConstants`.
        screw: See geom.
        grav: See geom.
        links: (n, 10) inertial parameters.
        turn: (2, n, N) cosine and sine of q.
        state: (3, n, N) q, dq, ddq.
        multipliers: (n, N).
        out: (3, n, N) gradient by q, dq, ddq, written over.
    """
    n, samples = multipliers.shape
    work = np.empty((ROWS, LANES))
    kept = np.empty((n, VEL_BAR, LANES))
    for block in range((samples + LANES - 1) // LANES):
        # The last lanes overlap the ones before: a few samples are written twice, alike.
        first = min(block * LANES, samples - LANES)
        last = first + LANES
        for r in range(6):
            for x in range(LANES):
                work[VEL + r, x] = 0.0
                work[VIR + r, x] = 0.0
                work[ACC + r, x] = 0.0 if r < 3 else -grav[r - 3]
        for i in range(n):
            s = (screw[i, 0], screw[i, 1], screw[i, 2], screw[i, 3], screw[i, 4], screw[i, 5])
            q = state[0, i, first:last]
            place(work, POSE, geom[i], turn[0, i, first:last], turn[1, i, first:last], q)
            for x in range(LANES):
                work[STATE, x] = state[1, i, first + x]
                work[STATE + 1, x] = state[2, i, first + x]
                work[STATE + 2, x] = multipliers[i, first + x]
            for x in range(LANES):
                speed = work[STATE, x]
                v = plus(to_child(work, POSE, x, read(work, VEL, x)), s, speed)
                a = plus(to_child(work, POSE, x, read(work, ACC, x)), s, work[STATE + 1, x])
                nu = plus(to_child(work, POSE, x, read(work, VIR, x)), s, work[STATE + 2, x])
                write(work, VEL, x, v)
                write(work, ACC, x, plus(a, motion_cross(v, s), speed))
                write(work, VIR, x, nu)
            save(work, POSE, kept[i])
        work[VEL_BAR:STATE] = 0.0
        for step in range(n):
            i = n - 1 - step
            link = links[i]
            s = (screw[i, 0], screw[i, 1], screw[i, 2], screw[i, 3], screw[i, 4], screw[i, 5])
            load(kept[i], work, POSE)
            for x in range(LANES):
                work[STATE, x] = state[1, i, first + x]
            for x in range(LANES):
                v, a, nu = read(work, VEL, x), read(work, ACC, x), read(work, VIR, x)
                speed = work[STATE, x]
                p = momentum(link, v)
                wrench = plus(momentum(link, a), force_cross(v, p), 1.0)
                nu_bar = plus(read(work, VIR_BAR, x), wrench, 1.0)
                a_bar = plus(read(work, ACC_BAR, x), momentum(link, nu), 1.0)
                v_bar = plus(read(work, VEL_BAR, x), momentum(link, motion_cross(nu, v)), 1.0)
                v_bar = plus(v_bar, force_cross(nu, p), -1.0)
                v_bar = plus(v_bar, force_cross(s, a_bar), speed)
                turning = motion_cross(v, s)
                carried = plus(a, turning, -speed)
                twist = plus(force_cross(v, v_bar), force_cross(carried, a_bar), 1.0)
                twist = plus(twist, force_cross(nu, nu_bar), 1.0)
                work[STATE + 3, x] = -dot(s, twist)
                work[STATE + 4, x] = dot(s, v_bar) + dot(turning, a_bar)
                work[STATE + 5, x] = dot(s, a_bar)
                write(work, VEL_BAR, x, to_parent(work, POSE, x, v_bar))
                write(work, ACC_BAR, x, to_parent(work, POSE, x, a_bar))
                write(work, VIR_BAR, x, to_parent(work, POSE, x, nu_bar))
            for r in range(3):
                for x in range(LANES):
                    out[r, i, first + x] = work[STATE + 3 + r, x]
