"""Fit the collision bodies of the built-in arms to Universal Robots' meshes, and prove them.

    python benchmarks/fit_bodies.py [ur5 ...] [--meshes ../shared/data/ur_meshes]   fit, rewrite
    python benchmarks/fit_bodies.py --check                                         prove alone

A fit writes the [[body]] tables of `src/dynid/robot/library/*.toml`. Fitting and proving have
nothing in common but the meshes: the proof reads the robot as users do, and finds for every
triangle one body that holds its three corners (a convex combination of the body's points that is
within its radius of each); bodies are convex, so that they hold the triangle. Both write
`benchmarks/bodies.json`: triangles that no body holds, and the price, which is how far the outer
surface of a link's bodies is from its mesh.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from dynid.robot import Body, RobotModel, load_robot
from dynid.robot.body import around_points, beyond, parts_of

HERE = Path(__file__).parent
MESHES = HERE.parents[1] / "shared/data/ur_meshes"
LIBRARY = HERE.parent / "src/dynid/robot/library"
STORED = HERE / "bodies.json"
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


def _turn(axis: int, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found = np.eye(3)
    found[i, i] = found[j, j] = c
    found[i, j], found[j, i] = -s, s
    return found


def link_meshes(robot: str, meshes: Path = MESHES) -> list[np.ndarray]:
    """(T, 3, 3) triangles of the base and of each link, in the frames of ROS 2's links [m].

    Where the meshes stand in them is a fact of `ur_macro.xacro`.
    """
    config = meshes / "config" / robot
    visual = (config / "visual_parameters.yaml").read_text()
    physical = (config / "physical_parameters.yaml").read_text()
    offsets = [float(x) for x in re.findall(r"visual_offset:\s*(\S+)", visual)]
    places = [
        (0.0, _turn(2, np.pi)),
        (0.0, _turn(2, np.pi)),
        (_number(physical, "shoulder_offset"), _turn(2, -np.pi / 2) @ _turn(0, np.pi / 2)),
        (_number(physical, "elbow_offset"), _turn(2, -np.pi / 2) @ _turn(0, np.pi / 2)),
        (offsets[0], _turn(0, np.pi / 2)),
        (offsets[1], np.eye(3)),
        (offsets[2], _turn(0, np.pi / 2)),
    ]
    row = np.dtype([("normal", "<3f4"), ("corners", "<9f4"), ("attribute", "<u2")])
    found = []
    for file, (height, turn) in zip(
        re.findall(r"path: (meshes/\S+\.stl)", visual), places, strict=True
    ):
        data = (meshes / file).read_bytes()
        corners = np.frombuffer(data[84:], row)["corners"].reshape(-1, 3).astype(np.float64)
        found.append((corners @ turn.T + [0, 0, height]).reshape(-1, 3, 3))
    return found


def meshes_of(robot: RobotModel, meshes: Path = MESHES) -> list[np.ndarray]:
    """The same in the frames of the bodies: the base's, and the joint frames."""
    dh = robot.parameter_frames["dh"]
    found = link_meshes(robot.name, meshes)
    for k, (a, alpha) in enumerate(_dh_table(robot.name)):
        faces = (found[k + 1] - [a, 0, 0]) @ _turn(0, alpha)
        found[k + 1] = faces @ dh[k, :3, :3].T + dh[k, :3, 3]
    return found


def _dh_table(robot: str) -> list[tuple[float, float]]:
    text = (LIBRARY / f"{robot}.toml").read_text()
    rows = [json.loads(re.search(rf"^{key} = (\[.*\])", text, re.MULTILINE)[1])  # type: ignore[index]
            for key in ("a", "alpha")]  # fmt: skip
    return list(zip(*rows, strict=True))


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


def fit(faces: np.ndarray, name: str) -> list[Body]:
    """Bodies around a mesh (T, 3, 3)."""
    found = [
        around_points(part.reshape(-1, 3), corners=CORNERS, within=WITHIN)
        for part in parts_of(faces, WORTH)
    ]
    return [
        Body(name=f"{name} {k + 1}", link=0, points=points, radius=radius)
        for k, (points, radius) in enumerate(found)
    ]


def tables(robot: str, meshes: Path) -> str:
    """The [[body]] tables of a robot's file."""
    lines: list[str] = []
    table = [(0.0, 0.0), *_dh_table(robot)]
    for k, (faces, (a, alpha)) in enumerate(zip(link_meshes(robot, meshes), table, strict=True)):
        name = LINKS[k] if k == 0 else JOINTS[k - 1]
        placed = (faces - [a, 0, 0]) @ _turn(0, alpha)
        key = placed.tobytes()
        if key not in _FITTED:
            _FITTED[key] = fit(placed, LINKS[k])
        for body in _FITTED[key]:
            lines += ["", "[[body]]"]
            if not any("source" in line for line in lines):
                lines.append(f'source = """{SOURCE}"""')
            lines += [f'name = "{body.name}"', f'link = "{name}"']
            lines += ['frames = "dh"'] if k else []
            lines += ["points = ["]
            lines += [f"    {(np.round(point, 4) + 0.0).tolist()}," for point in body.points]
            lines += ["]", f"radius = {body.radius:.4f}"]
    return "\n".join(lines) + "\n"


_FITTED: dict[bytes, list[Body]] = {}
"""Some arms share meshes."""
JOINTS = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint",
    "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
)  # fmt: skip


def check(robot: RobotModel, meshes: Path = MESHES) -> dict[str, Any]:
    """What is stored of one robot."""
    links: dict[str, Any] = {}
    every: list[np.ndarray] = []
    for k, faces in enumerate(meshes_of(robot, meshes)):
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=ROBOTS)
    parser.add_argument("--meshes", type=Path, default=MESHES)
    parser.add_argument("--check", action="store_true", help="prove what the files hold")
    given = parser.parse_args()
    stored = json.loads(STORED.read_text()) if STORED.is_file() else {}
    for name in given.robots:
        if not given.check:
            file = LIBRARY / f"{name}.toml"
            kept = re.split(r"^\[\[(?:capsule|body)\]\]", file.read_text(), flags=re.MULTILINE)[0]
            file.write_text(kept.rstrip() + "\n" + tables(name, given.meshes))
        stored[name] = check(load_robot(name), given.meshes)
        shown = stored[name]
        lost = sum(link["outside"] for link in shown["links"].values())
        print(
            f"{name:6s} {sum(x['bodies'] for x in shown['links'].values()):2d} bodies, triangles"
            f" in none: {lost}, surface to mesh {shown['median_mm']} mm (median),"
            f" {shown['percentile_95_mm']} mm (95 %)",
            flush=True,
        )
        STORED.write_text(json.dumps(stored, indent=1) + "\n")


if __name__ == "__main__":
    main()
