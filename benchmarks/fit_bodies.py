"""Prove the collision bodies of the built-in arms on Universal Robots' meshes.

    python benchmarks/fit_bodies.py [ur5 ...]

The proof reads the robot as users do, and finds for every triangle one body that holds its three
corners (a convex combination of the body's points that is within its radius of each); bodies are
convex, so that they hold the triangle. `benchmarks/bodies.json` gets the triangles that no body
holds, and the price, which is how far the outer surface of a link's bodies is from its mesh. Exits
with 1 where a triangle is in no body. The option that fitted them, `--fit`, last stood in commit
c4d07d92.
"""

import json
import tomllib
from typing import Any

import numpy as np
import yaml
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from shared.measuring import DATA, ROOT, run

from dynid.robot import Body, RobotModel, load_robot
from dynid.robot.body import beyond

MESHES = DATA / "ur_meshes"
LIBRARY = ROOT / "src/dynid/robot/library"
STORED = ROOT / "benchmarks/bodies.json"
ROBOTS = ("ur3", "ur5", "ur10", "ur3e", "ur5e", "ur10e", "ur16e")
LINKS = ("base", "shoulder", "upperarm", "forearm", "wrist1", "wrist2", "wrist3")
SPACING = 0.002


def described(robot: str, what: str) -> dict[str, Any]:
    """One of Universal Robots' files of an arm."""
    return yaml.safe_load((MESHES / "config" / robot / f"{what}.yaml").read_text())


def _turn(axes: str, angle: float) -> np.ndarray:
    return Rotation.from_euler(axes, [angle]).as_matrix().reshape(3, 3)


def link_meshes(robot: str) -> list[np.ndarray]:
    """(T, 3, 3) triangles of the base and of each link, in the frames of ROS 2's links [m].

    Where the meshes stand in them is a fact of `ur_macro.xacro`.
    """
    files = described(robot, "visual_parameters")["mesh_files"].values()
    offsets = described(robot, "physical_parameters")["offsets"]
    back, lying, sideways = _turn("z", np.pi), _turn("x", np.pi / 2), _turn("z", -np.pi / 2)
    upper, elbow = (float(offsets[f"{name}_offset"]) for name in ("shoulder", "elbow"))
    turns = (back, back, sideways @ lying, sideways @ lying, lying, np.eye(3), lying)
    row = np.dtype([("normal", "<f4", 3), ("corners", "<f4", 9), ("attribute", "<u2")])
    found = []
    for file, turn, usual in zip(files, turns, (0.0, 0.0, upper, elbow, 0, 0, 0), strict=True):
        data = (MESHES / file["collision"]["mesh"]["path"]).read_bytes()
        corners = np.frombuffer(data[84:], row)["corners"].reshape(-1, 3).astype(np.float64)
        height = float(file.get("visual_offset", usual))
        found.append((corners @ turn.T + [0, 0, height]).reshape(-1, 3, 3))
    return found


def meshes_of(robot: RobotModel) -> list[np.ndarray]:
    """The same in the frames of the bodies: the base's, and the joint frames."""
    dh, found = robot.parameter_frames["dh"], link_meshes(robot.name)
    table = tomllib.loads((LIBRARY / f"{robot.name}.toml").read_text())["dh"]
    for k, (a, alpha) in enumerate(zip(table["a"], table["alpha"], strict=True)):
        faces = (found[k + 1] - [a, 0, 0]) @ _turn("x", alpha)
        found[k + 1] = faces @ dh[k, :3, :3].T + dh[k, :3, 3]
    return found


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


def _distances(found: np.ndarray) -> dict[str, float]:
    median, most = 1e3 * np.percentile(found, [50, 95])
    return {"median_mm": round(float(median), 2), "percentile_95_mm": round(float(most), 2)}


def check(robot: RobotModel) -> dict[str, Any]:
    """What is stored of one robot."""
    links: dict[str, Any] = {}
    every: list[np.ndarray] = []
    for k, (name, faces) in enumerate(zip(LINKS, meshes_of(robot), strict=True)):
        bodies = [body for body in robot.bodies if body.link == k]
        every.append(price(faces, bodies))
        links[name] = {
            "triangles": len(faces),
            "outside": outside(faces, bodies),
            "bodies": len(bodies),
            "points": sum(len(body.points) for body in bodies),
            **_distances(every[-1]),
        }
    return {**_distances(np.concatenate(every)), "links": links}


def main(robots: tuple[str, ...] = ROBOTS, /) -> bool:
    """Print a line an arm; true if a triangle is in no body."""
    stored, every = json.loads(STORED.read_text()), 0
    for name in robots:
        shown = stored[name] = check(load_robot(name))
        bodies, lost = (
            sum(x[key] for x in shown["links"].values()) for key in ("bodies", "outside")
        )
        every += lost
        print(
            f"{name:6s} {bodies:2d} bodies, triangles in none: {lost}, surface to mesh "
            f"{shown['median_mm']} mm (median), {shown['percentile_95_mm']} mm (95 %)",
            flush=True,
        )
    STORED.write_text(json.dumps(stored, indent=1) + "\n")
    return every > 0


if __name__ == "__main__":
    run(main)
