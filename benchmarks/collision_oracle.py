"""Judge certified motions by an independent oracle: pinocchio and coal, with the real meshes.

    python benchmarks/collision_oracle.py [--robots ur3e ...] [--motions 12] [--rate 2000]
    python benchmarks/collision_oracle.py --designs [--mounts floor wall ceiling] [--motions 10]
    python benchmarks/collision_oracle.py --designs --tool 0.3 --rate 10000 --motions 3

Twelve certified motions each of the seven UR arms by default: random Fourier series about free
poses, as large as the limits let them be at 125 Hz samples. Every other one has a table, a wall or
boxes, every third carries a tool and a payload, every third is pushed by bisection to the edge of
the certificate. With `--designs` they are what `dynid design` writes by default, on each mounting,
a seed each; `--tool` gives them a tool of that length [m]. The oracle knows nothing of dynid but
the joint positions. It builds the kinematics from Universal Robots' YAML files, places their
collision meshes, and at 2 kHz looks at position, velocity and acceleration limits, speeds of tool
and elbow, mesh against mesh of every two links that are not neighbours, and meshes and tool against
the scene and the mounting plane. Samples before which a pair cannot have met, as the distance over
its largest speed says, are skipped. Prints one line a motion; exits 1 if it finds anything in one
that the certificate calls feasible.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from fit_bodies import ROBOTS, described, link_meshes
from shared.measuring import run

from dynid.constraints import MotionConstraints, certify, safe_constraints, scene_from_json
from dynid.core import JsonFields
from dynid.robot import RobotModel, Tool, load_robot
from dynid.trajectory import FourierSeries
from dynid.workflow import DesignSettings, design

_BOXES = [
    {"type": "box", "size": [0.4, 0.6, 0.5], "position": [0.6, 0, -0.1]},
    {"type": "box", "size": [0.2, 0.2, 1.0], "position": [-0.4, 0.55, 0.2]},
    {"type": "cylinder", "radius": 0.1, "length": 1.2, "position": [0, -0.6, 0.3]},
]
_WALL = {"type": "wall", "point": [0.75, 0, 0], "normal": [-1, 0, 0]}
SCENES: tuple[dict[str, Any], ...] = (
    {"shapes": [{"type": "table", "size": [1.4, 1.4], "position": [0, 0, -0.02]}]},
    {"shapes": [{"type": "floor", "height": -0.6}, _WALL]},
    {"shapes": _BOXES},
)
FLOOR = {"type": "floor", "height": 0}
TOOL = {"type": "box", "size": [0.08, 0.08, 0.16], "position": [0, 0, 0.08]}
TIP, MASS = (0.0, 0.0, 0.16), 1.0
"""The tool's point and centre of mass in the flange's frame [m], and what it weighs [kg]."""
PERIOD = 10.0
"""Of the random motions [s]."""
_EDGE = 10
"""Halvings of the step with which a motion is pushed to the certificate's edge."""


def mesh_of(faces: np.ndarray) -> coal.BVHModelOBBRSS:
    """A mesh (T, 3, 3) as coal's hierarchy."""
    corners, rows = np.unique(faces.reshape(-1, 3), axis=0, return_inverse=True)
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(faces), len(corners))
    for row in rows.reshape(-1, 3):
        mesh.addTriangle(*corners[row])
    mesh.endModel()
    return mesh


def solid_of(shape: dict[str, Any]) -> tuple[Any, np.ndarray]:
    """A shape of a scene file for coal, read here once more, and its place."""
    kind, place = shape["type"], np.array(shape.get("position", [0, 0, 0]), dtype=float)
    if kind == "table":
        return coal.Box(*shape["size"], 0.05), place - [0, 0, 0.025]
    if kind == "cylinder":
        return coal.Cylinder(shape["radius"], shape["length"]), place
    return coal.Box(*shape["size"]), place


