"""Exact derivatives of torques and of the regressor by the motion, batched over samples.

Reverse mode: a weighted sum is differentiated by all positions, velocities and accelerations in
one pass, whatever the weights. The entries of link i in joint row k, weighted, are one function of
the screw of joint k and of the motion of link i: with the weights o_0, o = (o_1 o_2 o_3) and M, the
symmetric matrix of the last six, f.(o_0 c + B o) + s.(o x c) + s.M dw + (s x w).M w, where c is the
acceleration of the frame's origin and B = [dw]x + [w]x [w]x. The adjoints of all screws, velocities
and accelerations go back from tip to base together; turning joint i by dq changes X m by -S_i x X m
(Featherstone, Rigid Body Dynamics Algorithms, ch. 2).

Weighted torques are the sum whose weights are the parameters times the multipliers.
"""

import numpy as np

from dynid.core import Array, InputError, compiled
from dynid.regressor.inertial import Places, every_row, in_lanes, turns
from dynid.regressor.model import CHUNK, InverseDynamicModel
from dynid.regressor.spatial import (
    LANES,
    REPEATABLE,
    dot,
    force_cross,
    motion_cross,
    origin_motion,
    outward,
    plus,
    read,
    to_child,
    to_parent,
    write,
)


@compiled(fastmath=REPEATABLE, boundscheck=False, error_model="numpy")
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
    """Write the gradient (3, n, N) by q, dq, ddq of the weighted inertial columns.

    Shapes are trusted, N is at least `LANES`. See `ChainConstants` for the chain (n, 39), (n, 6),
    (3), `turns` for the cosines and sines (2, n, N), `inertial_rows` for the places (n, n, 10) of
    the weights (R, N), below 0 where a weight is zero. The state is (3, n, N).
    """
    n, samples = state.shape[1], state.shape[2]
    pose = np.empty((n, 12, LANES))
    vel = np.empty((n, 6, LANES))
    acc = np.empty((n, 6, LANES))
    # Screws of joints k in frames i, and what their adjoints have gathered on the way back.
    screws = np.empty((n, n, 6, LANES))
    bars = np.empty((n, 6, LANES))
    v_bar = np.empty((6, LANES))
    a_bar = np.empty((6, LANES))
    o = np.empty((10, LANES))
    origin = np.empty((3, LANES))
    b = np.empty((9, LANES))
    b_bar = np.empty((9, LANES))
    twist = np.empty((6, LANES))
    for block in range((samples + LANES - 1) // LANES):
        # The last lanes overlap the ones before: a few samples are written twice, alike.
        first = min(block * LANES, samples - LANES)
        outward(geom, screw, grav, turn, state, first, pose, vel, acc)
        for i in range(n):
            for r in range(6):
                screws[i, i, r] = screw[i, r]
            here = pose[i]
            for k in range(i):
                before, now = screws[i - 1, k], screws[i, k]
                for x in range(LANES):
                    write(now, x, to_child(here, x, read(before, x)))
        bars[:] = 0.0
        v_bar[:] = 0.0
        a_bar[:] = 0.0
        for step in range(n):
            i = n - 1 - step
            here, w, dw = pose[i], vel[i], acc[i]
            origin_motion(w, dw, origin, b)
            b_bar[:] = 0.0
            twist[:] = 0.0
            for k in range(i + 1):
                s_k, bar = screws[i, k], bars[k]
                for c in range(10):
                    place = places[i, k, c]
                    if place >= 0:
                        for x in range(LANES):
                            o[c, x] = weights[place, first + x]
                    else:
                        for x in range(LANES):
                            o[c, x] = 0.0
                for x in range(LANES):
                    s0, s1, s2, f0, f1, f2 = read(s_k, x)
                    c0, c1, c2 = origin[0, x], origin[1, x], origin[2, x]
                    w0, w1, w2 = w[0, x], w[1, x], w[2, x]
                    d0, d1, d2 = dw[0, x], dw[1, x], dw[2, x]
                    m, o1, o2, o3 = o[0, x], o[1, x], o[2, x], o[3, x]
                    xx, yy, zz = o[4, x], o[5, x], o[6, x]
                    yz, xz, xy = o[7, x], o[8, x], o[9, x]
                    u0 = s1 * w2 - s2 * w1
                    u1 = s2 * w0 - s0 * w2
                    u2 = s0 * w1 - s1 * w0
                    z0 = xx * w0 + xy * w1 + xz * w2
                    z1 = xy * w0 + yy * w1 + yz * w2
                    z2 = xz * w0 + yz * w1 + zz * w2
                    t0, t1, t2, g0, g1, g2 = read(bar, x)
                    bar[0, x] = (
                        t0 + o2 * c2 - o3 * c1 + xx * d0 + xy * d1 + xz * d2 + w1 * z2 - w2 * z1
                    )
                    bar[1, x] = (
                        t1 + o3 * c0 - o1 * c2 + xy * d0 + yy * d1 + yz * d2 + w2 * z0 - w0 * z2
                    )
                    bar[2, x] = (
                        t2 + o1 * c1 - o2 * c0 + xz * d0 + yz * d1 + zz * d2 + w0 * z1 - w1 * z0
                    )
                    bar[3, x] = g0 + m * c0 + b[0, x] * o1 + b[1, x] * o2 + b[2, x] * o3
                    bar[4, x] = g1 + m * c1 + b[3, x] * o1 + b[4, x] * o2 + b[5, x] * o3
                    bar[5, x] = g2 + m * c2 + b[6, x] * o1 + b[7, x] * o2 + b[8, x] * o3
                    v_bar[0, x] += z1 * s2 - z2 * s1 + xx * u0 + xy * u1 + xz * u2
                    v_bar[1, x] += z2 * s0 - z0 * s2 + xy * u0 + yy * u1 + yz * u2
                    v_bar[2, x] += z0 * s1 - z1 * s0 + xz * u0 + yz * u1 + zz * u2
                    a_bar[0, x] += xx * s0 + xy * s1 + xz * s2
                    a_bar[1, x] += xy * s0 + yy * s1 + yz * s2
                    a_bar[2, x] += xz * s0 + yz * s1 + zz * s2
                    e0 = m * f0 + s1 * o3 - s2 * o2
                    e1 = m * f1 + s2 * o1 - s0 * o3
                    e2 = m * f2 + s0 * o2 - s1 * o1
                    # c = a + w x v
                    a_bar[3, x] += e0
                    a_bar[4, x] += e1
                    a_bar[5, x] += e2
                    b_bar[0, x] += f0 * o1
                    b_bar[1, x] += f0 * o2
                    b_bar[2, x] += f0 * o3
                    b_bar[3, x] += f1 * o1
                    b_bar[4, x] += f1 * o2
                    b_bar[5, x] += f1 * o3
                    b_bar[6, x] += f2 * o1
                    b_bar[7, x] += f2 * o2
                    b_bar[8, x] += f2 * o3
                    v0, v1, v2 = w[3, x], w[4, x], w[5, x]
                    v_bar[0, x] += v1 * e2 - v2 * e1
                    v_bar[1, x] += v2 * e0 - v0 * e2
                    v_bar[2, x] += v0 * e1 - v1 * e0
                    v_bar[3, x] += e1 * w2 - e2 * w1
                    v_bar[4, x] += e2 * w0 - e0 * w2
                    v_bar[5, x] += e0 * w1 - e1 * w0
            for x in range(LANES):
                w0, w1, w2 = w[0, x], w[1, x], w[2, x]
                trace = 2.0 * (b_bar[0, x] + b_bar[4, x] + b_bar[8, x])
                xy = b_bar[1, x] + b_bar[3, x]
                xz = b_bar[2, x] + b_bar[6, x]
                yz = b_bar[5, x] + b_bar[7, x]
                v_bar[0, x] += (2.0 * b_bar[0, x] - trace) * w0 + xy * w1 + xz * w2
                v_bar[1, x] += xy * w0 + (2.0 * b_bar[4, x] - trace) * w1 + yz * w2
                v_bar[2, x] += xz * w0 + yz * w1 + (2.0 * b_bar[8, x] - trace) * w2
                a_bar[0, x] += b_bar[7, x] - b_bar[5, x]
                a_bar[1, x] += b_bar[2, x] - b_bar[6, x]
                a_bar[2, x] += b_bar[3, x] - b_bar[1, x]
            for k in range(i):
                s_k, bar = screws[i, k], bars[k]
                for x in range(LANES):
                    f = read(bar, x)
                    write(twist, x, plus(read(twist, x), force_cross(read(s_k, x), f), 1.0))
                    write(bar, x, to_parent(here, x, f))
            s = (screw[i, 0], screw[i, 1], screw[i, 2], screw[i, 3], screw[i, 4], screw[i, 5])
            for x in range(LANES):
                v, a, v_adj, a_adj = read(w, x), read(dw, x), read(v_bar, x), read(a_bar, x)
                speed = state[1, i, first + x]
                v_adj = plus(v_adj, force_cross(s, a_adj), speed)
                turning = motion_cross(v, s)
                out[1, i, first + x] = dot(s, v_adj) + dot(turning, a_adj)
                out[2, i, first + x] = dot(s, a_adj)
                carried = plus(a, turning, -speed)
                total = plus(force_cross(v, v_adj), force_cross(carried, a_adj), 1.0)
                out[0, i, first + x] = -dot(s, plus(total, read(twist, x), 1.0))
                write(v_bar, x, to_parent(here, x, v_adj))
                write(a_bar, x, to_parent(here, x, a_adj))


Gradient = tuple[Array, Array, Array]
"""Derivatives by q, dq and ddq, each (N, n)."""


def torque_adjoint(
    model: InverseDynamicModel,
    q: Array,
    dq: Array,
    ddq: Array,
    parameters: Array,
    multipliers: Array,
) -> Gradient:
    """The gradient of sum(multipliers * inverse_dynamics(q, dq, ddq, parameters)).

    Positions (N, n) are in rad or m; there is a multiplier (N, n) for each torque and a parameter
    for each of the p columns.

    Raises:
        InputError: Shapes that do not fit the model or each other, columns without a derivative.
    """
    _check("parameters", parameters, (len(model.columns),))
    _check("multipliers", multipliers, q.shape)
    parts: list[Gradient] = []
    for first in range(0, len(q), CHUNK):
        part = slice(first, first + CHUNK)
        weights = parameters[:, None, None] * multipliers[part].T
        parts.append(regressor_adjoint(model, q[part], dq[part], ddq[part], weights))
    q_bar, dq_bar, ddq_bar = (np.concatenate(bars) for bars in zip(*parts, strict=True))
    return q_bar, dq_bar, ddq_bar


def regressor_adjoint(
    model: InverseDynamicModel, q: Array, dq: Array, ddq: Array, weights: Array
) -> Gradient:
    """The gradient of sum(weights * stack(q, dq, ddq)), as `torque_adjoint`; weights (p, n, N)."""
    check_differentiable(model)
    n, samples = model.robot.joints, len(q)
    _check("weights", weights, (len(model.columns), n, samples))
    state = in_lanes(model.motion(q, dq, ddq))
    padded = in_lanes(weights)
    rows = padded[: 10 * n].reshape(10 * n * n, -1)
    out = np.zeros(state.shape)
    regressor_pullback(*model.constants, turns(state[0]), state, rows, every_row(n), out)
    model.pull_beside(state, padded[10 * n :], out)
    return by_sample(out, samples)


def by_sample(out: Array, samples: int) -> Gradient:
    """What a pullback wrote (3, n, N or more), each (N, n)."""
    q_bar, dq_bar, ddq_bar = (np.array(part[:, :samples].T, order="C") for part in out)
    return q_bar, dq_bar, ddq_bar


def check_differentiable(model: InverseDynamicModel) -> None:
    """Check that every column beside the inertial ones belongs to a block.

    Raises:
        InputError: Columns that no block differentiates, as friction that grows with the load
            and torque ripple.
    """
    known = 10 * model.robot.joints + model.beside
    if known != len(model.columns):
        raise InputError(
            "columns without a derivative",
            value=model.names[known:],
            next_step="Use a model without load-dependent friction and torque ripple.",
        )


def _check(name: str, array: Array, shape: tuple[int, ...]) -> None:
    # The compiled kernels trust their shapes: they would read beyond shorter arrays.
    if array.shape != shape:
        raise InputError(f"{name} does not fit", value=array.shape, limit=shape)
