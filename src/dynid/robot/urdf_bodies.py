"""The `collision` and `visual` elements of a URDF: bodies to judge, triangles to draw.

Boxes, cylinders, spheres and meshes (with the extra `collision`). What cannot be read becomes a
note, never an error: a verdict on collisions then says what it did not see.
"""

import math
import os
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynid.core import Array, Indices, MissingExtraError, RobotError, printable
from dynid.robot import body, kinematics, model, urdf
from dynid.robot.tables import read_limited, shown_path
from dynid.robot.urdf_xml import parse_root, read_number, read_origin, read_vector


class _NoMesh(RobotError):
    """The file of a mesh is not there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfShape:
    """One element of a URDF with a geometry."""

    name: str
    """That of its link."""
    link: int
    """0 for the base, i for what joint i moves."""
    frame: Array
    """(4, 4) the frame of the URDF's link in the joint frame [m]."""
    element: ET.Element
    shape: ET.Element
    """The geometry in the element."""
    where: str
    """The element in words."""
    folders: tuple[Path, ...]
    """Where meshes are looked for, that of the URDF first."""

    def solids(self) -> list[tuple[Array, float, Array]]:
        """Convex bodies that hold it: points (K, 3) in the joint frame, radius, what is held [m].

        The last are corners (P, 3) in the joint frame, of a mesh; none where the body is exact.

        Raises:
            RobotError: A geometry that is not known or not sound, or a mesh that is not found.
            MissingExtraError: A mesh without the extra `collision`.
        """
        shape, where = self.shape, self.where
        if shape.tag == "mesh":
            found = body.around_triangles(self._mesh())
        elif shape.tag == "sphere":
            found = [(np.zeros((1, 3)), _size(read_number(shape, "radius", where), where), _EXACT)]
        elif shape.tag == "cylinder":
            sizes = [read_number(shape, key, where) for key in ("radius", "length")]
            radius, length = (_size(value, where) for value in sizes)
            found = [(body.cylinder_points(radius, length / 2), 0.0, _EXACT)]
        elif shape.tag == "box":
            sides = [_size(value, where) for value in read_vector(shape, "size", where)]
            found = [(body.box_points(np.array(sides) / 2), 0.0, _EXACT)]
        else:
            raise RobotError(f"no body for a {printable(shape.tag, 40)}")
        return [(self._placed(a), radius, self._placed(held)) for a, radius, held in found]

    def surface(self) -> tuple[Array, Indices]:
        """Its triangles: vertices (V, 3) in the joint frame [m] and faces (F, 3).

        Raises:
            RobotError: As `solids`.
            MissingExtraError: As `solids`.
        """
        if self.shape.tag == "mesh":
            corners = self._placed(self._mesh().reshape(-1, 3))
            return corners, np.arange(len(corners)).reshape(-1, 3)
        ((points, radius, _),) = self.solids()
        return body.Body(name=self.name, link=self.link, points=points, radius=radius).surface()

    def _placed(self, points: Array) -> Array:
        pose = self.frame @ read_origin(self.element, self.where)
        return points @ pose[:3, :3].T + pose[:3, 3]

    def _mesh(self) -> Array:
        """(T, 3, 3) triangles."""
        name = (self.shape.get("filename") or "").strip()
        tries = _mesh_places(name, self.folders)
        file = next((one for one in tries if one.is_file()), None)
        if file is None:
            looked = ", ".join(dict.fromkeys(shown_path(one) for one in tries[:_NAMED]))
            unset = [key for key in _SEARCHED if not os.environ.get(key)]
            raise _NoMesh(
                f"the mesh {printable(name)} was not found; looked for {looked}"
                f"{' ...' if len(tries) > _NAMED else ''}"
                f"{f' ({chr(32).join(unset)} not set)' if unset else ''}"
            )
        scale = np.ones(3)
        if self.shape.get("scale"):
            scale = np.array(read_vector(self.shape, "scale", self.where))
        return body.read_mesh(file, scale)


