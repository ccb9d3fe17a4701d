"""The meshes that a URDF gives its links to be looked at."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np

from dynid.constraints.shapes import BOX, CYLINDER, SPHERE, Shape
from dynid.core.arrays import Array
from dynid.core.errors import DynidError
from dynid.core.optional import require
from dynid.robot.files import read_limited, shown, shown_path
from dynid.robot.model import RobotModel
from dynid.robot.urdf import MAX_BYTES, place_links
from dynid.robot.urdf_numbers import read_number, read_origin, read_vector
from dynid.robot.urdf_trunk import find_trunk
from dynid.robot.urdf_xml import parse_root, parse_urdf
from dynid.studio.solids import LinkMesh, arm_meshes, shape_mesh

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
