from __future__ import annotations

from collections.abc import Callable

import numpy as np
from design_arms import Floats, problem
from scipy.optimize import minimize

from dynid.excitation import MotionRegion, random_numbers, region_of
from dynid.excitation.gradient import Descent, Objective, descend

CLOSE = 2e-3
"""What the barrier of the smallest weight keeps from the true optimum, of the start's distance."""


def bowl(target: Floats, curved: Floats) -> Objective:
    def objective(x: Floats) -> tuple[float, Callable[[], Floats]]:
        away = (x - target).ravel()
        return float(away @ curved @ away) / 2, lambda: (curved @ away).reshape(x.shape)

    return objective


def solved(region: MotionRegion, target: Floats, curved: Floats, start: Floats) -> Floats:
    state = Descent(x=start)
    for weight in (1e-2, 1e-4, 1e-6, 1e-8):
        descend(
            bowl(target, curved), region, state,
            weight=weight, iterations=200, tolerance=1e-13, stop=lambda: False,
        )  # fmt: skip
    return state.x


def test_finds_the_optimum_of_a_quadratic_inside_the_bounds() -> None:
    region = region_of(problem())
    random = np.random.default_rng(0)
    start = random_numbers(region, 1, random, fill=0.5)[0]
    half = random.normal(size=(start.size, start.size))
    curved = half @ half.T + np.eye(start.size)
    target = random_numbers(region, 1, random, fill=0.6)[0]
    np.testing.assert_allclose(solved(region, target, curved, start), target, atol=1e-4)


def test_stops_at_the_bounds_where_the_optimum_lies_outside() -> None:
    region = region_of(problem())
    random = np.random.default_rng(1)
    start = random_numbers(region, 1, random, fill=0.5)[0]
    target = 2.5 * random_numbers(region, 1, random, fill=1.0)[0]
    curved = np.eye(start.size)
    found = solved(region, target, curved, start)
    assert (region.slack(found) > 0).all()
    objective = bowl(target, curved)
    # The true optimum, by another solver.
    oracle = minimize(
        lambda flat: objective(flat.reshape(start.shape))[0],
        start.ravel(),
        jac=lambda flat: objective(flat.reshape(start.shape))[1]().ravel(),
        constraints={
            "type": "ineq",
            "fun": lambda flat: region.slack(flat.reshape(start.shape)).ravel(),
        },
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert oracle.success
    gained = objective(start)[0] - oracle.fun
    assert objective(found)[0] - oracle.fun < CLOSE * gained


def test_fixed_offsets_do_not_move() -> None:
    pose = np.array([0.5, -0.5, 1.0])
    region = region_of(problem(family="modified-fourier", start_pose=pose))
    random = np.random.default_rng(2)
    start = random_numbers(region, 1, random, fill=0.5)[0]
    target = start + 0.01 * random.normal(size=start.shape)
    found = solved(region, target, np.eye(start.size), start)
    np.testing.assert_array_equal(found[:, 0], pose)
    np.testing.assert_allclose(found[:, 1:], target[:, 1:], atol=1e-5)


def test_stops_when_told_and_never_gets_worse() -> None:
    region = region_of(problem())
    start = random_numbers(region, 1, np.random.default_rng(0), fill=0.5)[0]
    target, curved = np.zeros_like(start), np.eye(start.size)
    asked: list[int] = []

    def stop() -> bool:
        asked.append(1)
        return len(asked) > 3

    state = Descent(x=start)
    descend(
        bowl(target, curved), region, state, weight=1e-6, iterations=50, tolerance=0.0, stop=stop
    )
    assert len(asked) == 4
    assert bowl(target, curved)(state.x)[0] <= bowl(target, curved)(start)[0]


def evaluations(target: Floats, start: Floats, curved: Floats) -> int:
    """How many it takes to a millionth of what there is to gain."""
    seen: list[float] = []

    def objective(x: Floats) -> tuple[float, Callable[[], Floats]]:
        found = bowl(target, curved)(x)
        seen.append(found[0])
        return found

    descend(
        objective, region_of(problem()), Descent(x=start), weight=1e-12, iterations=50,
        tolerance=0.0, stop=lambda: seen[-1] < 1e-6 * seen[0],
    )  # fmt: skip
    return len(seen)


def test_the_first_step_tells_the_scale_of_the_curvature() -> None:
    """Without it every other direction has to be learnt: 19 evaluations."""
    random = np.random.default_rng(3)
    start, target = random_numbers(region_of(problem()), 2, random, fill=0.3)
    assert evaluations(target, start, np.diag(np.linspace(50, 60, start.size))) <= 5


def test_a_step_that_is_too_long_ends_in_the_least_along_it() -> None:
    """A quadratic has it on a parabola: the start, one step too long, the optimum."""
    random = np.random.default_rng(4)
    start = random_numbers(region_of(problem()), 1, random, fill=0.3)[0]
    target = start + 0.005 * random.normal(size=start.shape)
    assert evaluations(target, start, 5 * np.eye(start.size)) == 3
