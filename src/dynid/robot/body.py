"""Collision bodies: convex, fixed in links; and bodies around meshes.

A mesh is cut by planes where its parts' hulls take clearly less room than the hull of the
whole; each part becomes the hull of a few points, inflated by a radius. A body is convex, so it
holds every triangle whose corners it holds.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, combinations
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, Indices, RobotError, Value, frozen, printable, require, scipy_part

MOST_POINTS = 200
_TURNS, _RINGS = 16, 9
"""Points around a sphere, and from pole to pole, where a surface is drawn."""
SIDES = 24
"""Of the prism that holds a cylinder: it reaches beyond it by 0.9 % of its radius."""
CORNERS = 32
"""Most points of a body."""
WITHIN = 0.002
"""A body that reaches no farther beyond what it holds is good enough [m]."""
CLOSE = 0.01
"""Bodies of which the other is mostly nearer than this are made tighter [m]."""
TIGHTER = 4
"""How many times the corners of others, and what part of their reach, such bodies have."""
PARTS = 3
"""Bodies of a mesh."""
WORTH = 0.92
"""Volume that one more body must leave at most, over that before."""
_CUTS = 16
"""Planes across each axis, less one."""
_DIRECTIONS = 128
"""Directions whose farthest points approximate the hull of a part."""
_TOGETHER = 20_000
"""Points of one matrix product."""
_WIDER = 1e-4
"""Added to the radius for the rounding of points to 0.1 mm and for that of the proof [m]."""
_MOST_TRIANGLES = 200_000
_LARGEST_MESH = 64 << 20
"""Bytes of a file."""
_UNIT = re.compile(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']*)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Body(Value):
    """All points within a radius of the hull of some points.

    One point is a sphere, two a capsule, eight a box with rounded edges.

    Raises:
        RobotError: A negative link, no points or too many, a radius that is negative or not
            finite, or one point or two without a radius.
        InputError: Points that are not finite.
    """

    name: str
    link: int
    """0 for the base, i for the link that joint i moves."""
    points: Array
    """(K, 3) in the joint frame of the link [m]."""
    radius: float
    """[m]"""

    def __post_init__(self) -> None:
        rows = np.asarray(self.points, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != 3 or not 1 <= len(rows) <= MOST_POINTS:
            raise RobotError(
                "a body is given by points of three numbers",
                where=self.name,
                value=rows.shape,
                limit=f"1 to {MOST_POINTS} points",
            )
        object.__setattr__(self, "points", frozen(rows, shape=rows.shape, name="body points"))
        if self.link < 0:
            raise RobotError("a body's link counts from 0, the base", value=self.link)
        if not math.isfinite(self.radius) or self.radius < 0 or (len(rows) < 3 and not self.radius):
            raise RobotError("a body needs a positive radius", where=self.name, value=self.radius)

    def surface(self) -> tuple[Array, Indices]:
        """Its surface as triangles: vertices (V, 3) and outward faces (F, 3).

        The triangles are just within the rounded surface.
        """
        heights = np.repeat(np.linspace(0.0, np.pi, _RINGS)[1:-1], _TURNS)
        turns = np.tile(2 * np.pi * np.arange(_TURNS) / _TURNS, _RINGS - 2)
        wide = np.sin(heights)
        rings = np.column_stack([wide * np.cos(turns), wide * np.sin(turns), np.cos(heights)])
        ball = np.concatenate([rings, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
        points = (self.points[:, None] + self.radius * ball).reshape(-1, 3)
        points, faces = hull_faces(points)
        used, renumbered = np.unique(faces, return_inverse=True)
        return points[used], renumbered.reshape(faces.shape).astype(np.intp)


def box_points(half: Array) -> Array:
    """(8, 3) corners of a box with half sides (3) [m]."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return signs * half


def cylinder_points(radius: float, half: float) -> Array:
    """(2 * `SIDES`, 3) corners of a prism around a cylinder of half length `half` along z [m]."""
    turns = 2 * np.pi * np.arange(SIDES) / SIDES
    wide = radius / math.cos(math.pi / SIDES)
    rim = np.column_stack([wide * np.cos(turns), wide * np.sin(turns), np.full(SIDES, half)])
    return np.concatenate([rim, rim * [1, 1, -1]])


