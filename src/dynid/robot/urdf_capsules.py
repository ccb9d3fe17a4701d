"""Capsules from the collision geometry of a URDF, for robots that have none of their own.

Boxes, cylinders and spheres become the smallest capsules around them, along their longest
side. Meshes need the extra `collision` (coal reads them); see `mesh_capsules`. What cannot be
read becomes a note, never an error: a verdict on collisions then says what it did not see.
"""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import MissingExtraError, RobotError
from dynid.robot.capsule import Capsule
from dynid.robot.files import read_limited, shown, shown_path
from dynid.robot.mesh_capsules import Ends, around_box, around_triangles, read_mesh
from dynid.robot.model import RobotModel
from dynid.robot.urdf import MAX_BYTES, place_links
from dynid.robot.urdf_numbers import read_number, read_origin, read_vector
from dynid.robot.urdf_trunk import find_trunk
from dynid.robot.urdf_xml import parse_root, parse_urdf


def with_collision_geometry(
    robot: RobotModel, path: str | Path, *, tip: str | None = None
) -> RobotModel:
    """The robot with capsules around the `collision` elements of its URDF.

    Args:
        robot: What `load_urdf` gave; a robot with capsules is returned as it is.
        path: The URDF file.
        tip: The link to which the arm leads, as `load_urdf` was told.

    Returns:
        The robot, with a capsule note for every element that was left out.

    Raises:
        RobotError: The file is not the robot's.
    """
    if robot.capsules:
        return robot
    file = Path(path)
    where = shown_path(file)
    data = read_limited(file, MAX_BYTES)
    tree = parse_urdf(data, where)
    trunk = find_trunk(tree, where, tip=tip, locked=dict(robot.locked))
    poses, carriers = place_links(tree, trunk)
    found: list[Capsule] = []
    notes: list[str] = []
    unread: list[str] = []
    for link in parse_root(data, where).iterfind("link"):
        name = (link.get("name") or "").strip()
        shapes: list[Ends] = []
        for k, element in enumerate(link.iterfind("collision")):
            at = f"link {shown(name, 40)}: collision {k + 1}"
            try:
                placed = poses[name] @ read_origin(element, at)
                shapes += [
                    (_moved(placed, start), _moved(placed, end), radius)
                    for start, end, radius in _shapes(element, at, file.parent, notes)
                ]
            except MissingExtraError:
                unread.append(shown(name, 40))
            except RobotError as error:
                notes.append(f"{at} is not judged: {error.what}")
        found += [
            Capsule(
                name=f"{shown(name, 40)} {k + 1}",
                link=carriers[name],
                start=start,
                end=end,
                radius=radius,
            )
            for k, (start, end, radius) in enumerate(shapes)
        ]
    if unread:
        named = ", ".join(dict.fromkeys(unread))
        notes.append(f"meshes of {named} are not judged: pip install 'dynid[collision]' reads them")
    return replace(robot, capsules=tuple(found), capsule_notes=(*robot.capsule_notes, *notes))


def _moved(placed: Array, point: Array) -> Array:
    return placed[:3, :3] @ point + placed[:3, 3]


def _shapes(element: ET.Element, where: str, folder: Path, notes: list[str]) -> list[Ends]:
    geometry = element.find("geometry")
    if geometry is None or len(geometry) == 0:
        return []
    shape = geometry[0]
    zero = np.zeros(3)
    if shape.tag == "sphere":
        return [(zero, zero, _size(read_number(shape, "radius", where), where))]
    if shape.tag == "cylinder":
        sizes = [read_number(shape, key, where) for key in ("radius", "length")]
        radius, length = (_size(value, where) for value in sizes)
        return [around_box(zero, np.array([radius, radius, length / 2]), np.eye(3), True)]
    if shape.tag == "box":
        sides = [_size(value, where) for value in read_vector(shape, "size", where)]
        return [around_box(zero, np.array(sides) / 2, np.eye(3))]
    if shape.tag == "mesh":
        return _mesh(shape, where, folder, notes)
    notes.append(f"{where} is not judged: no capsule for a {shown(shape.tag, 40)}")
    return []


def _size(value: float, where: str) -> float:
    if not (math.isfinite(value) and value > 0):
        raise RobotError("its size is not positive", where=where, value=value)
    return value


def _mesh(shape: ET.Element, where: str, folder: Path, notes: list[str]) -> list[Ends]:
    name = (shape.get("filename") or "").strip()
    file = _found(name, folder)
    if file is None:
        notes.append(f"{where} is not judged: the mesh {shown(name)} was not found")
        return []
    scale = np.array(read_vector(shape, "scale", where)) if shape.get("scale") else np.ones(3)
    return around_triangles(read_mesh(file, scale))


def _found(name: str, folder: Path) -> Path | None:
    """A mesh file: beside the URDF, or in the package's folder above it."""
    plain = name.removeprefix("file://")
    if plain.startswith("package://"):
        inner = plain.removeprefix("package://")
        roots = [folder, *folder.parents]
        tries = [root / inner for root in roots]
        tries += [
            root / Path(*Path(inner).parts[1:]) for root in roots if len(Path(inner).parts) > 1
        ]
        listed = os.environ.get("ROS_PACKAGE_PATH", "")
        tries += [Path(root) / inner for root in listed.split(os.pathsep) if root]
    else:
        tries = [folder / plain]
    return next((one for one in tries if one.is_file()), None)
