"""Triangles of the arm's capsules and of the shapes of a scene.

The meshes that a URDF gives its links to be looked at.
"""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid.constraints import BOX, CYLINDER, HALF_SPACE, SPHERE, Shape
from dynid.core import Array, DynidError, Indices, require
from dynid.robot import (
    MAX_BYTES,
    RobotModel,
    find_trunk,
    joint_poses,
    parse_root,
    parse_urdf,
    place_links,
    read_limited,
    read_number,
    read_origin,
    read_vector,
    shown,
    shown_path,
)

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


MAX_MESH = 40_000_000
"""The largest mesh file that is read [bytes]."""
Triangles = tuple[Array, Any]


def robot_meshes(robot: RobotModel, reference: str, notes: list[str]) -> tuple[LinkMesh, ...]:
    """What to draw of a robot: a URDF's `visual` elements where they can be read, else capsules.

    Args:
        robot: The robot.
        reference: Its built-in name or path.
        notes: Where it is said what cannot be drawn.
    """
    path = Path(reference)
    if path.suffix.lower() == ".urdf" and path.is_file():
        try:
            found = visual_meshes(robot, path, notes)
        except DynidError as error:
            # The file was good enough for a robot; what is only to be looked at may be broken.
            notes.append(f"not drawn: {error}")
            found = ()
        if found:
            return found
    return arm_meshes(robot)


def visual_meshes(robot: RobotModel, path: Path, notes: list[str]) -> tuple[LinkMesh, ...]:
    """The `visual` elements of a URDF, in the joint frames of the robot's links.

    Args:
        robot: What the file gave.
        path: The URDF.
        notes: Where it is said which meshes were left out.

    Raises:
        RobotError: The file is not the robot's, or an element is broken.
    """
    where = shown_path(path)
    data = read_limited(path, MAX_BYTES)
    tree = parse_urdf(data, where)
    trunk = find_trunk(tree, where, locked=dict(robot.locked))
    poses, carriers = place_links(tree, trunk)
    found: list[LinkMesh] = []
    for link in parse_root(data, where).iterfind("link"):
        name = (link.get("name") or "").strip()
        for element in link.iterfind("visual"):
            triangles = _triangles(element, where, path.parent, notes)
            if triangles is None:
                continue
            pose = poses[name] @ read_origin(element, where)
            vertices = triangles[0] @ pose[:3, :3].T + pose[:3, 3]
            found.append(
                LinkMesh(
                    name=shown(name, 40),
                    link=carriers[name],
                    vertices=vertices,
                    faces=triangles[1],
                )
            )
    return tuple(found)


def _triangles(element: ET.Element, where: str, folder: Path, notes: list[str]) -> Triangles | None:
    geometry = element.find("geometry")
    if geometry is None or len(geometry) == 0:
        return None
    shape = geometry[0]
    if shape.tag == "box":
        return _solid(BOX, np.array(read_vector(shape, "size", where)) / 2)
    if shape.tag == "cylinder":
        radius, length = (read_number(shape, key, where) for key in ("radius", "length"))
        return _solid(CYLINDER, np.array([radius, length / 2, 0.0]))
    if shape.tag == "sphere":
        return _solid(SPHERE, np.array([read_number(shape, "radius", where), 0.0, 0.0]))
    if shape.tag != "mesh":
        return None
    name = (shape.get("filename") or "").strip()
    file = mesh_file(name, folder)
    if file is None or file.stat().st_size > MAX_MESH:
        notes.append(f"the mesh {shown(name)} was not found, or is too large: not drawn")
        return None
    scale = np.array(read_vector(shape, "scale", where)) if shape.get("scale") else np.ones(3)
    try:
        return _read(file, scale)
    except Exception as error:
        # trimesh's readers raise whatever they meet in a file.
        notes.append(f"the mesh {shown(name)} cannot be read: {type(error).__name__}, {error}")
        return None


def _solid(kind: int, size: Array) -> Triangles:
    return shape_mesh(Shape(name="visual", kind=kind, pose=np.eye(4), size=size))


def _read(file: Path, scale: Array) -> Triangles:
    trimesh: Any = require("trimesh", "studio")
    mesh = trimesh.load_mesh(str(file))
    vertices = np.asarray(mesh.vertices, dtype=np.float64) * scale
    faces = np.asarray(mesh.faces, dtype=np.intp)
    if not len(faces) or not np.isfinite(vertices).all():
        raise ValueError("no triangles in it")
    return vertices, faces


def mesh_file(name: str, folder: Path) -> Path | None:
    """A mesh file: beside the URDF, or in its package's folder above it; None if not found."""
    plain = name.removeprefix("file://")
    if not plain.startswith("package://"):
        tries = [folder / plain]
    else:
        inner = Path(plain.removeprefix("package://"))
        roots = [folder, *folder.parents]
        roots += [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
        tries = [root / inner for root in roots]
        tries += [root / Path(*inner.parts[1:]) for root in roots if len(inner.parts) > 1]
    return next((one for one in tries if one.is_file()), None)
