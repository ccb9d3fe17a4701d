"""The limits at one instant, and the bodies that are nearest to each other then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.constraints.collision import Bodies
from dynid.constraints.collision_kernels import place_shapes
from dynid.constraints.distance import closest_on_segments, segment_to_shape
from dynid.constraints.motion import MotionConstraints
from dynid.constraints.usage import DISTANCES, Worst
from dynid.core.arrays import Array
from dynid.robot.kinematics import joint_poses
from dynid.robot.model import RobotModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Near:
    """Two bodies and the way between them."""

    kind: str
    """`self_collision` or `environment`."""
    names: str
    distance: float
    """Between their surfaces, less what they may overlap [m]."""
    clearance: float
    """The smallest that is allowed [m]."""
    start: Array
    """(3) on the first body's surface, in the base frame [m]."""
    end: Array
    """(3) on the other's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Instant:
    """What is true now."""

    poses: Array
    """(n, 4, 4) joint frames in the base frame [m]."""
    worst: dict[str, Worst]
    """Kind of limit to its use."""
    near: tuple[Near, ...]
    """The nearest pair of each kind of distance."""


def instant(constraints: MotionConstraints, q: Array, dq: Array, ddq: Array) -> Instant:
    """Judge one instant.

    Args:
        constraints: The judge.
        q: (n) positions [rad or m].
        dq: (n) velocities.
        ddq: (n) accelerations.
    """
    rows = [np.array(values, dtype=np.float64)[None] for values in (q, dq, ddq)]
    poses = joint_poses(constraints.robot, q)
    around = constraints.surroundings
    near: list[Near] = []
    if around is not None:
        for kind in DISTANCES:
            names = around.names.get(kind)
            if names:
                near.append(_near(constraints, around.bodies, kind, names, rows[0], poses))
    worst = constraints.usage(rows[0], rows[1], rows[2]).worst
    return Instant(poses=poses, worst=worst, near=tuple(near))


def at_rest(robot: RobotModel, q: Array) -> Instant:
    """An instant of which nothing is judged."""
    return Instant(poses=joint_poses(robot, q), worst={}, near=())


def _near(
    constraints: MotionConstraints,
    bodies: Bodies,
    kind: str,
    names: list[str],
    q: Array,
    poses: Array,
) -> Near:
    around = kind == "environment"
    found = bodies.nearest(q, around=around)
    row = int(found.pair[0])
    held = row - len(bodies.pairs)
    solid = around or held >= 0
    first, second = (
        bodies.meetings[row] if around else bodies.holds[held] if solid else bodies.pairs[row]
    )
    a, b = _segment(bodies, int(first), poses)
    radius = float(bodies.radius[first])
    if solid:
        slope, shapes = np.empty(3), np.array(bodies.shapes)
        carried = np.ascontiguousarray(poses[-1, :3, :3]), np.array(poses[-1, :3, 3])
        place_shapes(np.array(bodies.shapes), len(bodies.corners), *carried, shapes)
        far, share = segment_to_shape(shapes[second], a, b, slope)
        middle = a + share * (b - a)
        start, end = middle - radius * slope, middle - far * slope
    else:
        c, d = _segment(bodies, int(second), poses)
        far, s, t = closest_on_segments(a, b, c, d)
        p, r = a + s * (b - a), c + t * (d - c)
        way = (r - p) / far if far > 0 else np.zeros(3)
        start, end = p + radius * way, r - float(bodies.radius[second]) * way
    return Near(
        kind=kind,
        names=names[row],
        distance=float(found.distance[0]),
        clearance=constraints.settings.clearances[kind],
        start=start,
        end=end,
    )


def _segment(bodies: Bodies, capsule: int, poses: Array) -> tuple[Array, Array]:
    """Both ends (3) of a capsule's middle line in the base frame."""
    link = int(bodies.link[capsule])
    pose = np.eye(4) if link == 0 else poses[link - 1]
    a, b = (pose[:3, :3] @ end + pose[:3, 3] for end in bodies.ends[capsule])
    return a, b
