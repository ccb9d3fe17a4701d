"""Capsules around the collision geometry of a URDF."""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, MissingExtraError, RobotError, require
from dynid.robot.model import Capsule, RobotModel
from dynid.robot.tables import read_limited, shown, shown_path
from dynid.robot.urdf import MAX_BYTES, find_trunk, place_links
from dynid.robot.urdf_xml import parse_root, parse_urdf, read_number, read_origin, read_vector

Ends = tuple[Array, Array, float]
"""Start (3), end (3) and radius [m]."""

_DEPTH = 3
"""How often a mesh is halved."""
_WORTH = 0.85
"""Volume that two halves may have, over that of the whole."""
_ENDS = np.linspace(0.0, 1.0, 9)
"""How far apart a capsule's ends may be, over the length of what it holds."""
_STEPS = 12
"""Triangles are cut until no edge is longer than this share of the mesh's size."""
_MOST_TRIANGLES = 200_000


def read_mesh(file: Path, scale: Array) -> Array:
    """(T, 3, 3) the triangles of a mesh file [m].

    Args:
        file: STL, Collada, OBJ and what else coal reads.
        scale: (3) factors.

    Raises:
        MissingExtraError: The extra `collision` is not installed.
        RobotError: The file is no mesh.
    """
    coal: Any = require("coal", "collision")
    try:
        mesh = coal.MeshLoader().load(str(file), scale)
        corners = np.asarray(mesh.vertices(), dtype=np.float64).reshape(-1, 3)
        rows = [mesh.tri_indices(k) for k in range(mesh.num_tris)]
    except (RuntimeError, ValueError) as error:
        raise RobotError(
            f"the mesh {shown(file.name)} cannot be read", value=shown(str(error), 60)
        ) from error
    if not rows or len(rows) > _MOST_TRIANGLES or not np.isfinite(corners).all():
        raise RobotError(
            f"the mesh {shown(file.name)} has no triangles, too many, or corners that are not"
            " finite",
            value=len(rows),
            limit=f"1 to {_MOST_TRIANGLES}",
        )
    return corners[np.array([[row[0], row[1], row[2]] for row in rows])]


def around_triangles(faces: Array) -> list[Ends]:
    """Up to eight capsules that hold every triangle.

    Args:
        faces: (T, 3, 3) corners [m].
    """
    size = float(np.ptp(faces.reshape(-1, 3), axis=0).max())
    return _best(_cut(faces, size / _STEPS), _DEPTH)


def _best(faces: Array, depth: int) -> list[Ends]:
    whole = [_around_points(_distinct(faces.reshape(-1, 3)))]
    middles = faces.mean(axis=1)
    sides = np.ptp(middles, axis=0)
    longest = int(np.argmax(sides))
    low = middles[:, longest] < middles[:, longest].min() + sides[longest] / 2
    if depth == 0 or low.all() or not low.any():
        return whole
    halves = [item for part in (faces[low], faces[~low]) for item in _best(part, depth - 1)]
    return halves if _volume(halves) < _WORTH * _volume(whole) else whole


def _distinct(points: Array) -> Array:
    """The rows (P, 3), sorted and each once: `numpy.unique`, sooner."""
    ordered = points[np.lexsort(points.T[::-1])]
    return ordered[np.r_[True, (ordered[1:] != ordered[:-1]).any(axis=1)]]


def around_box(centre: Array, half: Array, axes: Array, round_: bool = False) -> Ends:
    """The capsule around a box of half sides (3) along the rows of `axes`, or a cylinder."""
    longest = 2 if round_ else int(np.argmax(half))
    across = np.delete(half, longest)
    radius = float(across[0]) if round_ else float(np.linalg.norm(across))
    # Widened by w the ends may move in: the rim (radius, half) is still within.
    best, wide, reach = math.inf, radius, float(half[longest])
    for share in np.linspace(1.0, 1.6, 25):
        r = share * radius
        inset = math.sqrt(r * r - radius * radius)
        length = max(float(half[longest]) - inset, 0.0)
        r = max(r, math.hypot(radius, float(half[longest]) - length))
        volume = r * r * (2 * length + 4 / 3 * r)
        if volume < best:
            best, wide, reach = volume, r, length
    return centre - reach * axes[longest], centre + reach * axes[longest], wide * (1 + 1e-12)


def _around_points(points: Array) -> Ends:
    """The smallest of the capsules (P, 3) along a principal axis through the middle."""
    # Of the covariance: three axes even of fewer than three points.
    off = points - points.mean(axis=0)
    axes = np.linalg.eigh(off.T @ off)[1].T
    along = points @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    middle = (low + high) / 2 @ axes
    best: Ends | None = None
    for axis, half in zip(axes, (high - low) / 2, strict=True):
        height = np.abs((points - middle) @ axis)
        across = np.maximum(np.sum((points - middle) ** 2, axis=1) - height**2, 0.0)
        for reach in half * _ENDS:
            beyond = np.maximum(height - reach, 0.0)
            radius = math.sqrt(float((across + beyond**2).max())) * (1 + 1e-9) + 1e-9
            found = middle - reach * axis, middle + reach * axis, radius
            if best is None or _volume([found]) < _volume([best]):
                best = found
    if best is None:
        raise RobotError("a mesh without points")
    return best


def _volume(capsules: list[Ends]) -> float:
    return sum(
        radius**2 * (float(np.linalg.norm(end - start)) + 4 / 3 * radius)
        for start, end, radius in capsules
    )


def _cut(faces: Array, longest: float) -> Array:
    """The same surface with no edge longer than `longest`."""
    done: list[Array] = []
    while len(faces):
        edges = np.linalg.norm(faces - np.roll(faces, -1, axis=1), axis=2)
        long = edges.max(axis=1) > longest
        done.append(faces[~long])
        faces, edges = faces[long], edges[long]
        order = (edges.argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(faces, order[:, :, None], axis=1).transpose(1, 0, 2)
        middle = (a + b) / 2
        faces = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
    return np.concatenate(done)


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