def with_collision_geometry(
    robot: model.RobotModel,
    path: Path,
    *,
    mesh_dirs: Sequence[Path] = (),
    apart_from: Collection[int] = (),
) -> model.RobotModel:
    """The robot with bodies that hold the `collision` elements of its URDF.

    Those of what the joints numbered `apart_from` move (0 the base) are left out. Of links without
    any such element the `visual` ones are held where they reach beyond the bodies of the links they
    are fixed to: a note says so. Meshes are looked for in further folders too; there is a body note
    for every element that was left out.

    Raises:
        RobotError: The file is not the robot's.
    """
    found: list[body.Body] = []
    held: list[Array] = []
    notes: list[str] = []
    unread: list[str] = []
    lost: list[tuple[str, str]] = []
    count = Counter[str]()
    shapes, seen = (
        [
            item
            for item in urdf_shapes(robot, path, kind, mesh_dirs=mesh_dirs)
            if item.link not in apart_from
        ]
        for kind in ("collision", "visual")
    )
    given = {item.name for item in shapes}
    seen = [item for item in seen if item.name not in given]
    judged: list[str] = []
    for item in (*shapes, *seen):
        try:
            for points, radius, corners in item.solids():
                if item.element.tag == "visual":
                    if any(b.link == item.link and _holds(b, points, radius) for b in found):
                        continue
                    judged.append(item.name)
                count[item.name] += 1
                name = f"{item.name} {count[item.name]}"
                found.append(body.Body(name=name, link=item.link, points=points, radius=radius))
                held.append(corners)
        except MissingExtraError:
            unread.append(item.name)
        except _NoMesh as error:
            lost.append((item.name, error.what))
        except RobotError as error:
            notes.append(f"{item.where} is not judged: {error.what}")
    if lost:
        # Mostly for one reason: where the first was looked for says enough.
        named = ", ".join(dict.fromkeys(name for name, _ in lost))
        notes.append(f"meshes of {named} are not judged: {lost[0][1]}")
    if unread:
        named = ", ".join(dict.fromkeys(unread))
        notes.append(f"meshes of {named} are not judged: pip install 'dynid[collision]' reads them")
    known = robot.notes
    if judged:
        named = ", ".join(dict.fromkeys(judged))
        known = (*known, f"no collision geometry, judged by visual geometry: {named}")
    bodies = _tightened(robot, found, held)
    return replace(robot, bodies=bodies, body_notes=(*robot.body_notes, *notes), notes=known)


def _tightened(
    robot: model.RobotModel, bodies: list[body.Body], held: list[Array]
) -> tuple[body.Body, ...]:
    """The bodies; those that others are close to reach less far beyond the corners held (P, 3).

    What is 5 mm apart, as a shoulder and the upper arm that turns on it, has no room for the
    inflation of both.
    """
    if not any(len(corners) for corners in held):
        return tuple(bodies)
    limits = robot.limits
    lower = np.fmax(limits.lower, -np.pi)
    upper = np.fmax(np.fmin(limits.upper, np.pi), lower)
    q = np.random.default_rng(0).uniform(lower, upper, (_POSES, robot.joints))
    for k in body.close_bodies(bodies, kinematics.joint_poses(robot, q)):
        if len(held[k]):
            points, radius = body.around_points(
                held[k], corners=body.TIGHTER * body.CORNERS, within=body.WITHIN / body.TIGHTER
            )
            bodies[k] = replace(bodies[k], points=points, radius=radius)
    return tuple(bodies)


def _holds(shape: body.Body, points: Array, radius: float) -> bool:
    return float(body.beyond(points, shape.points).max()) + radius <= shape.radius + _ROUNDING


def urdf_shapes(
    robot: model.RobotModel, path: Path, kind: str, *, mesh_dirs: Sequence[Path] = ()
) -> Iterator[UrdfShape]:
    """The elements `collision` or `visual` of a robot's URDF that have a geometry.

    Args:
        robot: The robot.
        path: Its URDF.
        kind: The name of the elements.
        mesh_dirs: Further folders where meshes are looked for.

    Raises:
        RobotError: The file is not the robot's.
    """
    links = {link.name: link for link in urdf.urdf_links(robot, path)}
    for link in parse_root(read_limited(path, urdf.MAX_BYTES), shown_path(path)).iterfind("link"):
        name = (link.get("name") or "").strip()
        for k, element in enumerate(link.iterfind(kind), start=1):
            geometry = element.find("geometry")
            if geometry is not None and len(geometry):
                yield UrdfShape(
                    name=printable(name, 40),
                    link=links[name].joint,
                    frame=links[name].frame,
                    element=element,
                    shape=geometry[0],
                    where=f"link {printable(name, 40)}: {kind} {k}",
                    folders=(path.parent, *mesh_dirs),
                )


def _size(value: float, where: str) -> float:
    if not (math.isfinite(value) and value > 0):
        raise RobotError("its size is not positive", where=where, value=value)
    return value


_ROUNDING = 1e-6
"""[m]"""
_EXACT = np.empty((0, 3))
_POSES = 40
"""At which it is seen what is close to what."""
_SEARCHED = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH")
_NAMED = 8
"""Places named where a mesh was not found."""


def _mesh_places(name: str, folders: Sequence[Path]) -> list[Path]:
    """Where a mesh may be: as ROS 2 and ROS find packages, in the folders given, by the file."""
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
