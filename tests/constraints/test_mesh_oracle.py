"""The certificate against the link meshes of ROS's UR arms, judged by pinocchio and coal.

The whole run, 20 designs at 1 kHz, is `benchmarks/collision_oracle.py`.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

from dynid.constraints import certify, safe_constraints, scene_from_json
from dynid.core import JsonFields
from dynid.robot import joint_poses, load_robot

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from collision_oracle import DATA, SCENE, TURNED, Oracle, random_designs
from fit_capsules import triangles

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the package example-robot-data is not installed"
)
ROUNDING = 1e-9


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10"])
def test_capsules_enclose_the_meshes(name: str) -> None:
    robot = load_robot(name)
    turned = TURNED.homogeneous
    for link, faces in enumerate(triangles(name)):
        frame = robot.parameter_frames["urdf"][link - 1] if link else turned
        # Points all over each triangle, not its corners alone.
        shares = np.random.default_rng(0).dirichlet(np.ones(3), 6)
        points = np.concatenate(
            [faces.reshape(-1, 3), np.einsum("sk,tkx->tsx", shares, faces).reshape(-1, 3)]
        )
        placed = points @ frame[:3, :3].T + frame[:3, 3]
        depth = np.full(len(placed), np.inf)
        for item in robot.capsules:
            if item.link == link:
                way = item.end - item.start
                t = np.clip((placed - item.start) @ way / max(way @ way, 1e-12), 0, 1)
                far = np.linalg.norm(placed - item.start - t[:, None] * way, axis=1)
                depth = np.minimum(depth, far - item.radius)
        assert depth.max() <= ROUNDING, robot.joint_names[link - 1] if link else "base"


def test_the_oracle_stands_where_our_robot_stands() -> None:
    robot = load_robot("ur5")
    oracle = Oracle(robot)
    import pinocchio as pin

    for q in np.random.default_rng(0).uniform(-3, 3, (5, 6)):
        pin.forwardKinematics(oracle.model, oracle.data, q)
        ours = joint_poses(robot, q) @ robot.parameter_frames["urdf"]
        for k in range(6):
            theirs = (TURNED * oracle.data.oMi[k + 1]).homogeneous
            np.testing.assert_allclose(ours[k], theirs, atol=1e-9)


def test_no_pose_with_touching_meshes_passes() -> None:
    robot = load_robot("ur5")
    oracle = Oracle(robot, scene=False)
    judge = safe_constraints(robot)
    rest = np.zeros((1, 6))
    touching = free = 0
    for q in np.random.default_rng(1).uniform(-np.pi, np.pi, (150, 6)):
        passes = judge.usage(q[None], rest, rest).feasible
        if oracle.collides(q):
            touching += 1
            assert not passes
        else:
            free += passes
    assert touching > 20
    assert free > 30


def test_no_design_passes_that_the_oracle_refuses() -> None:
    robot = load_robot("ur5")
    judge = safe_constraints(robot, scene_from_json(JsonFields(SCENE)))
    oracle = Oracle(robot)
    verdicts = set()
    for design in random_designs(robot, judge, 3, seed=0):
        certificate = certify(design, judge)
        found = oracle.broken(design.sample(50))
        assert not (certificate.feasible and found)
        verdicts.add((certificate.feasible, bool(found)))
    assert {(True, False), (False, True)} <= verdicts
