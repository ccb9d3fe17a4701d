from __future__ import annotations

import numpy as np
import pytest
from design_arms import Floats, arm, problem

from dynid.constraints import certify, safe_constraints
from dynid.core import InputError
from dynid.excitation import (
    DesignEvaluation,
    ExcitationProblem,
    parse_criterion,
    random_numbers,
    region_of,
)
from dynid.excitation.criteria import smoothed
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.robot import load_robot
from dynid.trajectory import motion_family

SLOPE = 1e-6
"""Asked: relative to central differences."""


def lively(evaluation: DesignEvaluation, fill: float = 0.95) -> Floats:
    region = region_of(evaluation.problem)
    return random_numbers(region, 1, np.random.default_rng(2), fill=fill)[0]


@pytest.mark.parametrize("family", ["fourier", "modified-fourier", "fourier-quintic", "bspline"])
def test_value_is_the_condition_number_of_the_observation_matrix(family: str) -> None:
    asked = problem(family=family)
    evaluation = DesignEvaluation(asked)
    x = lively(evaluation)
    motion = asked.family.trajectory(x[:, 0], x[:, 1:]).evaluate(np.arange(300) / 50.0)
    w = asked.base.model.observation_matrix(motion.q, motion.dq, motion.ddq)
    cond = np.linalg.cond(w[:, list(asked.base.independent)])
    assert np.exp(evaluation.value(x)) == pytest.approx(cond, rel=1e-8)


@pytest.mark.parametrize("criterion", ["prediction", "cond", "d-opt", "a-opt", "cond+sigma"])
@pytest.mark.parametrize("safe", [False, True])
def test_search_has_the_gradient_of_its_value(criterion: str, safe: bool) -> None:
    evaluation = DesignEvaluation(problem(arm(torque=30.0), criterion=criterion, safe=safe))
    x = lively(evaluation)
    goal = smoothed(evaluation.problem.criterion, 4.0)
    assert evaluation.constrained is safe
    assert (evaluation.search_violation(x, 0.02) > 0) is safe

    def value(numbers: Floats) -> float:
        return evaluation.search(numbers, criterion=goal, penalty=10.0, tighten=0.02)[0]

    gradient = evaluation.search(x, criterion=goal, penalty=10.0, tighten=0.02)[1]()
    random = np.random.default_rng(0)
    for _ in range(4):
        way = random.normal(size=x.shape)
        step = 1e-6
        numeric = (value(x + step * way) - value(x - step * way)) / (2 * step)
        scale = np.linalg.norm(gradient) * np.linalg.norm(way)
        assert np.sum(gradient * way) == pytest.approx(numeric, abs=SLOPE * scale)


def test_evaluations_are_counted() -> None:
    evaluation = DesignEvaluation(problem())
    x = lively(evaluation)
    evaluation.value(x)
    evaluation.search(x, criterion=evaluation.problem.criterion)
    assert evaluation.evaluations == 2


def test_problems_that_make_no_sense_are_refused() -> None:
    with pytest.raises(InputError, match="too few samples"):
        problem(rate_hz=0.5)
    with pytest.raises(InputError, match="does not start at a given pose"):
        problem(start_pose=np.zeros(3))
    with pytest.raises(InputError, match="start_pose has the wrong shape"):
        problem(family="modified-fourier", start_pose=np.zeros(4))


def test_power_of_motions_through_points_is_seen_where_legs_begin_to_cruise() -> None:
    robot = load_robot("ur5")
    asked = ExcitationProblem(
        base=reduce_model(InverseDynamicModel(robot=robot)),
        criterion=parse_criterion("cond"),
        family=motion_family("points", 4.0, 5),
        constraints=safe_constraints(robot, collision=False),
    )
    evaluation, region = DesignEvaluation(asked), region_of(asked)
    for seed in range(3):
        x = random_numbers(region, 1, np.random.default_rng(seed), fill=0.9)[0]
        low, high = 0.0, 1.0
        for _ in range(12):
            x_share = np.array(x)
            x_share[:, 1:] *= (low + high) / 2
            seen = evaluation.violation(x_share) == 0.0
            low, high = ((low + high) / 2, high) if seen else (low, (low + high) / 2)
        x[:, 1:] *= low
        found = certify(asked.family.trajectory(x[:, 0], x[:, 1:]), asked.constraints)
        assert found.worst["power"].room > -0.005
