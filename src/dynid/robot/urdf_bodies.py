"""Bodies from the collision geometry of a URDF, for robots that have none of their own.

Boxes, cylinders, spheres and meshes (with the extra `collision`). What cannot be read becomes a
note, never an error: a verdict on collisions then says what it did not see.
"""

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.core import Array, MissingExtraError, RobotError, printable
from dynid.robot.body import Body, around_triangles, box_points, cylinder_points, read_mesh
from dynid.robot.model import RobotModel
from dynid.robot.tables import read_limited, shown_path
from dynid.robot.urdf import MAX_BYTES, find_trunk, place_links
from dynid.robot.urdf_xml import parse_root, parse_urdf, read_number, read_origin, read_vector

Solid = tuple[Array, float]
"""Points (K, 3) and radius [m] of a body."""


def with_collision_geometry(
    robot: RobotModel, path: str | Path, *, tip: str | None = None, mesh_dirs: Sequence[Path] = ()
) -> RobotModel:
    """The robot with bodies that hold the `collision` elements of its URDF.

    A robot with bodies is returned as it is. Meshes are looked for in further folders too; there is
    a body note for every element that was left out.

    Raises:
        RobotError: The file is not the robot's.
    """
    if robot.bodies:
        return robot
    file = Path(path)
    where = shown_path(file)
    data = read_limited(file, MAX_BYTES)
    tree = parse_urdf(data, where)
    trunk = find_trunk(tree, where, tip=tip, locked=dict(robot.locked))
    poses, carriers = place_links(tree, trunk)
    folders = (file.parent, *mesh_dirs)
    found: list[Body] = []
    notes: list[str] = []
    unread: list[str] = []
    for link in parse_root(data, where).iterfind("link"):
        name = (link.get("name") or "").strip()
        shapes: list[Solid] = []
        for k, element in enumerate(link.iterfind("collision")):
            at = f"link {printable(name, 40)}: collision {k + 1}"
            try:
                placed = poses[name] @ read_origin(element, at)
                shapes += [
                    (points @ placed[:3, :3].T + placed[:3, 3], radius)
                    for points, radius in _shapes(element, at, folders, notes)
                ]
            except MissingExtraError:
                unread.append(printable(name, 40))
            except RobotError as error:
                notes.append(f"{at} is not judged: {error.what}")
        found += [
            Body(
                name=f"{printable(name, 40)} {k + 1}",
                link=carriers[name],
                points=points,
                radius=radius,
            )
            for k, (points, radius) in enumerate(shapes)
        ]
    if unread:
        named = ", ".join(dict.fromkeys(unread))
        notes.append(f"meshes of {named} are not judged: pip install 'dynid[collision]' reads them")
    return replace(robot, bodies=tuple(found), body_notes=(*robot.body_notes, *notes))


def _shapes(
    element: ET.Element, where: str, folders: Sequence[Path], notes: list[str]
) -> list[Solid]:
    geometry = element.find("geometry")
    if geometry is None or len(geometry) == 0:
        return []
    shape = geometry[0]
    if shape.tag == "sphere":
        return [(np.zeros((1, 3)), _size(read_number(shape, "radius", where), where))]
    if shape.tag == "cylinder":
        sizes = [read_number(shape, key, where) for key in ("radius", "length")]
        radius, length = (_size(value, where) for value in sizes)
        return [(cylinder_points(radius, length / 2), 0.0)]
    if shape.tag == "box":
        sides = [_size(value, where) for value in read_vector(shape, "size", where)]
        return [(box_points(np.array(sides) / 2), 0.0)]
    if shape.tag == "mesh":
        return _mesh(shape, where, folders, notes)
    notes.append(f"{where} is not judged: no body for a {printable(shape.tag, 40)}")
    return []


def _size(value: float, where: str) -> float:
    if not (math.isfinite(value) and value > 0):
        raise RobotError("its size is not positive", where=where, value=value)
    return value


def _mesh(shape: ET.Element, where: str, folders: Sequence[Path], notes: list[str]) -> list[Solid]:
    name = (shape.get("filename") or "").strip()
    tries = mesh_places(name, folders)
    file = next((one for one in tries if one.is_file()), None)
    if file is None:
        looked = ", ".join(dict.fromkeys(shown_path(one) for one in tries[:_NAMED]))
        unset = [key for key in _SEARCHED if not os.environ.get(key)]
        notes.append(
            f"{where} is not judged: the mesh {printable(name)} was not found; looked for {looked}"
            f"{' ...' if len(tries) > _NAMED else ''}"
            f"{f' ({chr(32).join(unset)} not set)' if unset else ''}"
        )
        return []
    scale = np.array(read_vector(shape, "scale", where)) if shape.get("scale") else np.ones(3)
    return around_triangles(read_mesh(file, scale))


_SEARCHED = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH")
_NAMED = 8
"""Places named where a mesh was not found."""


def mesh_places(name: str, folders: Sequence[Path]) -> list[Path]:
    """Where a mesh may be: as ROS 2 and ROS find packages, in the folders given, by the file.

    Args:
        name: As the URDF has it: a path, or `package://PACKAGE/PATH`.
        folders: That of the URDF, then those given.
    """
    plain = name.removeprefix("file://")
    near, *given = folders
    package, _, inner = plain.partition("://")
    if not inner:
        return [near / plain, *(one / Path(plain).name for one in given)]
    package, _, rest = inner.partition("/")
    found: list[Path] = []
    for one in given:
        found += [one / inner, one / rest, one / Path(rest).name]
    prefixes, roots = (os.environ.get(key, "").split(os.pathsep) for key in _SEARCHED)
    found += [Path(one) / "share" / package / rest for one in prefixes if one]
    for one in (Path(root) for root in roots if root):
        found += [one / inner, *([one / rest] if one.name == package else [])]
    for one in (near, *near.parents):
        found += [one / inner, one / rest]
    return found
