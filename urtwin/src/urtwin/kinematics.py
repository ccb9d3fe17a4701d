"""Poses as UR writes them (x, y, z, rotation vector), arcs, and the kinematics of the tool."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from dynid.core import Array, InputError, JobError
from dynid.robot import RobotModel

_SMALL = 1e-12
_PI_ZONE = 1e-4


def rotation_matrix(vector: Sequence[float]) -> Array:
    """(3, 3) the rotation of a rotation vector (3) [rad] (Rodrigues)."""
    x, y, z = (float(value) for value in vector)
    angle = math.sqrt(x * x + y * y + z * z)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < _SMALL:
        return np.eye(3) + cross
    near, far = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2
    return np.eye(3) + near * cross + far * (cross @ cross)


def rotation_vector(matrix: Array) -> Array:
    """(3) the rotation vector of a rotation matrix (3, 3) [rad], no longer than pi."""
    skew = 0.5 * np.array(
        [matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]
    )
    sine = float(np.linalg.norm(skew))
    cosine = 0.5 * (float(np.trace(matrix)) - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > _PI_ZONE or cosine > 0:
        return skew * (angle / sine) if sine > _SMALL else skew
    # Close to half a turn the skew part vanishes; the symmetric part still knows the axis.
    symmetric = 0.5 * (matrix + matrix.T) - cosine * np.eye(3)
    column = int(np.argmax(np.diag(symmetric)))
    axis = symmetric[:, column] / np.linalg.norm(symmetric[:, column])
    return angle * (axis if axis @ skew >= 0 else -axis)


def to_matrix(pose: Sequence[float]) -> Array:
    """(4, 4) the transform of a UR pose x, y, z, rx, ry, rz [m, rad]."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(pose[3:6])
    matrix[:3, 3] = [float(value) for value in pose[:3]]
    return matrix


def to_pose(matrix: Array) -> list[float]:
    """x, y, z, rx, ry, rz of a transform (4, 4) [m, rad]."""
    return [*matrix[:3, 3].tolist(), *rotation_vector(matrix[:3, :3]).tolist()]


@njit
def _moved(pose: Array, by: Array, out: Array) -> None:
    """Write the first three rows of the product of two transforms."""
    for i in range(3):
        for j in range(4):
            out[i, j] = pose[i, 0] * by[0, j] + pose[i, 1] * by[1, j] + pose[i, 2] * by[2, j]
        out[i, 3] += pose[i, 3]


# Elements one by one: a product or an assignment of whole arrays takes Numba seconds to compile.
@njit(cache=True)
def chain(
    placements: Array, axes: Array, q: Array, tip: Array, tool: Array, jacobian: Array, elbow: Array
) -> None:
    """The tool in the base frame and its velocity per joint speed.

    Args:
        placements: (n, 4, 4) joint frames in the previous one at q = 0 [m].
        axes: (n, 3) unit axes in the joint frames.
        q: (n) joint positions [rad].
        tip: (4, 4) tool in the last joint frame [m].
        tool: (4, 4) tool in the base frame, filled [m].
        jacobian: (6, n) linear, then angular velocity in the base frame, filled.
        elbow: (n, 3) origins of the joint frames in the base frame, filled [m].
    """
    n = len(q)
    pose, placed, turns = np.zeros((3, 4)), np.empty((3, 4)), np.empty((n, 3))
    turn = np.empty((3, 3))
    pose[0, 0] = pose[1, 1] = pose[2, 2] = 1.0
    for k in range(n):
        _moved(pose, placements[k], placed)
        x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
        c, s = math.cos(q[k]), math.sin(q[k])
        d = 1.0 - c
        turn[0, 0], turn[0, 1], turn[0, 2] = c + d * x * x, d * x * y - s * z, d * x * z + s * y
        turn[1, 0], turn[1, 1], turn[1, 2] = d * x * y + s * z, c + d * y * y, d * y * z - s * x
        turn[2, 0], turn[2, 1], turn[2, 2] = d * x * z - s * y, d * y * z + s * x, c + d * z * z
        for i in range(3):
            turns[k, i] = placed[i, 0] * x + placed[i, 1] * y + placed[i, 2] * z
            elbow[k, i] = pose[i, 3] = placed[i, 3]
            for j in range(3):
                pose[i, j] = (
                    placed[i, 0] * turn[0, j]
                    + placed[i, 1] * turn[1, j]
                    + placed[i, 2] * turn[2, j]
                )
    _moved(pose, tip, tool)
    tool[3, 0] = tool[3, 1] = tool[3, 2] = 0.0
    tool[3, 3] = 1.0
    for k in range(n):
        a, b, c = turns[k, 0], turns[k, 1], turns[k, 2]
        u = tool[0, 3] - elbow[k, 0]
        v = tool[1, 3] - elbow[k, 1]
        w = tool[2, 3] - elbow[k, 2]
        jacobian[0, k], jacobian[1, k], jacobian[2, k] = b * w - c * v, c * u - a * w, a * v - b * u
        jacobian[3, k], jacobian[4, k], jacobian[5, k] = a, b, c


