from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from design_arms import arm, arm_text, leaning, problem

from dynid.excitation import (
    Candidate,
    DesignEvaluation,
    ExcitationProblem,
    Search,
    random_numbers,
    region_of,
)
from dynid.excitation.gradient import judged
from dynid.excitation.optimise import Finished, finish, without_turns
from dynid.robot.robotfile import robot_from_toml


def too_fast(asked: ExcitationProblem, count: int = 1) -> list[Candidate]:
    """Motions that keep the bounds and break something else."""
    evaluation = DesignEvaluation(asked)
    random = np.random.default_rng(0)
    found: list[Candidate] = []
    while len(found) < count:
        x = random_numbers(region_of(asked), 1, random, fill=1.0)[0]
        candidate = judged(evaluation, x)
        if candidate.violation > 0.5:
            found.append(candidate)
    return found


def finished(asked: ExcitationProblem, candidates: list[Candidate], *, stop: bool) -> Finished:
    search = Search(problem=asked)
    for number, candidate in enumerate(candidates):
        search.add(candidate, number)
    return finish(search, DesignEvaluation(asked), region_of(asked), stop=lambda: stop)


def test_a_motion_that_breaks_a_limit_is_improved_until_it_passes() -> None:
    asked = problem(arm(torque=60.0), safe=True)
    found = finished(asked, too_fast(asked), stop=False)
    assert found.repair == "tightened"
    assert found.certificate.holds


def test_a_motion_that_only_seemed_to_pass_is_improved_although_what_follows_is_worth_less() -> (
    None
):
    asked = problem(arm(torque=60.0), safe=True)
    seemed = Candidate(x=too_fast(asked)[0].x, objective=-100.0, violation=0.0)
    found = finished(asked, [seemed], stop=False)
    assert found.repair == "tightened"
    assert found.certificate.holds


def test_without_time_it_is_made_as_small_as_it_must_be() -> None:
    asked = problem(arm(torque=60.0), safe=True)
    (candidate,) = too_fast(asked)
    found = finished(asked, [candidate], stop=True)
    assert found.repair == "smaller"
    assert found.certificate.holds
    ratio = found.x[:, 1:] / candidate.x[:, 1:]
    np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-12)
    # Not smaller than it must be: some limit is nearly used up.
    margins = [m for k, m in found.certificate.margins.items() if m is not None and k != "position"]
    assert min(margins) < 0.1


def test_a_worse_candidate_that_passes_is_taken_before_repairs() -> None:
    asked = problem(arm(torque=60.0), safe=True)
    slow = random_numbers(region_of(asked), 1, np.random.default_rng(3), fill=0.05)[0]
    good = judged(DesignEvaluation(asked), slow)
    assert good.violation == 0.0
    # Seen at too few samples, the fast one passed for feasible.
    fast = Candidate(x=too_fast(asked)[0].x, objective=0.0, violation=0.0)
    found = finished(asked, [fast, good], stop=False)
    assert found.repair == ""
    np.testing.assert_array_equal(found.x, slow)


def test_what_cannot_be_repaired_comes_back_with_its_verdict() -> None:
    # The arm cannot even hold itself.
    asked = problem(leaning(torque=0.5), safe=True)
    found = finished(asked, too_fast(asked), stop=True)
    assert not found.certificate.holds
    assert "torque" in found.certificate.broken


def turning(**asked: object) -> ExcitationProblem:
    """A problem whose two first joints may turn twice."""
    text = arm_text().replace("[-3.0, -2.0,", "[-6.3, -6.3,").replace("[3.0, 2.5,", "[6.3, 6.3,")
    robot = robot_from_toml(text.encode(), Path("turning.toml"))
    return problem(robot, **asked)  # pyright: ignore[reportArgumentType]


def test_whole_turns_are_taken_off_and_nothing_else_changes() -> None:
    asked = turning()
    evaluation = DesignEvaluation(asked)
    x = random_numbers(region_of(asked), 1, np.random.default_rng(2), fill=0.2)[0]
    x[:, 0] = [4.5, -5.0, 1.0]
    moved = without_turns(evaluation, x)
    np.testing.assert_allclose(moved[:, 0] - x[:, 0], [-2 * np.pi, 2 * np.pi, 0.0], atol=1e-12)
    np.testing.assert_array_equal(moved[:, 1:], x[:, 1:])
    assert evaluation.value(moved) == pytest.approx(evaluation.value(x), rel=1e-8)
    # Once is enough, and who asked for a pose gets it.
    np.testing.assert_array_equal(without_turns(evaluation, moved), moved)
    posed = turning(family="modified-fourier", start_pose=np.array([4.5, -5.0, 1.0]))
    held = random_numbers(region_of(posed), 1, np.random.default_rng(2), fill=0.2)[0]
    np.testing.assert_array_equal(without_turns(DesignEvaluation(posed), held), held)


def test_what_keeps_the_bounds_keeps_them_without_turns() -> None:
    asked = turning()
    evaluation, region = DesignEvaluation(asked), region_of(asked)
    bounds = asked.constraints.settings.bounds
    for seed in range(20):
        x = random_numbers(region, 1, np.random.default_rng(seed), fill=1.0)[0]
        moved = without_turns(evaluation, x)
        q = asked.family.trajectory(moved[:, 0], moved[:, 1:]).evaluate(asked.times).q
        assert (q >= bounds.lower).all()
        assert (q <= bounds.upper).all()
        assert (np.abs(q.max(axis=0) + q.min(axis=0)) <= 2 * np.pi + 1e-9).all()


def test_a_joint_that_slides_has_no_turns() -> None:
    robot = arm(sliding=True)
    asked = problem(robot)
    x = random_numbers(region_of(asked), 1, np.random.default_rng(0), fill=0.2)[0]
    x[2, 0] += 20.0
    np.testing.assert_array_equal(without_turns(DesignEvaluation(asked), x)[2], x[2])
