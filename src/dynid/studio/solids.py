"""Triangles of the arm's bodies and of the shapes of a scene.

The meshes that a URDF gives its links to be looked at.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.constraints import BOX, CYLINDER, HALF_SPACE, SPHERE, Shape, body_of
from dynid.core import Array, DynidError, Indices, require
from dynid.robot import (
    MAX_BYTES,
    Body,
    RobotModel,
    box_points,
    find_trunk,
    joint_poses,
    mesh_places,
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
    """The robot's bodies; thin ones from joint to joint where it has none."""
    return tuple(
        LinkMesh(name=body.name, link=body.link, vertices=vertices, faces=faces)
        for body in robot.bodies or _sticks(robot)
        for vertices, faces in [body.surface()]
    )


def reach(robot: RobotModel) -> float:
    """Length of the arm along its joint frames at q = 0 [m]."""
    steps = [*robot.placements[:, :3, 3], robot.flange[:3, 3]]
    return float(sum(np.linalg.norm(step) for step in steps)) or 1.0


def _sticks(robot: RobotModel) -> tuple[Body, ...]:
    radius = STICK * reach(robot)
    ends = [*robot.placements[:, :3, 3], robot.flange[:3, 3]]
    return tuple(
        Body(
            name=f"link {k}",
            link=k,
            points=np.array([np.zeros(3), end]),
            radius=radius * (1.0 - 0.5 * k / len(ends)),
        )
        for k, end in enumerate(ends)
    )


def shape_mesh(shape: Shape) -> tuple[Array, Indices]:
    """Triangles of a shape in its own frame; of a half-space, a thin plate.

    Returns:
        (V, 3) vertices [m] and (F, 3) faces.
    """
    if shape.kind == HALF_SPACE:
        half = np.array([PLANE / 2, PLANE / 2, _THIN / 2])
        points = box_points(half) - np.array([0.0, 0.0, _THIN / 2])
        return Body(name=shape.name, link=0, points=points, radius=0.0).surface()
    return body_of(replace(shape, pose=np.eye(4))).surface()


def link_poses(robot: RobotModel, q: Array) -> Array:
    """(n + 1, 4, 4) frames of the links, the base first [m]."""
    return np.concatenate([np.eye(4)[None], joint_poses(robot, q)])


MAX_MESH = 40_000_000
"""The largest mesh file that is read [bytes]."""
Triangles = tuple[Array, Any]


def robot_meshes(robot: RobotModel, reference: str, notes: list[str]) -> tuple[LinkMesh, ...]:
    """What to draw of a robot: a URDF's `visual` elements where they can be read, else its bodies.

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
    file = next((one for one in mesh_places(name, (folder,)) if one.is_file()), None)
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
