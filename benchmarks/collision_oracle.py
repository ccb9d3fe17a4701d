"""Judge certified motions by an independent oracle: pinocchio and coal, with the real meshes.

    python benchmarks/collision_oracle.py [--robots ur3e ...] [--designs 12] [--rate 2000]

Twelve designs each of the seven UR arms by default (`dynid design`, one start, one seed each):
every other one has a table, a wall or boxes, every third carries a tool and a payload, every
third is pushed by bisection to the edge of the certificate: its amplitudes are grown as long as
`certify` holds it. The oracle knows nothing of dynid but the joint positions. It builds
the kinematics from Universal Robots' YAML files, places their collision meshes, and at 2 kHz
looks at position, velocity and acceleration limits, speeds of tool and elbow, mesh against mesh
of every two links that are not neighbours, and meshes and tool against the scene. Prints one
line a design; exits 1 if it finds anything in a motion that the certificate calls feasible.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from fit_bodies import MESHES, ROBOTS, link_meshes

from dynid.constraints import MotionConstraints, certify, safe_constraints, scene_from_json
from dynid.core import JsonFields
from dynid.robot import RobotModel, Tool, load_robot
from dynid.trajectory import FourierSeries
from dynid.workflow import DesignSettings, design, read_design

SCENES: tuple[dict[str, Any], ...] = (
    {"shapes": [{"type": "table", "size": [1.4, 1.4], "position": [0, 0, -0.02]}]},
    {
        "shapes": [
            {"type": "floor", "height": -0.6},
            {"type": "wall", "point": [0.75, 0, 0], "normal": [-1, 0, 0]},
        ]
    },
    {
        "shapes": [
            {"type": "box", "size": [0.4, 0.6, 0.5], "position": [0.6, 0, -0.1]},
            {"type": "box", "size": [0.2, 0.2, 1.0], "position": [-0.4, 0.55, 0.2]},
            {"type": "cylinder", "radius": 0.1, "length": 1.2, "position": [0, -0.6, 0.3]},
        ]
    },
)
TOOL = {"type": "box", "size": [0.08, 0.08, 0.16], "position": [0, 0, 0.08]}
TIP, MASS = (0.0, 0.0, 0.16), 1.0
"""The tool's point and centre of mass in the flange's frame [m], and what it weighs [kg]."""
_EDGE = 12
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


def solid_of(shape: dict[str, Any]) -> tuple[Any, pin.SE3]:
    """A shape of a scene file for coal, read here once more, and its placement."""
    kind, place = shape["type"], np.array(shape.get("position", [0, 0, 0]), dtype=float)
    if kind == "floor":
        return coal.Halfspace(np.array([0.0, 0, 1]), float(shape.get("height", 0))), pin.SE3(1)
    if kind == "wall":
        normal = np.array(shape["normal"], dtype=float)
        normal /= np.linalg.norm(normal)
        return coal.Halfspace(normal, float(normal @ shape["point"])), pin.SE3(1)
    if kind == "table":
        return coal.Box(*shape["size"], 0.05), pin.SE3(np.eye(3), place - [0, 0, 0.025])
    if kind == "cylinder":
        return coal.Cylinder(shape["radius"], shape["length"]), pin.SE3(np.eye(3), place)
    return coal.Box(*shape["size"]), pin.SE3(np.eye(3), place)


class Oracle:
    """The meshes of a UR arm as Universal Robots place them, and what they touch.

    Args:
        name: The arm.
        scene: A scene file's object.
    """

    def __init__(self, name: str, scene: dict[str, Any] | None = None) -> None:
        text = (MESHES / "config" / name / "default_kinematics.yaml").read_text()
        number = r":\s*([-+.\deE]+)"
        steps = [
            [float(x) for x in row]
            for row in re.findall(
                rf"^  \w+:\s+x{number}\s+y{number}\s+z{number}\s+roll{number}\s+pitch{number}"
                rf"\s+yaw{number}",
                text,
                re.MULTILINE,
            )
        ]
        self.model, joint = pin.Model(), 0
        for k, (x, y, z, *rpy) in enumerate(steps):
            placement = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array([x, y, z]))
            joint = self.model.addJoint(joint, pin.JointModelRZ(), placement, f"j{k}")
        if joint != 6:
            raise ValueError(f"{name}: {joint} joints read")
        self.forearm = steps[3][0]
        self.shapes = pin.GeometryModel()
        scene = scene or {}
        for k, faces in enumerate(link_meshes(name)):
            self._add(f"link {k}", k, pin.SE3.Identity(), mesh_of(faces))
        for shape in scene.get("payload", []):
            self._add("tool", 6, pin.SE3(np.eye(3), np.array(shape["position"], dtype=float)),
                      coal.Box(*shape["size"]))  # fmt: skip
        links = [item.parentJoint for item in self.shapes.geometryObjects]
        for a, first in enumerate(links):
            for b in range(a + 1, len(links)):
                if links[b] - first > 1 or (b >= 7 and first < 6):
                    self.shapes.addCollisionPair(pin.CollisionPair(a, b))
        for shape in scene.get("shapes", []):
            solid, place = solid_of(shape)
            index = self._add("scene", 0, place, solid)
            for a, first in enumerate(links):
                if first > 0:
                    self.shapes.addCollisionPair(pin.CollisionPair(a, index))
        self.data, self.placed = self.model.createData(), self.shapes.createData()

    def _add(self, name: str, joint: int, place: pin.SE3, shape: Any) -> int:
        count = len(self.shapes.geometryObjects)
        item = pin.GeometryObject(f"{name} {count}", joint, place, shape)
        return int(self.shapes.addGeometryObject(item))

    def hits(self, q: np.ndarray) -> str:
        """The first two that touch, or nothing."""
        if not pin.computeCollisions(self.model, self.data, self.shapes, self.placed, q, True):
            return ""
        for pair, result in zip(
            self.shapes.collisionPairs, self.placed.collisionResults, strict=True
        ):
            if result.isCollision():
                items = self.shapes.geometryObjects
                return f"{items[pair.first].name} - {items[pair.second].name}"
        return "?"

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
        tip = pin.SE3(np.eye(3), np.array([0.0, 0, tool]))
        # Where dynid says that the elbow is, in ROS 2's frame of the forearm: an x axis away.
        place = np.linalg.inv(robot.parameter_frames["dh"][2]) @ robot.parameter_frames["urdf"][2]
        bend = pin.SE3(np.eye(3), place[:3, 3] + [self.forearm, 0, 0])
        top = elbow = 0.0
        for q, dq in zip(motion.q, motion.dq, strict=True):
            pin.forwardKinematics(self.model, self.data, q, dq)
            twist = tip.actInv(self.data.v[6])
            top = max(top, float(np.linalg.norm(twist.linear)))
            elbow = max(elbow, float(np.linalg.norm(bend.actInv(self.data.v[3]).linear)))
        if top > robot.safety.tcp_speed + slack:
            found.append(f"tool speed {top:.3f} m/s")
        if elbow > robot.safety.elbow_speed + slack:
            found.append(f"elbow speed {elbow:.3f} m/s")
        for k, q in enumerate(motion.q):
            if hit := self.hits(q):
                found.append(f"{hit} at sample {k}")
                break
        return found


def pushed(motion: FourierSeries, judge: MotionConstraints) -> FourierSeries:
    """The motion with amplitudes as large as the certificate allows."""

    def grown(by: float) -> FourierSeries:
        return FourierSeries(
            period=motion.period, offset=motion.offset, a=motion.a * by, b=motion.b * by
        )

    low, step = 1.0, 0.5
    for _ in range(_EDGE):
        if certify(grown(low + step), judge).feasible:
            low += step
        step /= 2
    return grown(low)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="*", default=ROBOTS)
    parser.add_argument("--designs", type=int, default=12, help="of each arm")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rate", type=float, default=2000.0, help="[Hz]")
    given = parser.parse_args()
    missed = passed = count = 0
    for name in given.robots:
        for k in range(given.designs):
            start = time.process_time()
            scene: dict[str, Any] = dict(SCENES[(k // 2) % len(SCENES)]) if k % 2 else {}
            tool = k % 3 == 0
            if tool:
                scene["payload"] = [TOOL]
            with tempfile.TemporaryDirectory() as folder:
                around, file = Path(folder) / "scene.json", Path(folder) / "design.json"
                around.write_text(json.dumps(scene))
                settings = DesignSettings(
                    starts=1,
                    seed=given.seed + k,
                    scene=str(around) if scene else None,
                    tool=TIP if tool else None,
                    payload=(MASS, *TIP) if tool else None,
                )
                design(name, settings, output=file)
                stored = read_design(file)
                motion: Any = stored.stored.trajectory
            robot = load_robot(name)
            if tool:
                carried = Tool(tcp=np.array(TIP), mass=MASS, com=np.array(TIP))
                robot = replace(robot, tool=carried)
            judge = safe_constraints(
                robot,
                scene_from_json(JsonFields(scene)) if scene else None,
            )
            edge = k % 3 == 1 and isinstance(motion, FourierSeries)
            if edge:
                motion = pushed(motion, judge)
            certificate = certify(motion, judge)
            times = np.arange(0.0, motion.duration, 1 / given.rate)
            found = Oracle(name, scene).broken(
                motion.evaluate(times), robot, TIP[2] if tool else 0.0
            )
            wrong = certificate.feasible and bool(found)
            missed, passed, count = missed + wrong, passed + certificate.feasible, count + 1
            verdict = "feasible" if certificate.feasible else "/".join(certificate.broken)
            near = certificate.margins["self_collision_m"]
            print(
                f"{name:6s} {k:2d} {'scene' if k % 2 else '':5s} {'tool' if tool else '':4s}"
                f" {'edge' if edge else '':4s} certificate: {verdict:20s} self-collision"
                f" {'-' if near is None else f'{1e3 * near:6.1f} mm'}  oracle:"
                f" {'/'.join(found) or 'nothing'}{'   MISSED' if wrong else ''}"
                f"  {time.process_time() - start:.0f} s",
                flush=True,
            )
    print(f"{count} designs at {given.rate:g} Hz, {passed} feasible; missed violations: {missed}")
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
