"""The compiled inner loop of the simulated arm, its MuJoCo model and its set points."""

import math
from typing import Any

import numpy as np

from dynid.core import Array, InputError, compiled, require
from dynid.robot import RobotModel
from dynid.simulation.joints import Servo, Target
from dynid.simulation.library import SimulatedArm, link_body, link_parameters


def mujoco_model(robot: RobotModel, inertials: Array, armature: Array, step: float) -> Any:
    """A compiled MuJoCo model: the chain alone, without contacts, limits or damping.

    Body i is joint frame i, so `qpos`, `qvel` and `qfrc_*` have the robot's joints in order.
    Of the ten parameters of each link about its joint frame (n, 10), rotor inertias on the joint
    side (n) [kg.m^2] and a time step [s]; the integrator is `implicitfast`.

    Raises:
        InputError: An inertia that no rigid body has.
        MissingExtraError: MuJoCo is not installed.
    """
    mujoco = require("mujoco", "sim")
    spec = mujoco.MjSpec()
    spec.modelname = "arm"
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = robot.gravity
    disable = mujoco.mjtDisableBit
    # A reset in the middle of a run would look like data; the plant watches for divergence.
    spec.option.disableflags |= (
        disable.mjDSBL_CONSTRAINT | disable.mjDSBL_CONTACT | disable.mjDSBL_AUTORESET
    )
    body = spec.worldbody
    for i in range(robot.joints):
        mass, com, tensor = link_body(inertials[i])
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, robot.placements[i, :3, :3].ravel())
        body = body.add_body(name=f"link{i + 1}", pos=robot.placements[i, :3, 3], quat=quaternion)
        body.mass, body.ipos, body.explicitinertial = mass, com, True
        body.fullinertia = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        joint = body.add_joint(name=f"joint{i + 1}", axis=robot.axes[i])
        slides = robot.prismatic[i]
        joint.type = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
        joint.armature = armature[i]
    try:
        return spec.compile()
    except ValueError as error:
        raise InputError(
            "MuJoCo refuses the robot's inertias", where=robot.name, value=str(error)
        ) from error


THETA_TANH = 0.55
"""Near 1/2, so that friction acts at the recorded velocity; above it, so that standstill damps."""
_LEAST = 1e-9
"""Dry friction of a joint without any: bristles need a force at which they slide [N.m]."""
_SWEEPS = 100
_TOLERANCE = 1e-12


@compiled()
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


@compiled()
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


@compiled()
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
        level[j] = max(joint[4, j] + dry[2, j] * out[2, j] + dry[0, j] * fade, _LEAST)
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


@compiled()
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


@compiled()
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


_POINT = 1e-9 * np.eye(3)  # MuJoCo wants a tensor that is not quite zero


