"""The arm's kinematics as the compiled judges read it."""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from dynid.core import Array, Indices, read_only
from dynid.robot import RobotModel


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmGeometry:
    """Joint frames as functions of the joint positions, and how far points are from axes."""

    joints: Array
    """(n, 36) R0, R1, R2 (row-major), p0, p3, axis: joint frame i in frame i - 1 is
    R = R0 + R1 cos q + R2 sin q, p = p0 + p3 q; the axis in its own frame."""
    prismatic: Indices
    """(n) 1 where the joint slides."""
    offsets: Array
    """(n) length of p0, the way from frame i - 1 to frame i [m]."""

    @property
    def count(self) -> int:
        """Number of joints n."""
        return len(self.prismatic)

    def reach(self, link: int, point: Array, travel: Array) -> Array:
        """(n) a bound on how fast each joint moves a point (3) of a link [m/rad or 1].

        Not below the true one anywhere: the point is never farther from axis k than the way along
        the arm, for joints that travel to `travel` (n), the largest |q| of each [rad or m].
        """
        found = np.zeros(self.count)
        way = float(np.linalg.norm(point))
        for k in range(link - 1, -1, -1):
            slides = bool(self.prismatic[k])
            found[k] = 1.0 if slides else way
            way += self.offsets[k] + (float(travel[k]) if slides else 0.0)
        return found


def arm_geometry(robot: RobotModel) -> ArmGeometry:
    """The geometry of a robot."""
    rows = np.zeros((robot.joints, 36))
    for k, row in enumerate(rows):
        turn, place = robot.placements[k, :3, :3], robot.placements[k, :3, 3]
        axis = robot.axes[k]
        cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        outer = np.outer(axis, axis)
        if robot.prismatic[k]:
            row[:9] = turn.ravel()
            row[30:33] = turn @ axis
        else:
            row[:9] = (turn @ outer).ravel()
            row[9:18] = (turn @ (np.eye(3) - outer)).ravel()
            row[18:27] = (turn @ cross).ravel()
        row[27:30] = place
        row[33:36] = axis
    return ArmGeometry(
        joints=read_only(rows),
        prismatic=np.array(robot.prismatic, dtype=np.intp),
        offsets=read_only(np.linalg.norm(robot.placements[:, :3, 3], axis=1)),
    )


def samples_of(values: Array) -> Array:
    """A contiguous writable copy: read-only arrays would make Numba compile once more."""
    return np.array(values, dtype=np.float64, order="C", ndmin=2)


@njit(cache=True, fastmath=True, error_model="numpy")
def place_joints(joints: Array, q: Array, turn: Array, origin: Array, axis: Array) -> None:
    """Write the joint frames at q (n) in the base frame.

    Of `ArmGeometry.joints`: rotations (n + 1, 3, 3) and origins (n + 1, 3) [m], the base first, and
    axes (n, 3).
    """
    for r in range(3):
        for c in range(3):
            turn[0, r, c] = 1.0 if r == c else 0.0
        origin[0, r] = 0.0
    for i in range(len(q)):
        g = joints[i]
        cosine, sine = math.cos(q[i]), math.sin(q[i])
        for r in range(3):
            t0, t1, t2 = turn[i, r, 0], turn[i, r, 1], turn[i, r, 2]
            for c in range(3):
                a = g[c] + g[9 + c] * cosine + g[18 + c] * sine
                b = g[3 + c] + g[12 + c] * cosine + g[21 + c] * sine
                d = g[6 + c] + g[15 + c] * cosine + g[24 + c] * sine
                turn[i + 1, r, c] = t0 * a + t1 * b + t2 * d
            p0 = g[27] + g[30] * q[i]
            p1 = g[28] + g[31] * q[i]
            p2 = g[29] + g[32] * q[i]
            origin[i + 1, r] = origin[i, r] + t0 * p0 + t1 * p1 + t2 * p2
        for r in range(3):
            t0, t1, t2 = turn[i + 1, r, 0], turn[i + 1, r, 1], turn[i + 1, r, 2]
            axis[i, r] = t0 * g[33] + t1 * g[34] + t2 * g[35]


@njit(cache=True, fastmath=True, error_model="numpy")
def place_point(turn: Array, origin: Array, point: Array, out: Array) -> None:
    """Write a point of one link in the base frame: turn (3, 3), origin (3), point (3)."""
    for r in range(3):
        out[r] = origin[r] + turn[r, 0] * point[0] + turn[r, 1] * point[1] + turn[r, 2] * point[2]


@njit(cache=True, fastmath=True, error_model="numpy")
def collect(
    origin: Array, axis: Array, prismatic: Indices, force: Array, moment: Array, out: Array
) -> None:
    """Add what forces on the links do at the joints to `out` (n).

    With joint origins (n + 1, 3) [m] and axes (n, 3); the sums of the forces on each link (n + 1,
    3) and of their moments about the base's origin are overwritten.
    """
    n = len(prismatic)
    for k in range(n - 1, -1, -1):
        f0, f1, f2 = force[k + 1, 0], force[k + 1, 1], force[k + 1, 2]
        if prismatic[k]:
            out[k] += axis[k, 0] * f0 + axis[k, 1] * f1 + axis[k, 2] * f2
        else:
            x, y, z = origin[k + 1, 0], origin[k + 1, 1], origin[k + 1, 2]
            out[k] += (
                axis[k, 0] * (moment[k + 1, 0] - y * f2 + z * f1)
                + axis[k, 1] * (moment[k + 1, 1] - z * f0 + x * f2)
                + axis[k, 2] * (moment[k + 1, 2] - x * f1 + y * f0)
            )
        for r in range(3):
            force[k, r] += force[k + 1, r]
            moment[k, r] += moment[k + 1, r]
