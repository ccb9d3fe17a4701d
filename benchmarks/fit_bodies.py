"""Prove the collision bodies of the built-in arms on Universal Robots' meshes, or fit them.

    python benchmarks/fit_bodies.py [ur5 ...]           prove alone
    python benchmarks/fit_bodies.py [ur5 ...] --fit     fit, rewrite

A fit writes the [[body]] tables of `src/dynid/robot/library/*.toml`. Fitting and proving have
nothing in common but the meshes: the proof reads the robot as users do, and finds for every
triangle one body that holds its three corners (a convex combination of the body's points that is
within its radius of each); bodies are convex, so that they hold the triangle. Both write
`benchmarks/bodies.json`: triangles that no body holds, and the price, which is how far the outer
surface of a link's bodies is from its mesh.
"""

import json
import re
import tomllib
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from shared.measuring import DATA, ROOT, run

from dynid.robot import Body, RobotModel, load_robot
from dynid.robot.body import around_points, beyond, parts_of

MESHES = DATA / "ur_meshes"
LIBRARY = ROOT / "src/dynid/robot/library"
STORED = ROOT / "benchmarks/bodies.json"
ROBOTS = ("ur3", "ur5", "ur10", "ur3e", "ur5e", "ur10e", "ur16e")
LINKS = ("base", "shoulder", "upperarm", "forearm", "wrist1", "wrist2", "wrist3")
CORNERS, WITHIN, WORTH = 48, 0.001, 0.97
"""Most points of a body; the radius that is small enough [m]; see `parts_of`."""
SPACING = 0.002
SOURCE = (
    "convex bodies that hold every triangle of the collision meshes of"
    " UniversalRobots/Universal_Robots_ROS2_Description: benchmarks/fit_bodies.py"
)


def _number(text: str, key: str) -> float:
    found = re.search(rf"^\s*{key}:\s*(\S+)", text, re.MULTILINE)
    if found is None:
        raise KeyError(key)
    return float(found.group(1))


def _turn(axes: str, *angles: float) -> np.ndarray:
    return Rotation.from_euler(axes, angles).as_matrix().reshape(3, 3)


def link_meshes(robot: str) -> list[np.ndarray]:
    """(T, 3, 3) triangles of the base and of each link, in the frames of ROS 2's links [m].

    Where the meshes stand in them is a fact of `ur_macro.xacro`.
    """
    config = MESHES / "config" / robot
    visual = (config / "visual_parameters.yaml").read_text()
    physical = (config / "physical_parameters.yaml").read_text()
    offsets = [float(x) for x in re.findall(r"visual_offset:\s*(\S+)", visual)]
    back, lying, sideways = _turn("z", np.pi), _turn("x", np.pi / 2), _turn("z", -np.pi / 2)
    places = [
        (0.0, back),
        (0.0, back),
        (_number(physical, "shoulder_offset"), sideways @ lying),
        (_number(physical, "elbow_offset"), sideways @ lying),
        (offsets[0], lying),
        (offsets[1], np.eye(3)),
        (offsets[2], lying),
    ]
    row = np.dtype([("normal", "<f4", 3), ("corners", "<f4", 9), ("attribute", "<u2")])
    found = []
    for file, (height, turn) in zip(
        re.findall(r"path: (meshes/\S+\.stl)", visual), places, strict=True
    ):
        data = (MESHES / file).read_bytes()
        corners = np.frombuffer(data[84:], row)["corners"].reshape(-1, 3).astype(np.float64)
        found.append((corners @ turn.T + [0, 0, height]).reshape(-1, 3, 3))
    return found


def meshes_of(robot: RobotModel) -> list[np.ndarray]:
    """The same in the frames of the bodies: the base's, and the joint frames."""
    dh = robot.parameter_frames["dh"]
    found = link_meshes(robot.name)
    for k, (a, alpha) in enumerate(_dh_table(robot.name)):
        faces = (found[k + 1] - [a, 0, 0]) @ _turn("x", alpha)
        found[k + 1] = faces @ dh[k, :3, :3].T + dh[k, :3, 3]
    return found


def _dh_table(robot: str) -> list[tuple[float, float]]:
    table = tomllib.loads((LIBRARY / f"{robot}.toml").read_text())["dh"]
    return list(zip(table["a"], table["alpha"], strict=True))


def outside(faces: np.ndarray, bodies: list[Body]) -> int:
    """How many triangles (T, 3, 3) no body holds alone."""
    points, corner = np.unique(faces.reshape(-1, 3), axis=0, return_inverse=True)
    held = np.array([beyond(points, body.points) <= body.radius for body in bodies])
    return int((~held[:, corner.reshape(-1, 3)].all(axis=2).any(axis=0)).sum())


