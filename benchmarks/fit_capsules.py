"""Fit capsules around link meshes, as they stand in the built-in robot files.

    python benchmarks/fit_capsules.py ur5 [--margin 0.001]

Every triangle of a link's mesh ends up within one capsule (a capsule is convex, so its
corners are enough), at the smallest total volume that a few dozen starts find. Prints the
[[capsule]] tables. The meshes are those of the package example-robot-data.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize
from scipy.spatial import ConvexHull

DATA = Path(sys.prefix) / (
    f"lib/python3.{sys.version_info.minor}/site-packages/"
    "cmeel.prefix/share/example-robot-data/robots"
)
LINKS = ("base", "shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
COUNTS = (2, 3, 7, 7, 3, 3, 2)
EDGE = 0.02


def triangles(name: str) -> list[np.ndarray]:
    """(T, 3, 3) for each link, in ROS's link frames."""
    urdf = str(DATA / f"ur_description/urdf/{name}_robot.urdf")
    model = pin.buildModelFromUrdf(urdf)
    geometry = pin.buildGeomFromUrdf(
        model, urdf, pin.GeometryType.COLLISION, package_dirs=[str(DATA.parent.parent)]
    )
    found: list[np.ndarray] = [np.empty((0, 3, 3))] * len(LINKS)
    for item in geometry.geometryObjects:
        shape = item.geometry
        if not hasattr(shape, "num_tris"):
            continue
        corners = np.asarray(shape.vertices())
        rows = [shape.tri_indices(k) for k in range(shape.num_tris)]
        faces = np.array([[row[0], row[1], row[2]] for row in rows])
        placed = corners @ item.placement.rotation.T + item.placement.translation
        found[item.parentJoint] = np.concatenate([found[item.parentJoint], placed[faces]])
    return found


def split(faces: np.ndarray) -> np.ndarray:
    """The same surface with no edge longer than EDGE."""
    done = []
    while len(faces):
        edges = np.linalg.norm(faces - np.roll(faces, -1, axis=1), axis=2)
        long = edges.max(axis=1) > EDGE
        done.append(faces[~long])
        faces, edges = faces[long], edges[long]
        halves = []
        for face, k in zip(faces, edges.argmax(axis=1), strict=True):
            a, b, c = np.roll(face, -k, axis=0)
            middle = (a + b) / 2
            halves += [[a, middle, c], [middle, b, c]]
        faces = np.array(halves).reshape(-1, 3, 3)
    return np.concatenate(done)


def to_segment(points: np.ndarray, ends: np.ndarray) -> np.ndarray:
    a, b = ends[:3], ends[3:]
    way = b - a
    t = np.clip((points - a) @ way / max(way @ way, 1e-12), 0, 1)
    return np.linalg.norm(points - a - t[:, None] * way, axis=1)


def volume(ends: np.ndarray, radius: float) -> float:
    length = np.linalg.norm(ends[3:] - ends[:3])
    return np.pi * radius**2 * (length + 4 / 3 * radius)


def capsule(points: np.ndarray, start: np.ndarray | None) -> tuple[np.ndarray, float]:
    """The smallest capsule around points."""
    if len(points) > 60:
        points = points[ConvexHull(points, qhull_options="QJ").vertices]
    centre = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - centre, full_matrices=False)
    along = (points - centre) @ axes.T
    starts = [] if start is None else [start]
    if start is None:
        for k in range(3):
            low, high = along[:, k].min(), along[:, k].max()
            r = np.delete(np.abs(along), k, axis=1).max()
            low, high = min(low + r, 0), max(high - r, 0)
            starts.append(np.concatenate([centre + low * axes[k], centre + high * axes[k]]))
    best: tuple[float, np.ndarray] | None = None
    for ends in starts:
        found = minimize(
            lambda x: 1e3 * volume(x, to_segment(points, x).max()),
            ends,
            method="Nelder-Mead",
            options={"maxiter": 300 if start is not None else 700, "xatol": 1e-5, "fatol": 1e-6},
        )
        if best is None or found.fun < best[0]:
            best = (float(found.fun), found.x)
    assert best is not None
    return best[1], float(to_segment(points, best[1]).max())


def fit(faces: np.ndarray, count: int, starts: int, seed: int) -> list[tuple[np.ndarray, float]]:
    """Capsules that hold every triangle: Lloyd's way, by how much a capsule must grow."""
    random = np.random.default_rng(seed)
    centres = faces.mean(axis=1)
    best: tuple[float, list[tuple[np.ndarray, float]]] | None = None
    for _ in range(starts if count > 1 else 1):
        picks = centres[random.choice(len(centres), count, replace=False)]
        owner = np.linalg.norm(centres[:, None] - picks, axis=2).argmin(axis=1)
        shapes: list[tuple[np.ndarray, float]] = []
        for turn in range(7):
            if any((owner == k).sum() < 4 for k in range(count)):
                shapes = []
                break
            shapes = [
                capsule(faces[owner == k].reshape(-1, 3), shapes[k][0] if turn else None)
                for k in range(count)
            ]
            # A triangle goes to the capsule that holds it most deeply.
            out = np.stack(
                [
                    to_segment(faces.reshape(-1, 3), ends).reshape(-1, 3).max(axis=1) - radius
                    for ends, radius in shapes
                ]
            )
            new = out.argmin(axis=0)
            if (new == owner).all():
                break
            owner = new
        if not shapes or any((owner == k).sum() < 4 for k in range(count)):
            continue
        shapes = [capsule(faces[owner == k].reshape(-1, 3), shapes[k][0]) for k in range(count)]
        total = sum(volume(*shape) for shape in shapes)
        if best is None or total < best[0]:
            best = (total, shapes)
    assert best is not None
    return best[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robot")
    parser.add_argument("--margin", type=float, default=0.001, help="wider than the mesh [m]")
    parser.add_argument("--starts", type=int, default=12)
    given = parser.parse_args()
    for k, (faces, count) in enumerate(zip(triangles(given.robot), COUNTS, strict=True)):
        shapes = fit(split(faces), count, given.starts, k)
        for j, (ends, radius) in enumerate(shapes):
            # Rounded to 0.1 mm; the radius pays for it.
            points = np.round(ends, 4)
            if k == 0:
                points *= np.array([-1, -1, 1, -1, -1, 1.0])  # base_link to UR's base
            radius = np.ceil((radius + given.margin + 1e-4) * 1e4) / 1e4
            name = LINKS[k] if k == 0 else f"{LINKS[k]}_joint"
            print("[[capsule]]")
            print(f'name = "{LINKS[k]} {j + 1}"\nlink = "{name}"')
            if k:
                print('frames = "urdf"')
            print(f"start = {(points[:3] + 0.0).tolist()}\nend = {(points[3:] + 0.0).tolist()}")
            print(f"radius = {radius:.4f}\n", flush=True)


if __name__ == "__main__":
    main()
