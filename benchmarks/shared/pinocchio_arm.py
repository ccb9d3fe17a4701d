"""An arm of pinocchio and the paper's regressor of it, in a Python loop as many write it."""

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dynid.robot import RobotModel

Array = NDArray[np.float64]
STEP_SPEED = 0.001
"""Of the smooth Coulomb step [rad/s]."""


class PinocchioArm:
    """The chain of a robot; its links are balls of their published masses.

    Args:
        robot: A robot whose joints all turn.
        frames: The frames of the inertial parameters.
    """

    def __init__(self, robot: RobotModel, frames: str = "dh") -> None:
        self.robot, self.model, parent = robot, pin.Model(), 0
        for k in range(robot.joints):
            joint = pin.JointModelRevoluteUnaligned(robot.axes[k])
            parent = self.model.addJoint(parent, joint, pin.SE3(robot.placements[k]), f"j{k}")
            mass = float(robot.inertias[k, 0])
            body = pin.Inertia(mass, robot.inertias[k, 1:4] / mass, mass * 0.004 * np.eye(3))
            self.model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        self.model.gravity.linear = np.array(robot.gravity)
        self.data = self.model.createData()
        self._maps = [_parameter_map(frame) for frame in robot.parameter_frames[frames]]

    def rows(self, q: Array, dq: Array, ddq: Array, out: Array | None = None) -> Array:
        """(N, n, 13 n) regressor: inertial columns in the frames, Coulomb, viscous, motor.

        Where `out` is given, what is zero has to be zero in it.
        """
        n, own = self.robot.joints, np.arange(self.robot.joints)
        out = np.zeros((len(q), n, 13 * n)) if out is None else out
        for k in range(len(q)):
            out[k, :, : 10 * n] = pin.computeJointTorqueRegressor(
                self.model, self.data, q[k], dq[k], ddq[k]
            )
        for k, change in enumerate(self._maps):
            part = slice(10 * k, 10 * k + 10)
            out[..., part] = out[..., part] @ change
        for k, column in enumerate((np.tanh(dq / STEP_SPEED), dq, ddq)):
            out[:, own, (10 + k) * n + own] = column
        return out

    def rigid(self, q: Array, dq: Array, ddq: Array) -> Array:
        """(N, n) torques of the links [N.m]."""
        return np.array(
            [pin.rnea(self.model, self.data, *state) for state in zip(q, dq, ddq, strict=True)]
        )


def _parameter_map(frame: Array) -> Array:
    """(10, 10) from our parameters of a link in a frame to pinocchio's in the joint's."""
    out = np.zeros((10, 10))
    for k in range(10):
        m, mx, my, mz, xx, yy, zz, yz, xz, xy = np.eye(10)[k]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        pseudo = np.zeros((4, 4))
        pseudo[:3, :3] = np.trace(tensor) / 2 * np.eye(3) - tensor
        pseudo[:3, 3] = pseudo[3, :3] = (mx, my, mz)
        pseudo[3, 3] = m
        moved = frame @ pseudo @ frame.T
        inertia = np.trace(moved[:3, :3]) * np.eye(3) - moved[:3, :3]
        order = ([0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2])
        out[:, k] = (moved[3, 3], *moved[:3, 3], *inertia[order])
    return out
