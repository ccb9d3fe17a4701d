"""Motions that grow out of free poses, and refusals where no pose is free."""

import re
from dataclasses import replace

import numpy as np
import pytest
from design_arms import arm, leaning, problem

from dynid.constraints import MotionConstraints, safe_constraints, scene_from_json
from dynid.core import InputError, JsonFields
from dynid.excitation import (
    Candidate,
    DesignEvaluation,
    ExcitationProblem,
    Search,
    check_room,
    random_numbers,
    region_of,
)
from dynid.excitation.gradient import judged, one_start
from dynid.excitation.optimise import finish
from dynid.excitation.region import free_poses, grown_motion
from dynid.robot import load_robot

LOW = {
    "shapes": [
        {"type": "wall", "point": [0, 0, 0.35], "normal": [0, 0, -1]},
        {"type": "floor", "height": 0.0},
    ]
}
"""Between a floor and a ceiling 35 cm above it about one pose in two hundred is free."""


def crouching() -> ExcitationProblem:
    robot = load_robot("ur5")
    asked = problem(robot, rate_hz=25.0, safe=True)
    judge = safe_constraints(robot, scene_from_json(JsonFields(LOW)))
    return replace(asked, constraints=judge)


def test_where_no_random_motion_is_free_one_grows_out_of_a_free_pose() -> None:
    asked = crouching()
    evaluation, region = DesignEvaluation(asked), region_of(asked)
    random = np.random.default_rng(0)
    drawn = [judged(evaluation, random_numbers(region, 1, random, fill=0.3)[0]) for _ in range(20)]
    assert min(candidate.violation for candidate in drawn) > 0
    seen: list[Candidate] = []
    best = one_start(evaluation, region, seed=0, number=1, stop=lambda: False, found=seen.append)
    assert best is not None
    # The first is the motion that grew; descending from it makes it better and keeps it free.
    assert seen[0].violation == 0.0
    search = Search(problem=asked)
    search.add(best, 0)
    found = finish(search, evaluation, region, stop=lambda: True)
    assert found.certificate.feasible
    assert found.repair == ""
    assert best.objective < seen[0].objective
    assert np.ptp(found.trajectory.evaluate(asked.times).q, axis=0).min() > 1e-2


def test_a_given_start_pose_is_the_only_one_that_is_tried() -> None:
    pose = np.array([0.5, -0.5, 1.0])
    asked = problem(arm(), family="modified-fourier", start_pose=pose, safe=True)
    found = free_poses(
        DesignEvaluation(asked).constraints, region_of(asked), np.random.default_rng(0)
    )
    np.testing.assert_array_equal(found, [pose])


@pytest.mark.parametrize("seed", range(3))
def test_a_grown_motion_keeps_every_limit_and_is_no_smaller_than_it_must_be(seed: int) -> None:
    asked = problem(arm(), safe=True)
    evaluation, region = DesignEvaluation(asked), region_of(asked)
    random = np.random.default_rng(seed)
    poses = free_poses(evaluation.constraints, region, random)
    x = grown_motion(evaluation, region, poses[0], random, fill=0.9)
    assert x is not None
    np.testing.assert_array_equal(x[:, 0], poses[0])
    assert evaluation.search_violation(x, 0.0) == 0.0
    larger = x.copy()
    larger[:, 1:] /= 0.7
    outside = bool((region.slack(larger) <= 0).any())
    assert outside or evaluation.search_violation(larger, 0.0) > 0.0


def refused(judge: MotionConstraints, asked: ExcitationProblem) -> str:
    with pytest.raises(InputError) as caught:
        check_room(judge, region_of(asked))
    return str(caught.value)


def test_an_arm_that_cannot_hold_itself_is_refused_at_once() -> None:
    weak = leaning(torque=0.5)
    message = refused(safe_constraints(weak), problem(weak, safe=True))
    assert "no free pose of the arm was found: torque" in message
    assert "Check the torque limits, the masses and the payload" in message
    check_room(safe_constraints(arm()), region_of(problem(arm(), safe=True)))


def test_a_clearance_that_the_arm_never_has_is_named() -> None:
    """Only the scene was doubted, where there is none."""
    robot = load_robot("ur5")
    message = refused(safe_constraints(robot, clearance=0.03), problem(robot, safe=True))
    assert message.startswith("upperarm 3 - mounting plane: no free pose")
    assert message.endswith("clearance.")


def test_a_scene_without_room_is_refused_with_the_bodies_that_meet() -> None:
    sides = [
        {"type": "wall", "point": [0.17 * x, 0.17 * y, 0], "normal": [-x, -y, 0]}
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    lid = {"type": "wall", "point": [0, 0, 0.6], "normal": [0, 0, -1]}
    cell = scene_from_json(JsonFields({"shapes": [*sides, lid]}))
    judge = safe_constraints(load_robot("ur5"), cell)
    asked = problem(load_robot("ur5"), safe=True)
    message = refused(judge, asked)
    # Folded up as far as it can be, the arm meets itself about as much as the walls.
    assert re.search("was found: (environment|self collision)", message)
    assert "m at best; allowed: 0.01 m" in message
    check_room(
        safe_constraints(load_robot("ur5"), scene_from_json(JsonFields(LOW))), region_of(asked)
    )
