"""Choices are scored with friction and motor inertia that can exist."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from known_robot import ur5
from scipy.optimize import nnls

from dynid.identification.crossvalidation import signed_solutions
from dynid.identification.plausible_signs import not_negative
from dynid.regressor.model import InverseDynamicModel

SAME = 1e-6
NEAR = 1.25
"""What holding unknowns for good may cost against the constrained minimum."""


def test_friction_and_motor_inertia_only() -> None:
    model = InverseDynamicModel(robot=ur5())
    signed = {name for name, yes in zip(model.names, not_negative(model), strict=True) if yes}
    assert signed == {f"{symbol}{j}" for symbol in ("Fc", "Fv", "Im") for j in range(1, 7)}


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_close_to_the_constrained_minimum(seed: int) -> None:
    generator = np.random.default_rng(seed)
    matrix = generator.normal(size=(40, 6))
    matrix /= np.linalg.norm(matrix, axis=0)
    target = generator.normal(size=40)
    all_signed = np.ones(6, dtype=bool)
    found = signed_solutions((matrix.T @ matrix)[None], (matrix.T @ target)[None], all_signed)[0]
    assert found.min() > -SAME
    _, least = nnls(matrix, target)
    assert least <= np.linalg.norm(matrix @ found - target) * (1 + SAME)
    assert np.linalg.norm(matrix @ found - target) <= NEAR * least


def test_free_unknowns_stay_free() -> None:
    generator = np.random.default_rng(0)
    matrix = generator.normal(size=(40, 5))
    truth = np.array([1.0, -2.0, 3.0, -4.0, 5.0])
    normal, right = matrix.T @ matrix, matrix.T @ matrix @ truth
    positive = np.array([True, False, True, False, True])
    found = signed_solutions(np.stack([normal] * 2), np.stack([right] * 2), positive)
    np.testing.assert_allclose(found, [truth, truth], rtol=0, atol=SAME)