class Tracker:
    """Turns one set point a control cycle [s] into targets for every physics step (see `Servo`)."""

    def __init__(self, arm: SimulatedArm, cycle: float, steps: int) -> None:
        mujoco = require("mujoco", "sim")
        n, controller = arm.robot.joints, arm.controller
        self._controller = controller
        self._cycle = cycle
        self._rate = arm.servo.filter_rate(cycle)
        self._step = cycle / steps
        self._target, self._setpoints = np.zeros((2, n)), np.zeros((2, n))
        self._references = np.zeros((steps, 3, n))
        self._part = np.arange(steps)[:, None] / steps
        bodies = list(zip(controller.masses.tolist(), controller.com, strict=True))
        believed = np.array([link_parameters(mass, com, _POINT) for mass, com in bodies])
        self._model = mujoco_model(arm.robot, believed, np.zeros(n), self._step)
        self._data = data = mujoco.MjData(self._model)
        # Asked once, see `SimulatedPlant`.
        self._motion, self._torque = (data.qpos, data.qvel, data.qacc), data.qfrc_inverse
        self._inverse = mujoco.mj_inverse
        self._mujoco = mujoco
        self._bare = bodies[-1]
        self._last = n
        self.now = self._reached()

    def reset(self, pose: Array) -> None:
        """Aim at standing still at a pose (n) [rad or m]."""
        self._setpoints[:] = pose
        self._target[0], self._target[1] = pose, 0.0
        self.now = self._reached()

    def rest(self, joint: int, place: float) -> None:
        """Aim one joint at standing still at a place [rad or m]."""
        self._setpoints[:, joint] = place
        self._target[0, joint], self._target[1, joint] = place, 0.0

    def follow(self, servo: Servo) -> None:
        """Delay set points from now on by another lookahead."""
        self._rate = servo.filter_rate(self._cycle)

    def set_payload(self, mass: float, com: Array, gravity: Array) -> None:
        """Set the payload and the mounting of the controller's own model.

        The mass [kg] has its centre (3) in the last joint frame [m]; gravity (3) is in the base
        frame [m/s^2].
        """
        own, own_com = self._bare
        total = own + mass
        self._model.body_mass[self._last] = total
        self._model.body_ipos[self._last] = (own * own_com + mass * com) / total
        self._model.opt.gravity[:] = gravity

    def tool_speed(self, point: Array) -> float:
        """Speed of a point (3) of the last link [m] at the target [m/s]."""
        velocity = np.empty(6)
        body = self._mujoco.mjtObj.mjOBJ_XBODY
        self._mujoco.mj_objectVelocity(self._model, self._data, body, self._last, velocity, 1)
        (a, b, c), (x, y, z) = velocity[:3].tolist(), point.tolist()
        u, v, w = velocity[3:].tolist()
        return math.hypot(u + b * z - c * y, v + c * x - a * z, w + a * y - b * x)

    def momentum(self) -> float:
        """Linear momentum of the links at the target [kg.m/s]."""
        self._mujoco.mj_subtreeVel(self._model, self._data)
        velocity = self._data.subtree_linvel[1]
        return float(self._model.body_subtreemass[1]) * math.hypot(*velocity.tolist())

    def mass_matrix(self, q: Array) -> Array:
        """(n, n) mass matrix of the believed links at positions q (n) [kg.m^2], rotors apart."""
        n = self._last
        self._evaluate(q, np.zeros(n), np.zeros(n))
        lower = np.zeros((n, n))
        lower[np.tril_indices(n)] = self._data.M
        self._restore()
        return lower + np.tril(lower, -1).T

    def coriolis(self, q: Array, dq: Array) -> Array:
        """(n) velocity torques of the believed links at positions and speeds (n) [N.m]."""
        zero = np.zeros(self._last)
        moving = self._evaluate(q, dq, zero)
        standing = self._evaluate(q, zero, zero)
        self._restore()
        return moving - standing

    def plan(self, setpoint: Array) -> Array:
        """Take the next set point (n) and plan one control cycle.

        Returns:
            (steps, 3, n) target position, target velocity and feed-forward at the start of each
            physics step; the next call overwrites it.
        """
        self._setpoints[0] = self._setpoints[1]
        self._setpoints[1] = setpoint
        way, speed, torque = self._references.swapaxes(0, 1)
        plan_target(self._target, self._setpoints, self._rate, self._step, way, speed)
        before, self.now = self.now, self._reached()
        # The model is evaluated once a cycle; a straight line in between leaves no steps in the
        # torque that the recorded acceleration could not explain.
        torque[:] = before.feedforward + self._part * (self.now.feedforward - before.feedforward)
        return self._references

    def _reached(self) -> Target:
        """The target at the end of the cycle planned last."""
        q, dq = self._target.copy()
        ddq = self._rate**2 * (self._setpoints[1] - q) - 2.0 * self._rate * dq
        moment = self._evaluate(q, dq, ddq)
        feedforward = moment + self._controller.friction(dq)
        return Target(q=q, dq=dq, ddq=ddq, moment=moment, feedforward=feedforward)

    def _evaluate(self, q: Array, dq: Array, ddq: Array) -> Array:
        """(n) torques of the believed links in a motion [N.m]."""
        self._motion[0][:], self._motion[1][:], self._motion[2][:] = q, dq, ddq
        self._inverse(self._model, self._data)
        return self._torque.copy()

    def _restore(self) -> None:
        # What is asked about the target afterwards must be about the target.
        self._evaluate(self.now.q, self.now.dq, self.now.ddq)
