"""Collision bodies: convex, fixed in links; and bodies around meshes.

A mesh is cut by planes where its parts' hulls take clearly less room than the hull of the
whole; each part becomes the hull of a few points, inflated by a radius. A body is convex, so it
holds every triangle whose corners it holds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from dynid.core import Array, Indices, RobotError, frozen, require
from dynid.robot.tables import shown

MOST_POINTS = 200
_TURNS, _RINGS = 16, 9
"""Points around a sphere, and from pole to pole, where a surface is drawn."""
SIDES = 24
"""Of the prism that holds a cylinder: it reaches beyond it by 0.9 % of its radius."""
CORNERS = 16
"""Points of a body."""
PARTS = 3
"""Bodies of a mesh."""
WORTH = 0.92
"""Volume that one more body must leave, over that before."""
_CUTS = 16
"""Planes across each axis, less one."""
_SAMPLED = 2000
"""Triangles that decide where a mesh is cut."""
_EVEN = 800
_HARDER = 40.0
"""Weight of what is not held at the end of the descent, over that at its start."""
_STEPS = 700
_LEAST_RADIUS = 0.003
_WIDER = 1e-4
"""Added to the radius for the rounding of points to 0.1 mm and for that of the proof [m]."""
_MOST_TRIANGLES = 200_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
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

        The vertices lie on the rounded surface, so that the triangles are just within it.
        """
        heights = np.linspace(0.0, np.pi, _RINGS)
        turns = 2 * np.pi * np.arange(_TURNS) / _TURNS
        ball = np.array(
            [
                [np.sin(h) * np.cos(t), np.sin(h) * np.sin(t), np.cos(h)]
                for h in heights
                for t in turns
            ]
        )
        points = (self.points[:, None] + self.radius * ball).reshape(-1, 3)
        hull = ConvexHull(points, qhull_options="QJ")
        faces = hull.simplices
        first, second, third = points[faces].transpose(1, 0, 2)
        inward = np.einsum("fx,fx->f", np.cross(second - first, third - first),
                           hull.equations[:, :3]) < 0  # fmt: skip
        faces[inward] = faces[inward][:, ::-1]
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


def around_triangles(
    faces: Array, *, corners: int = CORNERS, steps: int = _STEPS
) -> list[tuple[Array, float]]:
    """Up to `PARTS` bodies, points (K, 3) and radius [m], that hold every triangle (T, 3, 3)."""
    return [
        around_points(part.reshape(-1, 3), corners=corners, steps=steps) for part in parts_of(faces)
    ]


def parts_of(faces: Array, worth: float = WORTH) -> list[Array]:
    """The triangles (T, 3, 3) in up to `PARTS` parts whose hulls take little room together.

    Args:
        faces: The triangles.
        worth: Volume that one more part must leave, over that before.
    """
    parts = [faces]
    while len(parts) < PARTS:
        options: list[tuple[float, int, int, float]] = []
        for k, part in enumerate(parts):
            options += [(room - _volume(part), k, axis, at) for room, axis, at in _cuts(part)]
        if not options:
            break
        gain, k, axis, at = min(options)
        if -gain < (1 - worth) * sum(_volume(part) for part in parts):
            break
        low = parts[k].mean(axis=1)[:, axis] < at
        parts[k : k + 1] = [parts[k][low], parts[k][~low]]
    return parts


def _cuts(faces: Array) -> list[tuple[float, int, float]]:
    """Volume of both hulls for each plane, the axis across it, and where it stands."""
    if len(faces) > _SAMPLED:
        faces = faces[np.random.default_rng(0).choice(len(faces), _SAMPLED, replace=False)]
    middles = faces.mean(axis=1)
    found: list[tuple[float, int, float]] = []
    for axis in range(3):
        low, high = float(faces[..., axis].min()), float(faces[..., axis].max())
        for at in np.linspace(low, high, _CUTS + 1)[1:-1].tolist():
            below = middles[:, axis] < at
            if below.any() and not below.all():
                found.append((_volume(faces[below]) + _volume(faces[~below]), axis, at))
    return found


def _hull(points: Array) -> ConvexHull:
    """The hull; of flat points that of their neighbourhood."""
    size = float(np.ptp(points, axis=0).max())
    if np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-6 * size) < 3:
        points = np.concatenate([points, points + 1e-5 * np.eye(3)[:, None]], axis=None)
    return ConvexHull(points.reshape(-1, 3), qhull_options="QJ")


