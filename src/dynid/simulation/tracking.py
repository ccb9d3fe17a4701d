"""From set points to what the servo tracks: the target filter and the controller's own model."""

from __future__ import annotations

import math

import numpy as np

from dynid.core.arrays import Array
from dynid.core.optional import require
from dynid.simulation.inertia import link_parameters
from dynid.simulation.kernel import plan_target
from dynid.simulation.mjcf import mujoco_model
from dynid.simulation.servo import ControllerModel, Servo
from dynid.simulation.state import Target
from dynid.simulation.truth import SimulatedArm

_POINT = 1e-9 * np.eye(3)  # MuJoCo wants a tensor that is not quite zero


class Tracker:
    """Turns one set point a control cycle into targets for every physics step (see `Servo`).

    Args:
        arm: The simulated arm.
        cycle: Length of a control cycle [s].
        steps: Physics steps in a cycle.
    """

    def __init__(self, arm: SimulatedArm, cycle: float, steps: int) -> None:
        mujoco = require("mujoco", "sim")
        n, controller = arm.robot.joints, arm.controller
        self._controller = controller
        self._cycle = cycle
        self._rate = arm.servo.filter_rate(cycle)
        self._step = cycle / steps
        self._target, self._setpoints = np.zeros((2, n)), np.zeros((2, n))
        self._way, self._speed = np.zeros((steps, n)), np.zeros((steps, n))
        self._part = np.arange(steps)[:, None] / steps
        bodies = bodies_of(controller)
        believed = np.array([link_parameters(mass, com, _POINT) for mass, com in bodies])
        self._model = mujoco_model(arm.robot, believed, np.zeros(n), self._step)
        self._data = mujoco.MjData(self._model)
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

    def believe(self, mass: float, com: Array, gravity: Array) -> None:
        """Count on a payload and a mounting in the controller's own model.

        Args:
            mass: Mass of the payload [kg].
            com: (3) its centre of mass in the last joint frame [m].
            gravity: (3) in the base frame [m/s^2].
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
            physics step.
        """
        self._setpoints[0] = self._setpoints[1]
        self._setpoints[1] = setpoint
        plan_target(self._target, self._setpoints, self._rate, self._step, self._way, self._speed)
        before, self.now = self.now, self._reached()
        # The model is evaluated once a cycle; a straight line in between leaves no steps in the
        # torque that the recorded acceleration could not explain.
        torque = before.feedforward + self._part * (self.now.feedforward - before.feedforward)
        return np.stack([self._way, self._speed, torque], axis=1)

    def _reached(self) -> Target:
        """The target at the end of the cycle planned last."""
        q, dq = self._target.copy()
        ddq = self._rate**2 * (self._setpoints[1] - q) - 2.0 * self._rate * dq
        moment = self._evaluate(q, dq, ddq)
        feedforward = moment + self._controller.friction(dq)
        return Target(q=q, dq=dq, ddq=ddq, moment=moment, feedforward=feedforward)

    def _evaluate(self, q: Array, dq: Array, ddq: Array) -> Array:
        """(n) torques of the believed links in a motion [N.m]."""
        data = self._data
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        self._inverse(self._model, data)
        return np.array(data.qfrc_inverse)

    def _restore(self) -> None:
        # What is asked about the target afterwards must be about the target.
        self._evaluate(self.now.q, self.now.dq, self.now.ddq)


def bodies_of(controller: ControllerModel) -> list[tuple[float, Array]]:
    """The mass [kg] and centre of mass (3) [m] of each link that the controller believes in."""
    return list(zip(controller.masses.tolist(), controller.com, strict=True))
