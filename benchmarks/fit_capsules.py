"""Fit capsules around link meshes, as they stand in the built-in robot files.

    python benchmarks/fit_capsules.py ur5 [--margin 0.001]

Capsules may stick out of a link by an allowance (a few millimetres at the wrist). Candidates
run between points within the mesh, as thick as the allowance lets them be; a greedy cover
picks few of them so that every triangle of the mesh lies within one (a capsule is convex, so
the corners are enough). Prints the [[capsule]] tables. The meshes are those of the package
example-robot-data.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy import ndimage
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial import cKDTree

DATA = Path(sys.prefix) / (
    f"lib/python3.{sys.version_info.minor}/site-packages/"
    "cmeel.prefix/share/example-robot-data/robots"
)
LINKS = ("base", "shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
ALLOWANCE = (0.020, 0.020, 0.020, 0.017, 0.015, 0.015, 0.015)
"""How far capsules may stick out of each link of a UR5 [m]."""
SUNK = 0.06
"""How far capsules of the base may reach below it, into what it stands on [m]."""
SPACING = 0.003
CANDIDATES = 2500


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


def split(faces: np.ndarray, longest: float) -> np.ndarray:
    """The same surface with no edge longer than `longest`."""
    done = []
    while len(faces):
        edges = np.linalg.norm(faces - np.roll(faces, -1, axis=1), axis=2)
        long = edges.max(axis=1) > longest
        done.append(faces[~long])
        faces, edges = faces[long], edges[long]
        halves = []
        for face, k in zip(faces, edges.argmax(axis=1), strict=True):
            a, b, c = np.roll(face, -k, axis=0)
            middle = (a + b) / 2
            halves += [[a, middle, c], [middle, b, c]]
        faces = np.array(halves).reshape(-1, 3, 3)
    return np.concatenate(done)


def depths(surface: cKDTree, grid: np.ndarray, spacing: float, sunk: bool) -> np.ndarray:
    """How deep grid points lie in the solid [m], negative outside.

    What cannot be reached from outside is solid, so the hollows of a mesh count as full.
    """
    wall = surface.query(grid.reshape(-1, 3))[0].reshape(grid.shape[:3]) < 0.8 * spacing
    rooms, _ = ndimage.label(~wall)
    outside = rooms == rooms[0, 0, -1]
    if sunk:
        # What stands below the mesh is solid too.
        first = int(np.argmax((~outside).any(axis=(0, 1)))) + 1
        outside[:, :, :first] = outside[:, :, first : first + 1]
    # Walls reach 0.8 beyond the surface.
    return np.where(outside, -spacing, (ndimage.distance_transform_edt(~outside) - 1.5) * spacing)


def distances(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """From points to the segment ab."""
    way = b - a
    t = np.clip((points - a) @ way / max(way @ way, 1e-12), 0, 1)
    return np.linalg.norm(points - a - t[:, None] * way, axis=1)


def fit(
    mesh: np.ndarray, allowance: float, sunk: float, rough: float
) -> list[tuple[np.ndarray, float]]:
    """Segments (2, 3) and radii that hold every triangle; they may be `sunk` below the mesh."""
    random = np.random.default_rng(0)
    fine = split(mesh, 0.003).reshape(-1, 3)
    surface = cKDTree(fine)
    # Long links get coarser steps.
    coarse = rough if np.ptp(mesh.reshape(-1, 3), axis=0).max() < 0.25 else 1.5 * rough
    spacing = SPACING * coarse
    faces = split(mesh, 0.012 * coarse)
    low, high = mesh.reshape(-1, 3).min(0) - 3 * spacing, mesh.reshape(-1, 3).max(0) + 3 * spacing
    low[2] -= sunk
    axes = [np.arange(x, y + spacing, spacing) for x, y in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    depth = depths(surface, grid, spacing, sunk > 0).reshape(-1)
    points = grid.reshape(-1, 3)
    field = RegularGridInterpolator(axes, depth.reshape(grid.shape[:3]), bounds_error=False,
                                    fill_value=-1.0)  # fmt: skip
    seeds = points[depth > 0.25 * spacing]
    corners = faces.reshape(-1, 3)
    middles = faces.mean(axis=1)
    area = np.linalg.norm(np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]), axis=1)
    chosen: list[tuple[np.ndarray, float]] = []
    open_ = np.ones(len(faces), dtype=bool)
    ends = seeds[random.integers(len(seeds), size=(int(CANDIDATES / rough), 2))]
    ends[::6, 1] = ends[::6, 0]
    steps = np.linspace(0, 1, 13)[:, None]

    def width(ends: np.ndarray) -> np.ndarray:
        way = ends[:, None, 0] + steps[None] * (ends[:, None, 1] - ends[:, None, 0])
        return field(way.reshape(-1, 3)).reshape(len(ends), -1).min(axis=1)

    def held(segment: np.ndarray, radius: float) -> np.ndarray:
        mask = np.zeros(len(faces), dtype=bool)
        at = np.flatnonzero(distances(middles, *segment) < radius)
        far = distances(faces[at].reshape(-1, 3), *segment).reshape(-1, 3).max(axis=1)
        mask[at[far <= radius - 2e-4]] = True
        return mask

    # Long flat sides first, with hardly any allowance; the corners that are left need more.
    whole = area.sum()
    for extra, least in ((0.003, 0.05), (allowance / 2, 0.04), (allowance, 0.0)):
        radii = width(ends) + extra
        rows = np.flatnonzero(radii > extra)
        table = np.array([held(ends[row], radii[row]) for row in rows])
        while open_.any():
            gain = table[:, open_] @ area[open_]
            best = int(np.argmax(gain))
            if gain[best] <= 0.5 * least * whole:
                break
            segment, radius = ends[rows[best]], radii[rows[best]]
            most, mask = gain[best], table[best]
            step = 0.012
            for _ in range(8):
                # Climb from the best candidate.
                near = segment + step * random.standard_normal((int(30 / rough), 2, 3))
                better = False
                for one, wide in zip(near, width(near) + extra, strict=True):
                    if wide > extra:
                        trial = held(one, wide)
                        worth = float(area[trial & open_].sum())
                        if worth > most:
                            segment, radius, most, mask, better = one, wide, worth, trial, True
                step *= 1.0 if better else 0.6
            if most <= least * whole:
                break
            chosen.append((segment, radius))
            open_ &= ~mask
    while open_.any():
        # What no candidate holds: a ball around what is left nearby.
        here = middles[np.flatnonzero(open_)[0]]
        near = open_ & (np.linalg.norm(middles - here, axis=1) < 0.015)
        centre = faces[near].reshape(-1, 3).mean(axis=0)
        radius = float(np.linalg.norm(faces[near].reshape(-1, 3) - centre, axis=1).max())
        chosen.append((np.array([centre, centre]), radius + 2e-4))
        open_ &= ~near
    # Every triangle to the capsule that holds it most deeply; each as thin as its own allow.
    out = np.stack(
        [distances(corners, *seg).reshape(-1, 3).max(axis=1) - radius for seg, radius in chosen]
    )
    owner = out.argmin(axis=0)
    return [
        (seg, float(distances(faces[owner == k].reshape(-1, 3), *seg).max()))
        for k, (seg, _) in enumerate(chosen)
        if (owner == k).any()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robot")
    parser.add_argument("--margin", type=float, default=0.001, help="wider than the mesh [m]")
    parser.add_argument("--scale", type=float, default=1.0, help="of the allowances")
    parser.add_argument("--rough", type=float, default=1.0, help="coarser steps")
    parser.add_argument("--links", type=int, nargs="*", default=range(7), help="0 the base")
    given = parser.parse_args()
    for k, (mesh, allowance) in enumerate(zip(triangles(given.robot), ALLOWANCE, strict=True)):
        if k not in given.links:
            continue
        shapes = fit(mesh, allowance * given.scale, 0.0 if k else SUNK, given.rough)
        print(f"{LINKS[k]}: {len(shapes)}", file=sys.stderr, flush=True)
        for j, (ends, radius) in enumerate(shapes):
            # Rounded to 0.1 mm; the radius pays for it.
            points = np.round(ends, 4)
            if k == 0:
                points = points * np.array([-1, -1, 1.0])  # base_link to UR's base
            width = np.ceil((radius + given.margin + 1e-4) * 1e4) / 1e4
            name = LINKS[k] if k == 0 else f"{LINKS[k]}_joint"
            print("[[capsule]]")
            print(f'name = "{LINKS[k]} {j + 1}"\nlink = "{name}"')
            if k:
                print('frames = "urdf"')
            a, b = ((np.round(point, 4) + 0.0).tolist() for point in points)
            print(f"start = {a}\nend = {b}\nradius = {width:.4f}\n", flush=True)


if __name__ == "__main__":
    main()