def price(faces: np.ndarray, bodies: list[Body]) -> np.ndarray:
    """Distances from points spread over the outer surface of bodies to a mesh [m]."""
    random = np.random.default_rng(0)
    surface = cKDTree(np.concatenate([_spread(faces, SPACING, random), faces.reshape(-1, 3)]))
    found = []
    for body in bodies:
        corners, rows = body.surface()
        points = _spread(corners[rows], 4 * SPACING, random)
        for other in bodies:
            if other is not body:
                points = points[beyond(points, other.points) > other.radius - 1e-4]
        found.append(surface.query(points)[0])
    return np.concatenate(found)


def _spread(faces: np.ndarray, spacing: float, random: np.random.Generator) -> np.ndarray:
    sides = faces[:, 1:] - faces[:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    count = int(area.sum() / spacing**2 * 2)
    rows = random.choice(len(faces), count, p=area / area.sum())
    shares = random.random((count, 2))
    over = shares.sum(axis=1) > 1
    shares[over] = 1 - shares[over]
    return faces[rows, 0] + np.einsum("kc,kcx->kx", shares, sides[rows])


def fitted(faces: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Points and radii of bodies around a mesh (T, 3, 3)."""
    return [
        around_points(part.reshape(-1, 3), corners=CORNERS, within=WITHIN)
        for part in parts_of(faces, WORTH)
    ]


def tables(robot: str) -> str:
    """The [[body]] tables of a robot's file."""
    lines: list[str] = []
    links = ("base", *load_robot(robot).joint_names)
    table = [(0.0, 0.0), *_dh_table(robot)]
    for k, (faces, (a, alpha)) in enumerate(zip(link_meshes(robot), table, strict=True)):
        placed = (faces - [a, 0, 0]) @ _turn("x", alpha)
        key = placed.tobytes()
        if key not in _FITTED:
            _FITTED[key] = robot, fitted(placed)
        owner, bodies = _FITTED[key]
        for number, (points, radius) in enumerate(bodies, start=1):
            source = [] if lines else [f'source = """{SOURCE}"""']
            lines += ["", "[[body]]", *source]
            lines += [f'name = "{LINKS[k]} {number}"', f'link = "{links[k]}"']
            lines += ['frames = "dh"'] if k else []
            if owner != robot:
                lines += [f'points = "{owner}"']
                continue
            lines += ["points = ["]
            written = [f"{(np.round(point, 4) + 0.0).tolist()}," for point in points]
            lines += ["    " + " ".join(written[k : k + 3]) for k in range(0, len(written), 3)]
            lines += ["]", f"radius = {radius:.4f}"]
    return "\n".join(lines) + "\n"


_FITTED: dict[bytes, tuple[str, list[tuple[np.ndarray, float]]]] = {}
"""The arm that a mesh was fitted for first, and its bodies: some arms share meshes."""


def check(robot: RobotModel) -> dict[str, Any]:
    """What is stored of one robot."""
    links: dict[str, Any] = {}
    every: list[np.ndarray] = []
    for k, faces in enumerate(meshes_of(robot)):
        bodies = [body for body in robot.bodies if body.link == k]
        found = price(faces, bodies)
        every.append(found)
        links[LINKS[k]] = {
            "triangles": len(faces),
            "outside": outside(faces, bodies),
            "bodies": len(bodies),
            "points": sum(len(body.points) for body in bodies),
            "median_mm": round(1e3 * float(np.median(found)), 2),
            "percentile_95_mm": round(1e3 * float(np.percentile(found, 95)), 2),
        }
    whole = np.concatenate(every)
    return {
        "median_mm": round(1e3 * float(np.median(whole)), 2),
        "percentile_95_mm": round(1e3 * float(np.percentile(whole, 95)), 2),
        "links": links,
    }


def main(robots: tuple[str, ...] = ROBOTS, /, fit: bool = False) -> bool:
    """Print a line an arm; true if a triangle is in no body."""
    stored = json.loads(STORED.read_text()) if STORED.is_file() else {}
    outside = 0
    for name in robots:
        if fit:
            file = LIBRARY / f"{name}.toml"
            kept = re.split(r"^\[\[(?:capsule|body)\]\]", file.read_text(), flags=re.MULTILINE)[0]
            file.write_text(kept.rstrip() + "\n" + tables(name))
        stored[name] = check(load_robot(name))
        shown = stored[name]
        lost = sum(link["outside"] for link in shown["links"].values())
        outside += lost
        print(
            f"{name:6s} {sum(x['bodies'] for x in shown['links'].values()):2d} bodies, triangles"
            f" in none: {lost}, surface to mesh {shown['median_mm']} mm (median),"
            f" {shown['percentile_95_mm']} mm (95 %)",
            flush=True,
        )
        STORED.write_text(json.dumps(stored, indent=1) + "\n")
    return outside > 0


if __name__ == "__main__":
    run(main)