class Oracle:
    """The meshes of a UR arm as Universal Robots place them, and what they touch.

    Args:
        name: The arm.
        scene: A scene file's object.
    """

    def __init__(self, name: str, scene: dict[str, Any] | None = None) -> None:
        self.model, joint, scene = pin.Model(), 0, scene or {}
        poses = described(name, "default_kinematics")["kinematics"]
        for link in ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"):
            pose = poses[link]
            turn = pin.rpy.rpyToMatrix(*(float(pose[key]) for key in ("roll", "pitch", "yaw")))
            placement = pin.SE3(turn, np.array([float(pose[key]) for key in "xyz"]))
            joint = self.model.addJoint(joint, pin.JointModelRZ(), placement, link)
        self.data, self.geometry = self.model.createData(), pin.GeometryModel()
        self.forearm = float(self.model.jointPlacements[4].translation[0])
        self.corners: list[np.ndarray] = []
        """Of each part of the arm, in its joint's frame."""
        for k, faces in enumerate(link_meshes(name)):
            self._add(f"link {k}", k, mesh_of(faces))
            self.corners.append(np.unique(faces.reshape(-1, 3), axis=0))
        for shape in scene.get("payload", []):
            box, middle = solid_of(shape)
            self._add("tool", 6, box, middle)
            corners = np.array(list(itertools.product((-1, 1), repeat=3)))
            self.corners.append(middle + np.array(shape["size"]) / 2 * corners)
        arm = len(self.corners)
        joints = [part.parentJoint for part in self.geometry.geometryObjects]
        pairs = [
            (a, b)
            for a, b in itertools.combinations(range(arm), 2)
            if joints[b] - joints[a] > 1 or (b >= 7 and joints[a] < 6)
        ]
        self.planes: list[tuple[np.ndarray, float]] = []
        shapes = list(scene.get("shapes", []))
        if not any(shape["type"] == "floor" for shape in shapes):
            # The mounting plane.
            shapes.append(FLOOR)
        for shape in shapes:
            if shape["type"] == "floor":
                self.planes.append((np.array([0.0, 0, 1]), float(shape.get("height", 0))))
            elif shape["type"] == "wall":
                normal = np.array(shape["normal"]) / np.linalg.norm(shape["normal"])
                self.planes.append((normal, float(normal @ shape["point"])))
            else:
                self._add("scene", 0, *solid_of(shape))
                pairs += [(a, len(self.geometry.geometryObjects) - 1) for a in range(1, arm)]
        for a, b in pairs:
            self.geometry.addCollisionPair(pin.CollisionPair(a, b))
        self.placed = self.geometry.createData()
        # How far each joint moves any point of a part, at most, for a radian [m].
        steps_m = [float(np.linalg.norm(place.translation)) for place in self.model.jointPlacements]
        self.reach = np.zeros((arm, 6))
        for b, corners in enumerate(self.corners):
            size = float(np.linalg.norm(corners, axis=1).max())
            for j in range(joints[b]):
                self.reach[b, j] = sum(steps_m[j + 2 : joints[b] + 1]) + size

    def _add(self, what: str, joint: int, shape: Any, place: np.ndarray | None = None) -> None:
        at = pin.SE3(np.eye(3), np.zeros(3) if place is None else place)
        name = f"{what} {len(self.geometry.geometryObjects)}" if what == "scene" else what
        self.geometry.addGeometryObject(pin.GeometryObject(name, joint, at, shape))

    def _apart(self, pair: int, q: np.ndarray) -> float:
        """Distance of two parts; zero or less where they meet."""
        pin.updateGeometryPlacements(self.model, self.data, self.geometry, self.placed, q)
        return float(pin.computeDistance(self.geometry, self.placed, pair).min_distance)

    def _above(self, a: int, normal: np.ndarray, height: float, q: np.ndarray) -> float:
        """How far a part is above a plane."""
        pin.forwardKinematics(self.model, self.data, q)
        at = self.data.oMi[self.geometry.geometryObjects[a].parentJoint]
        lowest = float((self.corners[a] @ (at.rotation.T @ normal)).min())
        return lowest + float(normal @ at.translation) - height

    def meets(self, q: np.ndarray) -> tuple[str, float, int]:
        """The first two parts that touch at samples q (N, 6), the least distance, and queries."""
        travel = np.vstack([np.zeros(6), np.cumsum(np.abs(np.diff(q, axis=0)), axis=0)])
        least, queries, parts = math.inf, 0, self.geometry.geometryObjects
        checks: list[tuple[str, np.ndarray, Callable[[np.ndarray], float]]] = []
        for k, pair in enumerate(self.geometry.collisionPairs):
            a, b = pair.first, pair.second
            # A link's own motion where the other part is of the scene.
            links = b < len(self.corners)
            rate = self.reach[b if links else a].copy()
            if links:
                rate[: parts[a].parentJoint] = 0.0
            checks.append((f"{parts[a].name} - {parts[b].name}", rate, partial(self._apart, k)))
        for (normal, height), a in itertools.product(self.planes, range(1, len(self.corners))):
            above = partial(self._above, a, normal, height)
            checks.append((f"{parts[a].name} - plane", self.reach[a], above))
        for name, rate, distance in checks:
            way, k = travel @ rate, 0
            while k < len(q):
                queries += 1
                far = distance(q[k])
                least = min(least, far)
                if far <= 0.0:
                    return f"{name} at sample {k}", far, queries
                k = max(k + 1, int(np.searchsorted(way, way[k] + far)))
        return "", least, queries

    def broken(self, motion: Any, robot: RobotModel, tool: float) -> list[str]:
        """What is wrong with samples of a motion; `tool` is the length of the tool [m]."""
        slack, found = 1e-9, []
        limits = robot.limits
        for name, values, bound in (
            ("velocity", motion.dq, limits.velocity),
            ("acceleration", motion.ddq, limits.acceleration),
        ):
            if (np.abs(values) > np.where(np.isnan(bound), math.inf, bound) + slack).any():
                found.append(name)
        if ((motion.q < limits.lower - slack) | (motion.q > limits.upper + slack)).any():
            found.append("position")
        # Where dynid says that the elbow is, in ROS 2's frame of the forearm: an x axis away.
        place = np.linalg.inv(robot.parameter_frames["dh"][2]) @ robot.parameter_frames["urdf"][2]
        bend = place[:3, 3] + [self.forearm, 0, 0]
        top = elbow = 0.0
        for q, dq in zip(motion.q, motion.dq, strict=True):
            pin.forwardKinematics(self.model, self.data, q, dq)
            speeds = [
                np.linalg.norm(twist.linear + np.cross(twist.angular, point))
                for twist, point in ((self.data.v[6], [0, 0, tool]), (self.data.v[3], bend))
            ]
            top, elbow = max(top, float(speeds[0])), max(elbow, float(speeds[1]))
        if top > robot.safety.tcp_speed + slack:
            found.append(f"tool speed {top:.3f} m/s")
        if elbow > robot.safety.elbow_speed + slack:
            found.append(f"elbow speed {elbow:.3f} m/s")
        self.said, self.least, self.queries = self.meets(motion.q)
        return [*found, self.said] if self.said else found


