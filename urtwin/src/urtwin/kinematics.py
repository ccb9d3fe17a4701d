"""Poses as UR writes them (x, y, z, rotation vector), arcs, and the kinematics of the tool."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.core import Array, InputError, JobError, require
from dynid.robot import RobotModel
from dynid.simulation import link_parameters, mujoco_model

mujoco = require("mujoco", "sim")

_SMALL = 1e-12
_DAMPING = 1e-6
_ELBOW = 2
_ITERATIONS = 60
_RESTARTS = 5
_STEP = 0.5
_RATE_STEP_S = 1e-4
_FLAT = 1e-9


def rotation_matrix(vector: Sequence[float] | Array) -> Array:
    """(3, 3) the rotation of a rotation vector (3) [rad]."""
    quaternion, matrix = np.array([1.0, 0.0, 0.0, 0.0]), np.empty((3, 3))
    mujoco.mju_quatIntegrate(quaternion, np.array(vector, dtype=np.float64), 1.0)
    mujoco.mju_quat2Mat(matrix.ravel(), quaternion)
    return matrix


def rotation_vector(matrix: Array) -> Array:
    """(3) the rotation vector of a rotation matrix (3, 3) [rad], no longer than pi."""
    quaternion, vector = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quaternion, matrix.ravel())
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    return vector


def to_matrix(pose: Sequence[float]) -> Array:
    """(4, 4) the transform of a UR pose x, y, z, rx, ry, rz [m, rad]."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(pose[3:6])
    matrix[:3, 3] = [float(value) for value in pose[:3]]
    return matrix


def to_pose(matrix: Array) -> list[float]:
    """x, y, z, rx, ry, rz of a transform (4, 4) [m, rad]."""
    return [*matrix[:3, 3].tolist(), *rotation_vector(matrix[:3, :3]).tolist()]


def joint_speeds(jacobian: Array, twist: Array) -> list[float]:
    """(n) joint speeds for a tool velocity (6), damped where the arm is singular."""
    gram = jacobian @ jacobian.T + _DAMPING * np.eye(6)
    return (jacobian.T @ np.linalg.solve(gram, twist)).tolist()


