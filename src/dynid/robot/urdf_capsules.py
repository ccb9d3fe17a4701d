"""Capsules from the collision geometry of a URDF, for robots that have none of their own.

Boxes, cylinders and spheres become the smallest capsules around them, along their longest
side. Meshes need the extra `collision` (coal reads them): each becomes the capsule around its
box of principal axes, wide but safe.
"""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import MissingExtraError
from dynid.core.optional import require
from dynid.robot.capsule import Capsule
from dynid.robot.files import located, read_limited, shown, shown_path
from dynid.robot.model import RobotModel
from dynid.robot.urdf import MAX_BYTES, place_links
from dynid.robot.urdf_numbers import read_number, read_origin, read_vector
from dynid.robot.urdf_trunk import find_trunk
from dynid.robot.urdf_xml import parse_root, parse_urdf

Ends = tuple[Array, Array, float]
"""Start (3), end (3) and radius [m]."""


def with_collision_geometry(robot: RobotModel, path: str | Path) -> RobotModel:
    """The robot with capsules around the `collision` elements of its URDF.

    Args:
        robot: What `load_urdf` gave; a robot with capsules is returned as it is.
        path: The URDF file.

    Returns:
        The robot, with a note for every mesh that was left out.

    Raises:
        RobotError: The file is not the robot's, or a collision element is broken.
    """
    if robot.capsules:
        return robot
    file = Path(path)
    where = shown_path(file)
    data = read_limited(file, MAX_BYTES)
    tree = parse_urdf(data, where)
    trunk = find_trunk(tree, where, locked=dict(robot.locked))
    poses, carriers = place_links(tree, trunk)
    found: list[Capsule] = []
    notes: list[str] = []
    for link in parse_root(data, where).iterfind("link"):
        name = (link.get("name") or "").strip()
        for k, element in enumerate(link.iterfind("collision")):
            at = f"{where}: link {shown(name)}: collision {k + 1}"
            with located(at):
                shape = _shape(element, at, file.parent, notes)
                if shape is None:
                    continue
                placed = poses[name] @ read_origin(element, at)
                start, end, radius = shape
                found.append(
                    Capsule(
                        name=f"{shown(name, 40)} {k + 1}",
                        link=carriers[name],
                        start=placed[:3, :3] @ start + placed[:3, 3],
                        end=placed[:3, :3] @ end + placed[:3, 3],
                        radius=radius,
                    )
                )
    return replace(robot, capsules=tuple(found), notes=(*robot.notes, *notes))


def _shape(element: ET.Element, where: str, folder: Path, notes: list[str]) -> Ends | None:
    geometry = element.find("geometry")
    if geometry is None or len(geometry) == 0:
        return None
    shape = geometry[0]
    zero = np.zeros(3)
    if shape.tag == "sphere":
        return zero, zero, read_number(shape, "radius", where)
    if shape.tag == "cylinder":
        radius, length = (read_number(shape, key, where) for key in ("radius", "length"))
        return _around(np.zeros(3), np.array([radius, radius, length / 2]), np.eye(3), True)
    if shape.tag == "box":
        return _around(np.zeros(3), np.array(read_vector(shape, "size", where)) / 2, np.eye(3))
    if shape.tag == "mesh":
        return _mesh(shape, where, folder, notes)
    notes.append(f"{where}: no capsule for a {shown(shape.tag, 40)}")
    return None


def _around(centre: Array, half: Array, axes: Array, round_: bool = False) -> Ends:
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


def _mesh(shape: ET.Element, where: str, folder: Path, notes: list[str]) -> Ends | None:
    name = (shape.get("filename") or "").strip()
    file = _found(name, folder)
    if file is None:
        notes.append(f"{where}: the mesh {shown(name)} was not found; no capsule for it")
        return None
    try:
        coal: Any = require("coal", "collision")
    except MissingExtraError:
        notes.append(f"{where}: a mesh needs the extra dynid[collision]; no capsule for it")
        return None
    scale = np.array(read_vector(shape, "scale", where)) if shape.get("scale") else np.ones(3)
    try:
        mesh = coal.MeshLoader().load(str(file), scale)
    except (RuntimeError, ValueError) as error:
        notes.append(f"{where}: the mesh {shown(name)} cannot be read ({shown(error, 60)})")
        return None
    corners = np.asarray(mesh.vertices(), dtype=np.float64).reshape(-1, 3)
    return _around_points(corners)


def _around_points(corners: Array) -> Ends:
    middle = corners.mean(axis=0)
    _, _, axes = np.linalg.svd(corners - middle, full_matrices=False)
    along = (corners - middle) @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    start, end, radius = _around(middle + (low + high) / 2 @ axes, (high - low) / 2, axes)
    way = end - start
    t = np.clip((corners - start) @ way / max(float(way @ way), 1e-18), 0.0, 1.0)
    needed = float(np.linalg.norm(corners - start - t[:, None] * way, axis=1).max())
    return start, end, min(radius, needed * (1 + 1e-12))


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