def scaled(motion: FourierSeries, by: float) -> FourierSeries:
    """The motion with other amplitudes."""
    return replace(motion, a=motion.a * by, b=motion.b * by)


def pushed(motion: FourierSeries, judge: MotionConstraints) -> FourierSeries:
    """The motion with amplitudes as large as the certificate allows."""
    low, step = 1.0, 0.25
    for _ in range(_EDGE):
        if certify(scaled(motion, low + step), judge).feasible:
            low += step
        step /= 2
    return scaled(motion, low)


def random_motion(judge: MotionConstraints, random: np.random.Generator) -> FourierSeries:
    """A certified motion about a random pose, as large as samples let it be."""
    robot, harmonics = judge.robot, np.arange(1, 6)
    times = np.arange(0.0, PERIOD, 1 / 125)

    def fits(motion: FourierSeries, at: np.ndarray) -> bool:
        found = motion.evaluate(at)
        return judge.holds(found.q, found.dq, found.ddq)

    while True:
        pose = random.uniform(-2.5, 2.5, robot.joints)
        pose[0] = random.uniform(-3, 3)
        shape = random.normal(size=(2, robot.joints, 5)) / harmonics
        motion = FourierSeries(period=PERIOD, offset=pose, a=shape[0], b=shape[1])
        if not fits(scaled(motion, 1e-3), times[:1]):
            continue
        low, high = 0.0, 1.0
        for _ in range(7):
            middle = (low + high) / 2
            low, high = (middle, high) if fits(scaled(motion, middle), times) else (low, middle)
        # Little motion in a corner tells little.
        while low > 0.05:
            if certify(scaled(motion, low), judge).feasible:
                return scaled(motion, low)
            low *= 0.97


def main(
    robots: tuple[str, ...] = ROBOTS,
    motions: int = 12,
    designs: bool = False,
    mounts: tuple[str, ...] = ("floor",),
    tool: float = 0.0,
    seed: int = 0,
    rate: float = 2000.0,
) -> bool:
    missed = passed = count = 0
    for name, mount, k in itertools.product(robots, mounts, range(motions)):
        scene: dict[str, Any] = {} if designs or not k % 2 else dict(SCENES[k // 2 % len(SCENES)])
        carries, edge = not designs and k % 3 == 0, not designs and k % 3 == 1
        kinds = {mount: designs, "scene": bool(scene), "tool": carries, "edge": edge}
        robot = load_robot(name, mount=mount)
        length = TIP[2] if carries else tool
        if carries:
            scene["payload"] = [TOOL]
            robot = replace(robot, tool=Tool(tcp=np.array(TIP), mass=MASS, com=np.array(TIP)))
        elif length:
            robot = replace(robot, tool=Tool(tcp=np.array((0.0, 0.0, length))))
        judge = safe_constraints(robot, scene_from_json(JsonFields(scene)) if scene else None)
        if designs:
            motion = design(robot, DesignSettings(seed=seed + k)).trajectory
        else:
            motion = random_motion(judge, np.random.default_rng([seed, k]))
        if edge:
            motion = pushed(motion, judge)
        certificate, oracle = certify(motion, judge), Oracle(name, scene)
        times = np.arange(0.0, motion.duration, 1 / rate)
        found = oracle.broken(motion.evaluate(times), robot, length)
        wrong = certificate.feasible and bool(found)
        missed, passed, count = missed + wrong, passed + certificate.feasible, count + 1
        near = certificate.margins["self_collision_m"]
        print(
            f"{name:6s} {k:2d} {' '.join(word for word, on in kinds.items() if on):16s} "
            f"certificate: {'/'.join(certificate.broken) or 'feasible':12s} bodies "
            f"{'-' if near is None else f'{1e3 * near:6.1f} mm'}, meshes "
            f"{1e3 * oracle.least:6.1f} mm in {oracle.queries} queries; "
            f"oracle: {'/'.join(found) or 'nothing'}{'   MISSED' if wrong else ''}",
            flush=True,
        )
    print(f"{count} motions at {rate:g} Hz, {passed} feasible; missed violations: {missed}")
    return missed > 0


if __name__ == "__main__":
    run(main)