class ToolKinematics:
    """Forward and inverse kinematics of the tool of a robot whose joints all turn."""

    def __init__(self, robot: RobotModel) -> None:
        n = robot.joints
        self._robot, self._last = robot, n
        # Only the frames count: any body will do.
        bodies = np.tile(link_parameters(1.0, np.zeros(3), np.eye(3)), (n, 1))
        self._model = mujoco_model(robot, bodies, np.zeros(n), 1.0)
        self._data = mujoco.MjData(self._model)

    def forward(self, q: Sequence[float], tcp: Array) -> Array:
        """(4, 4) the tool in the base frame at joint positions (n) [rad], tool in flange `tcp`."""
        data, tool = self._data, np.eye(4)
        data.qpos[:] = q
        mujoco.mj_kinematics(self._model, data)
        tool[:3, :3] = data.xmat[self._last].reshape(3, 3)
        tool[:3, 3] = data.xpos[self._last]
        return tool @ self._robot.flange @ tcp

    def jacobian(self, q: Sequence[float], tcp: Array) -> tuple[Array, Array]:
        """The tool in the base frame (4, 4), and its velocity per joint speed (6, n).

        Rows: linear velocity of the tool's point, angular velocity, both in the base frame.
        """
        tool, jacobian = self.forward(q, tcp), np.empty((6, self._last))
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_jac(self._model, self._data, jacobian[:3], jacobian[3:], tool[:3, 3], self._last)
        return tool, jacobian

    def jacobian_rate(self, q: Sequence[float], dq: Array, tcp: Array) -> Array:
        """How the Jacobian (6, n) changes at joint speeds `dq` (n), by central differences."""
        way = _RATE_STEP_S * dq
        place = np.array(q, dtype=np.float64)
        later = self.jacobian((place + way).tolist(), tcp)[1]
        before = self.jacobian((place - way).tolist(), tcp)[1]
        return (later - before) / (2.0 * _RATE_STEP_S)

    def elbow(self, q: Sequence[float]) -> tuple[list[float], list[list[float]]]:
        """The elbow (3) in the base frame [m], and its velocity per joint speed (3, n)."""
        jacobian = self.jacobian(q, np.eye(4))[1]
        origins = self._data.xpos[1:]
        point = origins[_ELBOW]
        columns = np.cross(jacobian[3:].T, point - origins)
        columns[_ELBOW:] = 0.0
        return point.tolist(), columns.T.tolist()

    def inverse(
        self,
        goal: Array,
        near: Sequence[float],
        tcp: Array,
        *,
        position_error: float = 1e-10,
        orientation_error: float = 1e-10,
    ) -> Array:
        """(n) joint positions that put the tool at a goal (4, 4), close to `near` (n) [rad].

        Damped Gauss-Newton from `near`; if that ends in a dead end, again from a few poses
        around it, always the same ones.

        Raises:
            JobError: No solution within the position limits was found.
        """
        start = np.array(near, dtype=np.float64)
        limits = self._robot.limits
        generator = np.random.default_rng(0)
        attempts = _RESTARTS if np.isfinite(goal).all() else 0
        for attempt in range(attempts):
            q = start if attempt == 0 else start + generator.normal(0.0, 0.7, len(start))
            found = self._descend(goal, q.copy(), tcp, position_error, orientation_error)
            if found is not None and not (
                (found < limits.lower).any() or (found > limits.upper).any()
            ):
                return found
        raise JobError(
            "no inverse kinematics solution", value=[round(value, 4) for value in to_pose(goal)]
        )

    def _descend(
        self, goal: Array, q: Array, tcp: Array, position_error: float, orientation_error: float
    ) -> Array | None:
        damping, last = 1e-3, math.inf
        best, slope, pull = q, np.eye(6), np.zeros(6)
        for _ in range(_ITERATIONS):
            tool, jacobian = self.jacobian(q.tolist(), tcp)
            turn = rotation_vector(goal[:3, :3] @ tool[:3, :3].T)
            error = np.concatenate([goal[:3, 3] - tool[:3, 3], turn])
            size = float(error @ error)
            if (
                np.linalg.norm(error[:3]) <= position_error
                and np.linalg.norm(turn) <= orientation_error
            ):
                return q
            if size < last:
                best, last, damping = q, size, max(damping * 0.2, 1e-12)
                slope, pull = jacobian.T @ jacobian, jacobian.T @ error
            else:
                damping *= 10.0
                if damping > 1e6:
                    return None
            step = np.linalg.solve(slope + damping * np.eye(len(q)), pull)
            longest = float(np.max(np.abs(step)))
            q = best + step * min(1.0, _STEP / max(longest, _SMALL))
        return None


@dataclass(frozen=True, slots=True)
class Arc:
    """A part of a circle."""

    centre: Array
    """(3) [m]."""
    first: Array
    """(3) from the centre to the start [m]."""
    rotation: Array
    """(3) the rotation vector of all of it [rad]."""

    @property
    def length(self) -> float:
        """How long the way is [m]."""
        return float(np.linalg.norm(self.rotation) * np.linalg.norm(self.first))

    def turn(self, share: float) -> Array:
        """(3, 3) how the way has turned at a share of it."""
        return rotation_matrix(share * self.rotation)

    def point(self, share: float) -> Array:
        """(3) the point at a share of the way [m]."""
        return self.centre + self.turn(share) @ self.first


def arc_through(start: Array, via: Array, end: Array) -> Arc:
    """The arc from a point (3) through another to a third [m]; `InputError` for points in line."""
    b, c = via - start, end - start
    normal = np.cross(b, c)
    area = float(normal @ normal)
    if area < _FLAT * max(float(b @ b) * float(c @ c), _FLAT):
        raise InputError("movec needs three points that are not in line", value=end.tolist())
    across = float(b @ b) * np.cross(c, normal) + float(c @ c) * np.cross(normal, b)
    centre = start - across / (-2.0 * area)
    first, axis = start - centre, normal / math.sqrt(area)
    side = np.cross(axis, first)
    last = end - centre
    angle = math.atan2(float(last @ side), float(last @ first)) % (2.0 * math.pi)
    return Arc(centre, first, angle * axis)
