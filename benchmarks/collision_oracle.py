"""Judge designs by an independent oracle: pinocchio and coal, with the meshes of the UR arms.

    python benchmarks/collision_oracle.py [DESIGN.json ...] [--designs 20] [--optimised 10]

Two kinds of motion: random rest-to-rest series scaled into the limits, half of them shrunk until
they are safe; and what the optimiser makes (`dynid design --starts 1`, one seed each, every
other one with the scene), since an optimiser pushes against every boundary. Files are judged
too. At 1 kHz the oracle looks at position, velocity and acceleration limits, speeds of tool and
elbow (pinocchio), at mesh against mesh, and at meshes against a floor and a table. Prints one
line a design, and exits 1 if the oracle finds anything that the certificate passed.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from dynid.constraints import MotionConstraints, certify, safe_constraints, scene_from_json
from dynid.core import JsonFields
from dynid.robot import RobotModel, load_robot
from dynid.trajectory import FourierSeries, Trajectory, random_excitation
from dynid.workflow import DesignLimits, DesignSettings, design, read_design

DATA = Path(sys.prefix) / (
    f"lib/python3.{sys.version_info.minor}/site-packages/"
    "cmeel.prefix/share/example-robot-data/robots"
)
TURNED = pin.SE3(pin.utils.rotate("z", np.pi), np.zeros(3))
"""ROS's base_link in the base frame of Universal Robots."""
FLOOR, TABLE = -0.4, ((0.5, 0.5, 0.05), (0.6, 0.0, -0.1))
SCENE: dict[str, Any] = {
    "shapes": [
        {"type": "floor", "height": FLOOR},
        {"type": "box", "name": "table", "size": list(TABLE[0]), "position": list(TABLE[1])},
    ]
}


class Oracle:
    """Meshes of a UR arm, and what they touch."""

    def __init__(self, robot: RobotModel, scene: bool = True) -> None:
        self.robot = robot
        urdf = str(DATA / f"ur_description/urdf/{robot.name}_robot.urdf")
        self.model = pin.buildModelFromUrdf(urdf)
        shapes = pin.buildGeomFromUrdf(
            self.model, urdf, pin.GeometryType.COLLISION, package_dirs=[str(DATA.parent.parent)]
        )
        arm = len(shapes.geometryObjects)
        joint = [item.parentJoint for item in shapes.geometryObjects]
        if scene:
            for name, shape, where in (
                ("floor", coal.Halfspace(np.array([0.0, 0, 1]), FLOOR), np.zeros(3)),
                ("table", coal.Box(*TABLE[0]), np.array(TABLE[1])),
            ):
                placed = TURNED.inverse() * pin.SE3(np.eye(3), where)
                shapes.addGeometryObject(pin.GeometryObject(name, 0, placed, shape))
        for a in range(arm):
            for b in range(a + 1, arm):
                if abs(joint[a] - joint[b]) > 1:
                    shapes.addCollisionPair(pin.CollisionPair(a, b))
            if joint[a] > 0:
                for b in range(arm, len(shapes.geometryObjects)):
                    shapes.addCollisionPair(pin.CollisionPair(a, b))
        self.shapes, self.data, self.placed = shapes, self.model.createData(), shapes.createData()

    def collides(self, q: np.ndarray) -> bool:
        """Whether any two meshes meet."""
        return bool(pin.computeCollisions(self.model, self.data, self.shapes, self.placed, q, True))

    def speeds(self, q: np.ndarray, dq: np.ndarray) -> list[float]:
        """Speeds of the flange and of the elbow [m/s]."""
        pin.forwardKinematics(self.model, self.data, q, dq)
        elbow = self.robot.joint_names[self.robot.safety.elbow - 1]
        frames = [self.model.getFrameId(name) for name in ("ee_link", elbow)]
        turned = pin.LOCAL_WORLD_ALIGNED
        moved = [pin.getFrameVelocity(self.model, self.data, k, turned).linear for k in frames]
        return [float(np.linalg.norm(velocity)) for velocity in moved]

    def broken(self, motion: Any, every: int = 1) -> list[str]:
        """What the oracle finds wrong with samples of a motion."""
        limits, slack = self.robot.limits, 1e-9
        found = []
        if ((motion.q < limits.lower - slack) | (motion.q > limits.upper + slack)).any():
            found.append("position")
        if (np.abs(motion.dq) > limits.velocity + slack).any():
            found.append("velocity")
        if (np.abs(motion.ddq) > limits.acceleration + slack).any():
            found.append("acceleration")
        states = zip(motion.q[::every], motion.dq[::every], strict=True)
        tool, elbow = np.array([self.speeds(q, dq) for q, dq in states]).T
        if tool.max() > self.robot.safety.tcp_speed + slack:
            found.append("tcp_speed")
        if elbow.max() > self.robot.safety.elbow_speed + slack:
            found.append("elbow_speed")
        if any(self.collides(q) for q in motion.q[::every]):
            found.append("collision")
        return found


