from __future__ import annotations

import numpy as np
import pytest
from design_arms import Floats

from dynid.excitation import CRITERIA, parse_criterion
from dynid.excitation.criteria import smoothed

EXTREME = ("cond", "e-opt", "cond+sigma")
SLOPE = 1e-6


def gram(seed: int, size: int = 7) -> Floats:
    random = np.random.default_rng(seed)
    w = random.normal(size=(40, size)) * 10.0 ** random.uniform(-1, 1, size)
    return w.T @ w


@pytest.mark.parametrize("name", EXTREME)
@pytest.mark.parametrize("seed", range(3))
def test_smooth_criteria_bound_the_true_one_and_meet_it(name: str, seed: int) -> None:
    criterion, matrix = parse_criterion(name), gram(seed)
    true = criterion.value(matrix)
    values = [smoothed(criterion, p).value(matrix) for p in (1.0, 4.0, 32.0, 4000.0)]
    assert all(value >= true * (1 - 1e-12) for value in values)
    assert values == sorted(values, reverse=True)
    assert values[-1] == pytest.approx(true, rel=2e-3)


@pytest.mark.parametrize("name", EXTREME)
@pytest.mark.parametrize("scaled", [False, True])
def test_slopes_are_those_of_the_value(name: str, scaled: bool) -> None:
    matrix = gram(4)
    previous = gram(5)
    scale = np.linspace(0.5, 2.0, len(matrix)) if scaled else None
    criterion = smoothed(parse_criterion(name, scale=scale, previous=previous), 3.0)
    value, slope = criterion.value_and_gradient(matrix)
    random = np.random.default_rng(0)
    for _ in range(5):
        way = random.normal(size=matrix.shape)
        way = 1e-6 * (way + way.T)
        change = criterion.value(matrix + way) - criterion.value(matrix - way)
        assert np.sum(slope * way) * 2 == pytest.approx(change, rel=SLOPE * 100, abs=1e-12 * value)


def test_the_slope_exists_where_eigenvalues_meet() -> None:
    # The identity is the worst kink of the condition number; its relative is smooth there.
    value, slope = smoothed(parse_criterion("cond"), 5.0).value_and_gradient(np.eye(4))
    assert np.isfinite(value)
    np.testing.assert_allclose(slope, 0.0, atol=1e-12)


@pytest.mark.parametrize("name", sorted(set(CRITERIA) - set(EXTREME)))
def test_criteria_that_are_smooth_stay_as_they_are(name: str) -> None:
    criterion = parse_criterion(name)
    assert smoothed(criterion, 3.0) is criterion
