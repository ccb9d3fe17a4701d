"""Built-in bodies and certificates against Universal Robots' meshes, judged by pinocchio and coal.

The whole run, 84 designs at 2 kHz, is `benchmarks/collision_oracle.py`; the proof that every
triangle is held is `benchmarks/fit_bodies.py`, stored in `benchmarks/bodies.json`.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from dynid.constraints import certify, safe_constraints, scene_from_json
from dynid.core import JsonFields
from dynid.robot import joint_poses, load_robot
from dynid.trajectory import FourierSeries, random_excitation

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from collision_oracle import SCENES, Oracle
from fit_bodies import LINKS, MESHES, ROBOTS, STORED, meshes_of, outside

needs_meshes = pytest.mark.skipif(
    not MESHES.is_dir(), reason="the meshes of ../shared/data are not there"
)
MEDIAN_MM, PERCENTILE_95_MM = 8.0, 20.0
HOME = np.array([0.0, -1.2, 0.9, 0.0, -1.57, 0.0])


@needs_meshes
@pytest.mark.parametrize("name", ROBOTS)
def test_every_triangle_is_in_one_body(name: str) -> None:
    robot = load_robot(name)
    stored = json.loads(STORED.read_text())[name]["links"]
    for link, faces in enumerate(meshes_of(robot)):
        bodies = [body for body in robot.bodies if body.link == link]
        assert 1 <= len(bodies) <= 3
        assert stored[LINKS[link]]["triangles"] == len(faces)
        # A part of them here; all of them where the script is run.
        some = faces[:: max(1, len(faces) // 60)]
        assert outside(some, bodies) == 0


@pytest.mark.parametrize("name", ROBOTS)
def test_what_is_stored_of_the_bodies_is_what_was_asked_for(name: str) -> None:
    stored = json.loads(STORED.read_text())[name]
    assert stored["median_mm"] <= MEDIAN_MM
    assert stored["percentile_95_mm"] <= PERCENTILE_95_MM
    robot = load_robot(name)
    for link, item in enumerate(stored["links"].values()):
        bodies = [body for body in robot.bodies if body.link == link]
        assert item["outside"] == 0
        assert item["bodies"] == len(bodies)
        assert item["points"] == sum(len(body.points) for body in bodies)


@needs_meshes
def test_a_body_that_is_too_thin_is_found_out() -> None:
    robot = load_robot("ur5")
    faces = meshes_of(robot)[1]
    (body,) = [body for body in robot.bodies if body.link == 1]
    thinner = type(body)(name="", link=1, points=body.points, radius=body.radius - 0.001)
    assert outside(faces, [thinner]) > 0


@needs_meshes
@pytest.mark.parametrize("name", ROBOTS)
def test_the_oracle_stands_where_our_robot_stands(name: str) -> None:
    robot, oracle = load_robot(name), Oracle(name)
    for q in np.random.default_rng(0).uniform(-3, 3, (3, 6)):
        pin.forwardKinematics(oracle.model, oracle.data, q)
        last = oracle.data.oMi[6].homogeneous
        flange = joint_poses(robot, q)[-1] @ robot.flange
        np.testing.assert_allclose(flange[:3, 3], last[:3, 3], atol=1e-7)
        np.testing.assert_allclose(flange[:3, 2], last[:3, 2], atol=1e-7)


@needs_meshes
@pytest.mark.parametrize(
    "name", ["ur3e", *(pytest.param(name, marks=pytest.mark.long) for name in ("ur5", "ur16e"))]
)
def test_no_pose_with_touching_meshes_passes(name: str) -> None:
    oracle, judge = Oracle(name), safe_constraints(load_robot(name))
    rest = np.zeros((1, 6))
    touching = free = 0
    for q in np.random.default_rng(1).uniform(-np.pi, np.pi, (120, 6)):
        passes = judge.holds(q[None], rest, rest)
        if oracle.meets(q[None])[0]:
            touching += 1
            assert not passes
        else:
            free += passes
    assert touching > 15
    assert free > 30


@needs_meshes
def test_no_motion_passes_that_the_oracle_refuses() -> None:
    robot, scene = load_robot("ur5"), SCENES[2]
    judge = safe_constraints(robot, scene_from_json(JsonFields(scene)))
    oracle, verdicts = Oracle("ur5", scene), set()
    for size in (0.02, 0.15, 0.9):
        drawn = random_excitation(robot.limits, seed=3, margin=0.9, offset=HOME)
        motion = FourierSeries(period=drawn.period, offset=HOME, a=drawn.a * size, b=drawn.b * size)
        certificate = certify(motion, judge)
        found = oracle.broken(motion.sample(25), robot, 0.0)
        assert not (certificate.feasible and found)
        verdicts.add((certificate.feasible, bool(found)))
    assert {(True, False), (False, True)} <= verdicts