def read_mesh(file: Path, scale: Array) -> Array:
    """(T, 3, 3) the triangles of a mesh file (STL, Collada, OBJ and what else coal reads) [m].

    The corners are multiplied by the scale (3). Of a mesh of several materials it is the hull.

    Raises:
        MissingExtraError: The extra `collision` is not installed.
        RobotError: The file is no mesh, or too large.
    """
    coal: Any = require("coal", "collision")
    if file.stat().st_size > _LARGEST_MESH:
        raise RobotError(f"the mesh {printable(file.name)} is too large")
    try:
        mesh = coal.MeshLoader().load(str(file), scale * _unit_of(file))
        corners = np.asarray(mesh.vertices(), dtype=np.float64).reshape(-1, 3)
        rows = [[row[0], row[1], row[2]] for row in map(mesh.tri_indices, range(mesh.num_tris))]
    except (RuntimeError, ValueError) as error:
        raise RobotError(
            f"the mesh {printable(file.name)} cannot be read", value=printable(str(error), 60)
        ) from error
    if not rows or len(rows) > _MOST_TRIANGLES or not np.isfinite(corners).all():
        raise RobotError(
            f"the mesh {printable(file.name)} has no triangles, too many, or corners that are not"
            " finite",
            value=len(rows),
            limit=f"1 to {_MOST_TRIANGLES}",
        )
    faces = np.array(rows)
    if len(np.unique(faces)) < len(corners):
        # coal gives the parts of several materials the corners of the first: which belong together
        # is not known.
        corners, faces = hull_faces(corners)
    return corners[faces]


def _unit_of(file: Path) -> float:
    """The unit of a mesh [m]: that of a Collada file, which its loader does not look at; else 1."""
    if file.suffix.lower() != ".dae":
        return 1.0
    found = _UNIT.search(file.read_bytes().partition(b"</asset>")[0])
    unit = float(found[1]) if found else 1.0
    if not (math.isfinite(unit) and unit > 0):
        raise RobotError(f"the unit of the mesh {printable(file.name)}", value=unit)
    return unit


def around_triangles(faces: Array) -> list[tuple[Array, float, Array]]:
    """Up to `PARTS` bodies that hold every triangle (T, 3, 3).

    Returns:
        Points (K, 3) and radius [m] of each, and the corners (P, 3) of the part that it holds.
    """
    parts = [part.reshape(-1, 3) for part in parts_of(faces)]
    return [(*around_points(part), part) for part in parts]


def close_bodies(bodies: Sequence[Body], poses: Array) -> set[int]:
    """Numbers of bodies that one of another link is close to at most poses of the joints.

    Args:
        bodies: Convex bodies; those of one link and of neighbouring ones may be near each other.
        poses: (N, n, 4, 4) the joint frames [m].

    Raises:
        MissingExtraError: The extra `collision` is not installed.
    """
    coal: Any = require("coal", "collision")
    hulls: list[Any] = []
    for body in bodies:
        points = coal.StdVec_Vec3s()
        points.extend(body.surface()[0])
        hulls.append(coal.Convex.convexHull(points, False, ""))
    frames = [[coal.Transform3s(), *(coal.Transform3s(a[:3, :3], a[:3, 3]) for a in pose)]
              for pose in poses]  # fmt: skip
    ask, answer = coal.DistanceRequest(), coal.DistanceResult()
    found: set[int] = set()
    for (a, one), (b, other) in combinations(enumerate(bodies), 2):
        if abs(one.link - other.link) > 1:
            far: list[float] = []
            for pose in frames:
                answer.clear()
                where = pose[one.link], pose[other.link]
                far.append(coal.distance(hulls[a], where[0], hulls[b], where[1], ask, answer))
            if np.median(far) < CLOSE:
                found |= {a, b}
    return found


def parts_of(faces: Array, worth: float = WORTH) -> list[Array]:
    """The triangles (T, 3, 3) in up to `PARTS` parts whose hulls take little room together.

    One more part must leave at most the share `worth` of the volume before.
    """
    points, index = np.unique(faces.reshape(-1, 3), axis=0, return_inverse=True)
    parts = [index.reshape(-1, 3)]
    while len(parts) < PARTS:
        volumes = [_volume(_farthest(points[np.unique(part)])) for part in parts]
        options = [
            (room - whole, k, axis, at)
            for k, (part, whole) in enumerate(zip(parts, volumes, strict=True))
            for room, axis, at in _cuts(points, part)
        ]
        if not options:
            break
        gain, k, axis, at = min(options)
        if -gain < (1 - worth) * sum(volumes):
            break
        low = points[parts[k]].mean(axis=1)[:, axis] < at
        parts[k : k + 1] = [parts[k][low], parts[k][~low]]
    return [points[part] for part in parts]