def _volume(faces: Array) -> float:
    points = np.unique(faces.reshape(-1, 3), axis=0)
    size = np.ptp(points, axis=0)
    return float(_hull(points).volume) if len(points) > 3 else float(size.prod())


def around_points(
    points: Array, *, corners: int = CORNERS, steps: int = _STEPS, seed: int = 0
) -> tuple[Array, float]:
    """A hull of few points, and the radius by which it is inflated to hold the given ones.

    The mean excess of its support function over that of the points is made small by Adam
    (Kingma and Ba 2015), with what is missing weighted much heavier; the radius is then exact.

    Args:
        points: (P, 3) [m].
        corners: Number of points of the body.
        steps: Steps of the descent.
        seed: Of the first point chosen.
    """
    hull = _hull(points)
    directions, weights = _directions(hull)
    points = points[np.unique(hull.vertices % len(points))]
    reach = (points @ directions.T).max(axis=0)
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    radius = max(_LEAST_RADIUS, float(np.ptp(points, axis=0).min()) / 8)
    chosen = [int(np.random.default_rng(seed).integers(len(points)))]
    away = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < corners:
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    off = points[chosen] - middle
    off -= radius * off / np.maximum(np.linalg.norm(off, axis=1, keepdims=True), radius)
    x = np.append((middle + off).ravel(), radius)
    scale = float(np.ptp(points, axis=0).max())
    mean, square = np.zeros(len(x)), np.zeros(len(x))
    columns, even = np.arange(len(directions)), 1 / len(directions)
    for step in range(steps):
        harder = 1 + _HARDER * (step / steps) ** 2
        along = x[:-1].reshape(-1, 3) @ directions.T
        owner = along.argmax(axis=0)
        excess = (along[owner, columns] + x[-1] - reach) / (0.02 * scale)
        push = np.where(
            excess < 0, (weights + even) * harder * (-8.0 + 40.0 * excess), weights * (1.0 + excess)
        )
        held = np.zeros((corners, len(directions)))
        held[owner, columns] = push
        slope = np.append((held @ directions).ravel(), push.sum())
        mean, square = 0.9 * mean + 0.1 * slope, 0.99 * square + 0.01 * slope**2
        rate = 0.02 * scale * (1 - step / steps) ** 1.5
        x -= rate * mean / (np.sqrt(square) + 1e-4)
        x[-1] = max(x[-1], _LEAST_RADIUS)
    body = np.round(x[:-1].reshape(-1, 3), 4)
    return body, float(np.ceil(1e4 * (beyond(points, body).max() + _WIDER)) / 1e4)


def _directions(hull: ConvexHull) -> tuple[Array, Array]:
    """Unit vectors (U, 3) all over the sphere and across each face, and their weights (U).

    Half of the weight is spread evenly, half goes to the faces by their areas.
    """
    _, which = np.unique(np.round(hull.equations[:, :3], 1), axis=0, return_inverse=True)
    first, second, third = hull.points[hull.simplices].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    sums = np.array([np.bincount(which.ravel(), areas * hull.equations[:, k]) for k in range(3)]).T
    sizes = np.linalg.norm(sums, axis=1)
    kept = sizes > 1e-9
    directions = np.concatenate([_sphere(_EVEN), sums[kept] / sizes[kept, None]])
    weights = np.concatenate([np.full(_EVEN, 1 / _EVEN), sizes[kept] / sizes[kept].sum()]) / 2
    return directions, weights


def beyond(points: Array, corners: Array) -> Array:
    """(P) how far points are from the hull of corners, at most [m].

    A convex combination of the corners that is that near proves each number.
    """
    weight = 100.0
    table = np.vstack([corners.T, np.full(len(corners), weight)])
    shares = np.array([nnls(table, np.append(point, weight))[0] for point in points])
    shares /= shares.sum(axis=1, keepdims=True)
    return np.linalg.norm(shares @ corners - points, axis=1)


def _sphere(count: int) -> Array:
    """(count, 3) unit vectors spread over the sphere."""
    k = np.arange(count) + 0.5
    height, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - height**2)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