def random_designs(
    robot: RobotModel, constraints: MotionConstraints, count: int, seed: int
) -> list[FourierSeries]:
    """Random series within the joint limits; every other one shrunk until the judge is content."""
    home = np.array([0.0, -1.2, 0.9, 0.0, -1.57, 0.0])
    found = []
    for k in range(count):
        size = (0.5 if k % 2 else 0.8) + 0.2 * ((k // 2) % 5) / 4
        series = random_excitation(robot.limits, seed=seed + k, margin=0.9, offset=home)
        a, b = series.a * size, series.b * size
        while k % 2 and size > 1e-3:
            shrunk = FourierSeries(period=series.period, offset=home, a=a, b=b)
            motion = shrunk.sample(15)
            if constraints.violation(motion.q, motion.dq, motion.ddq, tighten=0.1)[0] == 0:
                break
            a, b, size = a * 0.93, b * 0.93, size * 0.93
        found.append(FourierSeries(period=series.period, offset=home, a=a, b=b))
    return found


def optimised_designs(name: str, folder: Path, count: int, seed: int) -> list[Path]:
    """What `dynid design` writes after one start each; every other one with the scene."""
    scene = folder / "scene.json"
    scene.write_text(json.dumps(SCENE))
    files = []
    for k in range(count):
        around = str(scene) if k % 2 else None
        files.append(folder / f"optimised {seed + k}{' scene' if around else ''}.json")
        settings = DesignSettings(starts=1, seed=seed + k, scene=around)
        design(name, settings, output=files[-1])
    return files


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--designs", type=int, default=20, help="of both kinds")
    parser.add_argument("--optimised", type=int, default=10, help="how many by the optimiser")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robot", default="ur5", choices=["ur3", "ur5", "ur10"])
    given = parser.parse_args()
    robot = load_robot(given.robot)
    constraints = safe_constraints(robot, scene_from_json(JsonFields(SCENE)))
    oracles = {False: Oracle(robot, scene=False), True: Oracle(robot)}
    random = max(given.designs - given.optimised - len(given.files), 0)
    drawn = random_designs(robot, constraints, random, given.seed)
    cases: dict[str, tuple[Trajectory, MotionConstraints, bool]] = {
        f"random {k}": (series, constraints, True) for k, series in enumerate(drawn)
    }
    with tempfile.TemporaryDirectory() as folder:
        made = optimised_designs(given.robot, Path(folder), given.optimised, given.seed)
        for file in (*given.files, *made):
            stored = read_design(file, robot=given.robot)
            limits = stored.limits or DesignLimits(scene=SCENE)
            if limits.scene not in (None, SCENE):
                sys.exit(f"{file}: the oracle knows no other scene than its own")
            held = replace(limits, preset="safe").constraints(stored.robot)
            cases[file.stem] = stored.stored.trajectory, held, limits.scene is not None
    missed = passed = 0
    for name, (motion, judge, scene) in cases.items():
        certificate = certify(motion, judge)
        times = np.arange(0.0, motion.duration, 1e-3)
        found = oracles[scene].broken(motion.evaluate(times))
        wrong = certificate.feasible and bool(found)
        missed += wrong
        passed += certificate.feasible
        verdict = "feasible" if certificate.feasible else "/".join(certificate.broken)
        near = certificate.margins["self_collision_m"]
        print(
            f"{name:20s} certificate: {verdict:40s} self-collision"
            f" {'-' if near is None else f'{1e3 * near:6.1f} mm'}  oracle:"
            f" {'/'.join(found) or 'nothing'}{'   MISSED' if wrong else ''}",
            flush=True,
        )
    print(
        f"{len(cases)} designs at 1 kHz, {passed} of them feasible;"
        f" violations the certificate missed: {missed}"
    )
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