def _cuts(points: Array, corners: Indices) -> list[tuple[float, int, float]]:
    """Volume of both hulls for each plane, the axis across it, and where it stands.

    Triangles have three of the points (P, 3) as corners (T, 3).
    """
    faces = points[corners]
    middles: Array = faces.mean(axis=1)
    found: list[tuple[float, int, float]] = []
    for axis in range(3):
        low, high = float(faces[..., axis].min()), float(faces[..., axis].max())
        planes = np.linspace(low, high, _CUTS + 1)[1:-1]
        slabs = np.searchsorted(planes, middles[:, axis], side="right")
        kept = np.unique(slabs).tolist()
        parts = [_farthest(points[np.unique(corners[slabs == k])]) for k in kept]
        below = list(accumulate(parts, _farthest_of_both))
        above = list(accumulate(parts[::-1], _farthest_of_both))[::-1]
        for k, one, other in zip(kept[1:], below, above[1:], strict=False):
            found.append((_volume(one) + _volume(other), axis, float(planes[k - 1])))
    return found


@cache
def _directions() -> Array:
    """(D, 3) directions spread evenly over a sphere."""
    height = 1 - (2 * np.arange(_DIRECTIONS) + 1) / _DIRECTIONS
    turn = np.pi * (1 + math.sqrt(5)) * np.arange(_DIRECTIONS)
    width = np.sqrt(1 - np.square(height))
    return np.column_stack([width * np.cos(turn), width * np.sin(turn), height])


def _farthest(points: Array) -> Array:
    """The points (P, 3) that are farthest in some direction: their hull is nearly that of all."""
    towards, count = _directions(), 1 + len(points) // _TOGETHER
    parts = [part[(towards @ part.T).argmax(axis=1)] for part in np.array_split(points, count)]
    return parts[0] if count == 1 else _farthest(np.concatenate(parts))


def _farthest_of_both(one: Array, other: Array) -> Array:
    return _farthest(np.concatenate([one, other]))


def _hull(points: Array) -> Any:
    """The hull; of flat points that of their neighbourhood."""
    spatial = scipy_part("spatial")
    size = float(np.ptp(points, axis=0).max())
    if np.linalg.matrix_rank(points - points[0], tol=1e-6 * size) < 3:
        points = np.concatenate([points, points + 1e-5 * np.eye(3)[:, None]], axis=None)
    points = points.reshape(-1, 3)
    try:
        return spatial.ConvexHull(points)
    except spatial.QhullError:
        return spatial.ConvexHull(points, qhull_options="QJ")


def hull_faces(points: Array) -> tuple[Array, Indices]:
    """Vertices (V, 3) of the hull of points (P, 3), and its outward faces (F, 3)."""
    hull = _hull(points)
    points, faces = hull.points, hull.simplices
    first, second, third = points[faces].transpose(1, 0, 2)
    turned = np.cross(second - first, third - first)
    inward = np.einsum("fx,fx->f", turned, hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return points, faces


def _volume(points: Array) -> float:
    points = np.unique(points, axis=0)
    size = np.ptp(points, axis=0)
    return float(_hull(points).volume) if len(points) > 3 else float(size.prod())


def around_points(
    points: Array, *, corners: int = CORNERS, within: float = WITHIN
) -> tuple[Array, float]:
    """A hull of few of the points (P, 3), and the radius by which it is inflated to hold all [m].

    It reaches beyond the hull of the points by no more than the radius. The point that is farthest
    outside is taken next, up to so many corners, until the radius is `within`.
    """
    points = points[np.unique(_hull(points).vertices % len(points))]
    outer = np.unique(np.round(points, 4), axis=0)
    chosen = list(dict.fromkeys([*outer.argmin(axis=0).tolist(), *outer.argmax(axis=0).tolist()]))
    while len(chosen) < min(corners, len(outer)):
        planes = _hull(outer[chosen]).equations
        outside = (outer @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        outside[chosen] = -np.inf
        if len(chosen) > 3 and outside.max() <= within:
            break
        chosen.append(int(outside.argmax()))
    body = outer[chosen]
    return body, float(np.ceil(1e4 * (beyond(points, body).max() + _WIDER)) / 1e4)


def beyond(points: Array, corners: Array) -> Array:
    """(P) how far points are from the hull of corners, at most [m].

    A convex combination of the corners that is that near proves each number.
    """
    solve = scipy_part("optimize").nnls
    weight = 100.0
    table = np.vstack([corners.T, np.full(len(corners), weight)])
    found = [solve(table, np.append(point, weight))[0] for point in points]
    shares: Array = np.array(found, dtype=np.float64)
    shares /= shares.sum(axis=1, keepdims=True)
    return np.linalg.norm(shares @ corners - points, axis=1)
