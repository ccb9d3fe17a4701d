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
    momentum,
    motion_cross,
    plus,
    read,
    to_child,
    to_parent,
    write,
)


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
    pose = np.empty((n, 12, LANES))
    vel = np.empty((n, 6, LANES))
    acc = np.empty((n, 6, LANES))
    vir = np.empty((n, 6, LANES))
    adjoint = np.empty((3, 6, LANES))
    for block in range((samples + LANES - 1) // LANES):
        # The last lanes overlap the ones before: a few samples are written twice, alike.
        first = min(block * LANES, samples - LANES)
        for i in range(n):
            g = geom[i]
            s = (screw[i, 0], screw[i, 1], screw[i, 2], screw[i, 3], screw[i, 4], screw[i, 5])
            for x in range(LANES):
                c, sn, qx = turn[0, i, first + x], turn[1, i, first + x], state[0, i, first + x]
                for r in range(9):
                    pose[i, r, x] = g[r] + g[9 + r] * c + g[18 + r] * sn
                for r in range(3):
                    pose[i, 9 + r, x] = g[27 + r] + g[30 + r] * c + g[33 + r] * sn + g[36 + r] * qx
            for x in range(LANES):
                v = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
                a = (0.0, 0.0, 0.0, -grav[0], -grav[1], -grav[2])
                nu = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
                if i > 0:
                    v = read(vel[i - 1], x)
                    a = read(acc[i - 1], x)
                    nu = read(vir[i - 1], x)
                speed = state[1, i, first + x]
                v = plus(to_child(pose[i], x, v), s, speed)
                a = plus(to_child(pose[i], x, a), s, state[2, i, first + x])
                a = plus(a, motion_cross(v, s), speed)
                nu = plus(to_child(pose[i], x, nu), s, multipliers[i, first + x])
                write(vel[i], x, v)
                write(acc[i], x, a)
                write(vir[i], x, nu)
        adjoint[:] = 0.0
        for k in range(n):
            i = n - 1 - k
            link = links[i]
            s = (screw[i, 0], screw[i, 1], screw[i, 2], screw[i, 3], screw[i, 4], screw[i, 5])
            for x in range(LANES):
                v, a, nu = read(vel[i], x), read(acc[i], x), read(vir[i], x)
                speed = state[1, i, first + x]
                p = momentum(link, v)
                wrench = plus(momentum(link, a), force_cross(v, p), 1.0)
                nu_bar = plus(read(adjoint[2], x), wrench, 1.0)
                a_bar = plus(read(adjoint[1], x), momentum(link, nu), 1.0)
                v_bar = plus(read(adjoint[0], x), momentum(link, motion_cross(nu, v)), 1.0)
                v_bar = plus(v_bar, force_cross(nu, p), -1.0)
                v_bar = plus(v_bar, force_cross(s, a_bar), speed)
                turning = motion_cross(v, s)
                out[1, i, first + x] = dot(s, v_bar) + dot(turning, a_bar)
                out[2, i, first + x] = dot(s, a_bar)
                carried = plus(a, turning, -speed)
                twist = plus(force_cross(v, v_bar), force_cross(carried, a_bar), 1.0)
                twist = plus(twist, force_cross(nu, nu_bar), 1.0)
                out[0, i, first + x] = -dot(s, twist)
                write(adjoint[0], x, to_parent(pose[i], x, v_bar))
                write(adjoint[1], x, to_parent(pose[i], x, a_bar))
                write(adjoint[2], x, to_parent(pose[i], x, nu_bar))
