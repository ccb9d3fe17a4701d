"""Choices are scored with friction and motor inertia that can exist."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_robot import ur5
from scipy.optimize import nnls

from dynid.identification.bayesian import not_negative
from dynid.identification.candidates import WIDTHS, CandidateColumns
from dynid.identification.crossvalidation import Candidates, Variant, signed_solutions
from dynid.regressor import InverseDynamicModel

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


def test_a_choice_that_needs_negative_friction_gains_nothing() -> None:
    generator = np.random.default_rng(1)
    rows = generator.normal(size=(8, 3, 50))
    # The second column would explain the torque with the wrong sign.
    rows[:, 2] = 2.0 * rows[:, 0] - 1.5 * rows[:, 1]
    products = np.einsum("kam,kbm->kab", rows, rows)[None]
    alone = Variant(columns=(), torque=0)
    both = Variant(columns=(0,), torque=0)
    errors = {}
    for signed in (True, False):
        candidates = Candidates(
            products=products,
            shared=1,
            torques=2,
            samples=400,
            positive=np.array([False, signed]),
        )
        errors[signed] = [
            float(candidates.score((variant,), np.ones(1))[0][0]) for variant in (alone, both)
        ]
    assert errors[True][1] == pytest.approx(errors[True][0], rel=1e-6)
    assert errors[False][1] < 0.01 * errors[False][0]


def test_the_columns_that_a_joint_may_take_know_their_signs() -> None:
    columns = CandidateColumns(
        stepped=(("fc", None),), extras=("fo", "fca", "fr", "fl"), stribeck_velocity=0.1
    )
    width = len(WIDTHS)
    expected = [True] * width + [False, False, True] + [True] * width
    assert columns.positive.tolist() == expected
    assert columns.values(np.linspace(-1, 1, 20), np.ones(20), np.ones((0, 20))).shape == (
        len(expected),
        20,
    )
    assert columns.places(0, 2, frozenset({1, 3})) == (2, width + 1, width + 3 + 2)
