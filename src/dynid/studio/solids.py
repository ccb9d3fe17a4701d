"""Triangles of the arm's capsules and of the shapes of a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dynid.constraints.shapes import BOX, CYLINDER, HALF_SPACE, Shape
from dynid.core.arrays import Array, Indices
from dynid.robot.kinematics import joint_poses
from dynid.robot.model import RobotModel

AROUND, ALONG = 20, 6
"""Segments of a capsule's circle, and of each of its caps."""
STICK = 0.035
"""Radius of the arm's bodies where none are known, as a share of its reach."""
PLANE = 3.0
"""Side of what is drawn of a floor or a wall [m]."""
_THIN = 0.004


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkMesh:
    """A body that moves with a link."""

    name: str
    link: int
    """0 for the base, i for what joint i moves."""
    vertices: Array
    """(V, 3) in the joint frame of the link [m]."""
    faces: Indices
    """(F, 3)"""


def arm_meshes(robot: RobotModel) -> tuple[LinkMesh, ...]:
    """The robot's capsules; thin ones from joint to joint where it has none."""
    if not robot.capsules:
        return _sticks(robot)
    return tuple(
        _link_mesh(item.name, item.link, item.start, item.end, item.radius)
        for item in robot.capsules
    )


def reach(robot: RobotModel) -> float:
    """Length of the arm along its joint frames at q = 0 [m]."""
    steps = [*robot.placements[:, :3, 3], robot.flange[:3, 3]]
    return float(sum(np.linalg.norm(step) for step in steps)) or 1.0


def _sticks(robot: RobotModel) -> tuple[LinkMesh, ...]:
    radius = STICK * reach(robot)
    ends = [*robot.placements[:, :3, 3], robot.flange[:3, 3]]
    zero = np.zeros(3)
    return tuple(
        _link_mesh(f"link {k}", k, zero, end, radius * (1.0 - 0.5 * k / len(ends)))
        for k, end in enumerate(ends)
    )


def _link_mesh(name: str, link: int, start: Array, end: Array, radius: float) -> LinkMesh:
    vertices, faces = capsule(start, end, radius)
    return LinkMesh(name=name, link=link, vertices=vertices, faces=faces)


def capsule(start: Array, end: Array, radius: float) -> tuple[Array, Indices]:
    """Triangles of a capsule; its vertices lie on its surface.

    Args:
        start: (3) one end of the middle line [m].
        end: (3) the other one.
        radius: [m]

    Returns:
        (V, 3) vertices and (F, 3) faces, seen from outside.
    """
    way = end - start
    length = float(np.linalg.norm(way))
    z = way / length if length > 0 else np.array([0.0, 0.0, 1.0])
    side = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = side - (side @ z) * z
    x = x / np.linalg.norm(x)
    y = np.cross(z, x)
    low = np.linspace(-math.pi / 2, 0.0, ALONG + 1)
    heights = np.concatenate([low, -low[::-1]])
    lifts = np.repeat([0.0, length], ALONG + 1)
    turns = np.linspace(0.0, 2 * math.pi, AROUND, endpoint=False)
    circle = np.cos(turns)[:, None] * x + np.sin(turns)[:, None] * y
    vertices = (
        start
        + lifts[:, None, None] * z
        + radius * np.sin(heights)[:, None, None] * z
        + radius * np.cos(heights)[:, None, None] * circle
    ).reshape(-1, 3)
    return vertices, _bands(len(heights), AROUND)


def _bands(rings: int, around: int) -> Indices:
    first = np.arange(around)
    after = (first + 1) % around
    base = (np.arange(rings - 1) * around)[:, None]
    quads = [
        np.stack([base + first, base + after, base + around + after], axis=-1),
        np.stack([base + first, base + around + after, base + around + first], axis=-1),
    ]
    return np.concatenate(quads).reshape(-1, 3).astype(np.intp)


def shape_mesh(shape: Shape) -> tuple[Array, Indices]:
    """Triangles of a shape in its own frame; of a half-space, a thin plate.

    Returns:
        (V, 3) vertices [m] and (F, 3) faces.
    """
    if shape.kind == HALF_SPACE:
        vertices, faces = _box(np.array([PLANE / 2, PLANE / 2, _THIN / 2]))
        return vertices - np.array([0.0, 0.0, _THIN / 2]), faces
    if shape.kind == BOX:
        return _box(shape.size)
    if shape.kind == CYLINDER:
        return _cylinder(float(shape.size[0]), float(shape.size[1]))
    return capsule(np.zeros(3), np.zeros(3), float(shape.size[0]))


def _box(half: Array) -> tuple[Array, Indices]:
    signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    return signs * half, np.array(faces, dtype=np.intp)


def _cylinder(radius: float, half: float) -> tuple[Array, Indices]:
    turns = np.linspace(0.0, 2 * math.pi, AROUND, endpoint=False)
    circle = np.stack([radius * np.cos(turns), radius * np.sin(turns)], axis=1)
    rings = [
        np.c_[share * circle, np.full(AROUND, z)]
        for share, z in ((0.0, -half), (1.0, -half), (1.0, half), (0.0, half))
    ]
    return np.concatenate(rings), _bands(4, AROUND)


def link_poses(robot: RobotModel, q: Array) -> Array:
    """(n + 1, 4, 4) frames of the links, the base first [m]."""
    return np.concatenate([np.eye(4)[None], joint_poses(robot, q)])
