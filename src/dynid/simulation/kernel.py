"""The compiled inner loop of the simulated arm: servo torque and implicit friction.

MuJoCo integrates q with velocities half a step apart from the positions (semi-implicit Euler is
the leapfrog scheme, read so). To keep that second order, velocity-dependent forces see the
velocity predicted at the time of the position, and recorded velocities are the mean of the two
neighbours. Dry friction is stiff: it is solved with the new velocity as the unknown,

    M (v+ - v) = h (tau + external - bias - Fv (v + v+) / 2 - F_dry(u)),  u = v + theta (v+ - v),

joint after joint (Gauss-Seidel), which converges because M is positive definite and F_dry grows
with speed.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dynid.core.arrays import Array

THETA_TANH = 0.55
"""Near 1/2, so that friction acts at the recorded velocity; above it, so that standstill damps."""
_SWEEPS = 100
_TOLERANCE = 1e-12


@njit(cache=True)
def plan_target(
    target: Array, setpoints: Array, rate: float, step: float, way: Array, speed: Array
) -> None:
    """Advance the target filter over one control cycle, exactly for straight set points.

    Args:
        target: (2, n) target position and velocity, changed in place.
        setpoints: (2, n) set points at the start and the end of the line.
        rate: Natural frequency of the filter [rad/s].
        step: Physics step [s].
        way: (k, n) target positions at the start of each physics step, filled.
        speed: (k, n) target velocities, filled.
    """
    steps, joints = way.shape
    for j in range(joints):
        slope = (setpoints[1, j] - setpoints[0, j]) / (steps * step)
        # Relative to the ramp that the filter would follow for ever, the motion is free.
        lag = setpoints[0, j] - 2.0 * slope / rate
        first = target[0, j] - lag
        second = target[1, j] - slope + rate * first
        for i in range(steps + 1):
            t = i * step
            fade = math.exp(-rate * t)
            place = lag + slope * t + (first + second * t) * fade
            pace = slope + (second - rate * (first + second * t)) * fade
            if i < steps:
                way[i, j], speed[i, j] = place, pace
            else:
                target[0, j], target[1, j] = place, pace


@njit(cache=True)
def predict(qvel: Array, velocity: Array, acceleration: Array, step: float) -> None:
    """Show MuJoCo the velocity at the time of the position, and keep the true one aside.

    Args:
        qvel: (n) MuJoCo's velocity, half a step old; moved half a step on.
        velocity: (n) the true one, kept.
        acceleration: (n) of the last step, updated.
        step: Physics step [s].
    """
    for j in range(len(qvel)):
        acceleration[j] = (qvel[j] - velocity[j]) / step
        velocity[j] = qvel[j]
        qvel[j] += 0.5 * step * acceleration[j]


@njit(cache=True)
def drive(
    mass: Array,
    bias: Array,
    q: Array,
    qvel: Array,
    applied: Array,
    reference: Array,
    loop: Array,
    motion: Array,
    joint: Array,
    dry: Array,
    out: Array,
    step: float,
    width: float,
) -> float:
    """Torques of one physics step, written to `applied`; `qvel` is put back.

    Args:
        mass: (n (n + 1) / 2) rows of the lower triangle of the mass matrix, armature included.
        bias: (n) gravity and velocity terms.
        q: (n) positions.
        qvel: (n) predicted velocities; on return those to integrate from.
        applied: (n) generalised forces, filled.
        reference: (3, n) target position, target velocity, feed-forward.
        loop: (2) natural frequency and its square.
        motion: (2, n) velocity and acceleration as `predict` leaves them.
        joint: (6, n) torque limit, external torque, Im, winding loss per torque squared, Fc, Fv.
        dry: (6, n) breakaway, Stribeck speed, load factor, stiffness, damping, bristles z
            (the last one is changed).
        out: (5, n) torque, friction, load, heat (added up), saturated (set to 1), filled.
        step: Physics step [s].
        width: Width of the ideal law [rad/s], zero for bristles.

    Returns:
        The largest speed that the step will end with, infinite if one is not a number.
    """
    n = len(q)
    theta = THETA_TANH if width > 0.0 else 1.0
    matrix = np.empty((n, n))
    right = np.empty(n)
    level = np.empty(n)
    u = np.empty(n)
    for i in range(n):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = mass[i * (i + 1) // 2 + j] / theta
    for j in range(n):
        stiff = theta * matrix[j, j]
        torque = reference[2, j] + stiff * (
            loop[1] * (reference[0, j] - q[j]) + 2.0 * loop[0] * (reference[1, j] - qvel[j])
        )
        if abs(torque) > joint[0, j]:
            torque = math.copysign(joint[0, j], torque)
            out[4, j] = 1.0
        out[0, j] = torque
        matrix[j, j] += 0.5 * step * joint[5, j] / theta
        velocity = motion[0, j]
        fade = math.exp(-((velocity / dry[1, j]) ** 2))
        level[j] = joint[4, j] + dry[2, j] * out[2, j] + dry[0, j] * fade
        u[j] = velocity + theta * step * motion[1, j]
    for i in range(n):
        total = step * (out[0, i] + joint[1, i] - bias[i] - joint[5, i] * motion[0, i])
        for j in range(n):
            total += matrix[i, j] * motion[0, j]
        right[i] = total
    for _ in range(_SWEEPS):
        change = 0.0
        for i in range(n):
            rest = right[i]
            for j in range(n):
                if j != i:
                    rest -= matrix[i, j] * u[j]
            before = u[i]
            if width > 0.0:
                u[i] = _slide(matrix[i, i], rest, step * level[i], width)
            else:
                u[i] = _bristle(matrix[i, i], rest, step, level[i], dry[3, i], dry[4, i], dry[5, i])
            change = max(change, abs(u[i] - before))
        if change < _TOLERANCE:
            break
    fastest = 0.0
    for j in range(n):
        velocity = motion[0, j]
        middle = velocity + (u[j] - velocity) / (2.0 * theta)
        if width > 0.0:
            force = level[j] * math.tanh(u[j] / width)
        else:
            old = dry[5, j]
            dry[5, j] = (old + step * u[j]) / (1.0 + step * dry[3, j] * abs(u[j]) / level[j])
            force = dry[3, j] * dry[5, j] + dry[4, j] * (dry[5, j] - old) / step
        friction = force + joint[5, j] * middle
        acceleration = (u[j] - velocity) / (theta * step)
        out[1, j] = friction
        out[2, j] = abs(out[0, j] - friction - joint[2, j] * acceleration)
        out[3, j] += step * (friction * middle + joint[3, j] * out[0, j] ** 2)
        applied[j] = out[0, j] + joint[1, j] - friction
        qvel[j] = velocity
        speed = abs(velocity + step * acceleration)
        fastest = max(fastest, speed) if math.isfinite(speed) else math.inf
    return fastest


@njit(cache=True)
def _slide(mass: float, push: float, dry: float, width: float) -> float:
    """The speed that solves mass u + dry tanh(u / width) = push."""
    goal = abs(push)
    # From the left the curve is concave, so Newton's steps never overshoot.
    u = max(0.0, (goal - dry) / mass)
    for _ in range(100):
        bend = math.tanh(u / width)
        move = (goal - mass * u - dry * bend) / (mass + dry * (1.0 - bend * bend) / width)
        u += move
        if move <= 1e-13 + 1e-12 * u:
            break
    return math.copysign(u, push)


@njit(cache=True)
def _bristle(
    mass: float, push: float, step: float, level: float, stiffness: float, damping: float, z: float
) -> float:
    """The speed that solves mass u + step F_dry(u) = push, with F_dry after one step of LuGre.

    z+ = (z + step u) / (1 + c |u|) with c = step stiffness / level makes it a quadratic in |u|
    once the sign is known, and the sign is that of what is left at standstill.
    """
    left = push - step * stiffness * z
    sign = math.copysign(1.0, left)
    bend, goal, size = sign * z, sign * push, abs(left)
    c = step * stiffness / level
    slope = mass - c * (damping * bend + goal) + step * (step * stiffness + damping)
    root = math.sqrt(slope * slope + 4.0 * mass * c * size)
    if slope > 0.0:
        return sign * 2.0 * size / (slope + root)
    return sign * (root - slope) / (2.0 * mass * c)