_DAMPING = 1e-6


def joint_speeds(jacobian: Array, twist: Array) -> list[float]:
    """(n) joint speeds for a tool velocity (6), damped where the arm is singular."""
    gram = jacobian @ jacobian.T + _DAMPING * np.eye(6)
    return (jacobian.T @ np.linalg.solve(gram, twist)).tolist()


_ELBOW = 2
_ITERATIONS = 60
_RESTARTS = 5
_STEP = 0.5
_RATE_STEP_S = 1e-4


class ToolKinematics:
    """Forward and inverse kinematics of the tool of a robot whose joints all turn."""

    def __init__(self, robot: RobotModel) -> None:
        self._robot = robot
        self._placements = np.ascontiguousarray(robot.placements)
        self._axes = np.ascontiguousarray(robot.axes)
        # Compiled now, not in the middle of a control cycle.
        self._solve([0.0] * robot.joints, np.eye(4))

    def forward(self, q: Sequence[float], tcp: Array) -> Array:
        """(4, 4) the tool in the base frame at joint positions (n) [rad], tool in flange `tcp`."""
        return self._solve(q, tcp)[0]

    def jacobian(self, q: Sequence[float], tcp: Array) -> tuple[Array, Array]:
        """The tool in the base frame (4, 4), and its velocity per joint speed (6, n).

        Rows: linear velocity of the tool's point, angular velocity, both in the base frame.
        """
        tool, jacobian, _ = self._solve(q, tcp)
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
        _, jacobian, origins = self._solve(q, np.eye(4))
        point = origins[_ELBOW]
        columns = np.cross(jacobian[3:].T, point - origins)
        columns[_ELBOW:] = 0.0
        return point.tolist(), columns.T.tolist()

    def _solve(self, q: Sequence[float], tcp: Array) -> tuple[Array, Array, Array]:
        n = len(self._axes)
        tool, jacobian, origins = np.empty((4, 4)), np.empty((6, n)), np.empty((n, 3))
        positions = np.array(q, dtype=np.float64)
        tip = np.ascontiguousarray(self._robot.flange @ tcp)
        chain(self._placements, self._axes, positions, tip, tool, jacobian, origins)
        return tool, jacobian, origins

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


_FLAT = 1e-9


@dataclass(frozen=True, slots=True)
class Arc:
    """A part of a circle; a straight line where the three points are in line."""

    centre: Array
    """(3) [m]."""
    first: Array
    """(3) from the centre to the start [m]."""
    axis: Array
    """(3) the unit vector about which it turns."""
    angle: float
    """How far it turns [rad]."""

    @property
    def length(self) -> float:
        """How long the way is [m]."""
        return self.angle * float(np.linalg.norm(self.first))

    def turn(self, share: float) -> Array:
        """(3, 3) how the way has turned at a share of it."""
        return rotation_matrix((share * self.angle * self.axis).tolist())

    def point(self, share: float) -> Array:
        """(3) the point at a share of the way [m]."""
        return self.centre + self.turn(share) @ self.first


def arc_through(start: Array, via: Array, end: Array) -> Arc:
    """The arc from a point (3) through another to a third [m].

    Raises:
        InputError: The points are in line, or two are the same: there is no circle.
    """
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
    return Arc(centre, first, axis, angle)
