"""Force mode where nothing is touched.

The controller lets the tool give way along chosen axes until the force there is the one asked
for. The simulated arm touches nothing: the force at its tool is zero, and along those axes the tool
moves on, in the direction of the force, as fast as force and limits allow. Where a program moves
the arm at the same time, that motion is the whole of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dynid.core import Array
from dynid.simulation.controller.machine_arm import ControlledArm
from dynid.simulation.controller.motion_poses import rotation_matrix, to_matrix

TO_THE_POINT, AS_GIVEN, ALONG_THE_MOTION = 1, 2, 3
"""Types of force mode: what becomes of the task frame."""
_RESISTANCE = np.array([200.0] * 3 + [20.0] * 3)
"""Of the free tool: force per speed [N.s/m], torque per speed [N.m.s/rad]; not published by UR."""
_ACCELERATION = np.array([1.0] * 3 + [4.0] * 3)
_SLOWEST = 1e-6
_DAMPING = 1e-6


@dataclass(slots=True)
class ForceMode:
    """A force mode that is on."""

    frame: list[float]
    """(6) pose of the task frame in the base."""
    compliant: list[bool]
    """(6) axes of the task frame that give way."""
    wrench: list[float]
    """(6) force [N] and torque [N.m] asked for, in the task frame."""
    kind: int
    """One of the three types."""
    limits: list[float]
    """(6) largest speeds of compliant axes [m/s, rad/s]."""
    gain: float
    """Scales how the tool gives way."""

    def next(self, arm: ControlledArm, tcp: Array) -> list[float]:
        """(6) the set point of a cycle in which nothing else moves the arm [rad].

        Args:
            arm: The arm.
            tcp: (4, 4) the tool in the flange.
        """
        tool, jacobian = arm.kinematics.jacobian(arm.setpoint, tcp)
        now = jacobian @ np.array(arm.speed)
        axes = self._axes(tool[:3, 3], now[:3])
        twice = np.kron(np.eye(2), axes)
        most = np.abs(np.array(self.limits))
        wish = self.gain * np.array(self.wrench) / _RESISTANCE
        wish = np.where(self.compliant, np.clip(wish, -most, most), 0.0)
        before = twice.T @ now
        change = _ACCELERATION * arm.cycle
        twist = twice @ (before + np.clip(wish - before, -change, change))
        gram = jacobian @ jacobian.T + _DAMPING * np.eye(6)
        speeds: list[float] = (jacobian.T @ np.linalg.solve(gram, twist)).tolist()
        return [q + arm.cycle * dq for q, dq in zip(arm.setpoint, speeds, strict=True)]

    def _axes(self, point: Array, velocity: Array) -> Array:
        """(3, 3) the axes of the task frame in the base."""
        frame = to_matrix(self.frame)
        if self.kind == TO_THE_POINT:
            return _turned_to(1, frame[:3, 3] - point, frame[:3, :3])
        if self.kind == ALONG_THE_MOTION:
            along = frame[:3, :3].T @ velocity
            return _turned_to(0, frame[:3, :3] @ np.array([along[0], along[1], 0.0]), frame[:3, :3])
        return frame[:3, :3]


def _turned_to(axis: int, direction: Array, axes: Array) -> Array:
    """Axes of which one points in a direction, turned no more than that takes."""
    length = float(np.linalg.norm(direction))
    if length < _SLOWEST:
        return axes
    unit, present = direction / length, axes[:, axis]
    normal = np.cross(present, unit)
    sine, cosine = float(np.linalg.norm(normal)), float(present @ unit)
    if sine < _SLOWEST:
        return axes if cosine > 0 else -axes
    angle = math.atan2(sine, cosine)
    return rotation_matrix((normal / sine * angle).tolist()) @ axes
