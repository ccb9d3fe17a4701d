"""Where the tool of the arm is, and how to get it somewhere."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dynid.core import Array, JobError
from dynid.robot import RobotModel
from dynid.simulation.controller.motion_chain import chain
from dynid.simulation.controller.motion_poses import rotation_vector, to_pose

_SMALL = 1e-12
_ELBOW = 2
_ITERATIONS = 60
_RESTARTS = 5
_STEP = 0.5
_RATE_STEP_S = 1e-4


class ToolKinematics:
    """Forward and inverse kinematics of a robot's tool.

    Args:
        robot: The robot; revolute joints only.
    """

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
