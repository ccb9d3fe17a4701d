"""Several records at once, against the dense problem and against parameters that are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynid.core import Array, InputError, JobError, upper_triangle
from dynid.identification import IdentificationProblem, SharedProblem, fit_shared, payload_of
from dynid.identification.shared import solve_shared
from dynid.reduction import BaseParametrization, reduce_model
from dynid.regressor import InverseDynamicModel, parse_terms
from dynid.robot import is_physical, load_robot
from dynid.signals import Samples

EXACT = 1e-9
"""Elimination against one dense problem, relative."""
RECORDS, JOINTS, OWN, SHARED = 3, 2, 4, 7


def dense_case(seed: int) -> tuple[list[Array], list[Array], Array]:
    """Rows of each record and joint: own columns, shared columns, torque; and weights."""
    generator = np.random.default_rng(seed)
    size = 10.0 ** generator.uniform(-3, 3, size=OWN + SHARED)
    columns = [generator.normal(size=(JOINTS, 40 + 9 * k, OWN + SHARED)) * size for k in range(3)]
    torque = [generator.normal(size=c.shape[:2]) for c in columns]
    return columns, torque, 10.0 ** generator.uniform(-2, 2, size=(RECORDS, JOINTS))


def dense(columns: list[Array], torque: list[Array], weights: Array) -> tuple[Array, Array]:
    """The whole observation matrix, weighted, and its torques."""
    rows, right = [], []
    for k, (c, y) in enumerate(zip(columns, torque, strict=True)):
        for j in range(JOINTS):
            wide = np.zeros((c.shape[1], RECORDS * OWN + SHARED))
            wide[:, k * OWN : (k + 1) * OWN] = c[j, :, :OWN]
            wide[:, RECORDS * OWN :] = c[j, :, OWN:]
            rows.append(weights[k, j] * wide)
            right.append(weights[k, j] * y[j])
    return np.vstack(rows), np.concatenate(right)


@pytest.mark.parametrize("seed", range(5))
def test_elimination_is_the_dense_answer(seed: int) -> None:
    columns, torque, weights = dense_case(seed)
    factors = np.array(
        [
            [upper_triangle(np.column_stack([c[j], y[j]])) for j in range(JOINTS)]
            for c, y in zip(columns, torque, strict=True)
        ]
    )
    found = solve_shared(factors, weights, OWN)
    matrix, right = dense(columns, torque, weights)
    scale = np.linalg.norm(matrix, axis=0)
    expected = np.linalg.lstsq(matrix / scale, right, rcond=None)[0]
    values = np.concatenate([found.own.ravel(), found.shared])
    np.testing.assert_allclose(values * scale, expected, rtol=EXACT, atol=EXACT)
    gram = (matrix / scale).T @ (matrix / scale)
    root = found.information / scale
    np.testing.assert_allclose(root.T @ root, gram, rtol=0, atol=EXACT)


def test_what_no_record_shows_is_refused() -> None:
    columns, torque, weights = dense_case(0)
    factors = np.array(
        [
            [upper_triangle(np.column_stack([c[j], y[j]])) for j in range(JOINTS)]
            for c, y in zip(columns, torque, strict=True)
        ]
    )
    factors[..., OWN] = 0.0
    with pytest.raises(JobError, match="no effect"):
        solve_shared(factors, weights, OWN)
    factors[..., OWN] = factors[..., OWN + 1]
    with pytest.raises(JobError, match="singular"):
        solve_shared(factors, weights, OWN)


@pytest.fixture(scope="module")
def base() -> BaseParametrization:
    return reduce_model(
        InverseDynamicModel(robot=load_robot("ur5"), friction=parse_terms("fc,fv,im"))
    )


def made(
    base: BaseParametrization, noises: tuple[float, ...], frictions: tuple[float, ...], seed: int
) -> tuple[SharedProblem, Array]:
    """Records of random states with known parameters; friction is scaled record by record."""
    generator = np.random.default_rng(seed)
    truth = np.random.default_rng(1).normal(size=base.rank)
    own = SharedProblem(problems=(_record(base, truth, 0.0, generator),)).own
    problems = []
    for noise, friction in zip(noises, frictions, strict=True):
        values = truth.copy()
        values[list(own)] *= friction
        problems.append(_record(base, values, noise, generator))
    return SharedProblem(problems=tuple(problems)), truth


def _record(
    base: BaseParametrization, values: Array, noise: float, generator: np.random.Generator
) -> IdentificationProblem:
    q, dq, ddq = generator.normal(size=(3, 300, 6))
    stack = base.model.stack(q, dq, ddq)[list(base.independent)]
    torque = np.tensordot(values, stack, axes=1).T
    samples = Samples(
        t=np.arange(300) / 100.0,
        q=q,
        dq=dq,
        ddq=ddq,
        tau=torque + noise * generator.normal(size=torque.shape),
        rate_hz=100.0,
        cutoff_hz=10.0,
    )
    return IdentificationProblem(base=base, samples=samples)


def test_friction_is_each_record_s_own(base: BaseParametrization) -> None:
    frictions = (1.0, 0.8, 1.3)
    problem, truth = made(base, (0.0, 0.0, 0.0), frictions, 0)
    names = [base.names[k] for k in problem.own]
    assert names == [f"{f}{j}" for f in ("Fc", "Fv") for j in range(1, 7)]
    found = fit_shared(problem)
    np.testing.assert_allclose(found.solution.shared, truth[list(problem.common)], atol=1e-8)
    for k, friction in enumerate(frictions):
        expected = friction * truth[list(problem.own)]
        np.testing.assert_allclose(found.solution.own[k], expected, atol=1e-8)


def test_unequal_noise_is_weighted_and_deviations_cover(base: BaseParametrization) -> None:
    noises = (0.1, 2.0)
    scores, errors = [], []
    for seed in range(8):
        problem, truth = made(base, noises, (1.0, 0.9), seed)
        found = fit_shared(problem)
        for k, noise in enumerate(noises):
            np.testing.assert_allclose(found.noise[k], noise, rtol=0.25)
        solution = np.concatenate([found.solution.own.ravel(), found.solution.shared])
        np.testing.assert_allclose(found.shares.sum(axis=1), solution, atol=1e-6)
        error = found.solution.shared - truth[list(problem.common)]
        first = 2 * len(problem.own)
        scores.append(error / np.sqrt(np.diag(found.covariance))[first:])
        alone = fit_shared(SharedProblem(problems=problem.problems[1:]))
        worse = alone.solution.shared - truth[list(problem.common)]
        errors.append((np.linalg.norm(error), np.linalg.norm(worse)))
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.2
    together, noisy = np.mean(errors, axis=0)
    assert together < 0.1 * noisy


def test_the_body_of_a_payload_is_the_solution_of_the_fit(base: BaseParametrization) -> None:
    """How sure the fit is must not move it: sums of few residuals would."""
    plain, _ = made(base, (1.0, 1.0), (1.0, 1.0), 0)
    problem = replace(plain, loaded=(False, True))
    fit = fit_shared(problem, one_noise=True)
    found = payload_of(problem, fit)
    assert not is_physical(found.free, 0.0)
    assert is_physical(found.parameters)
    spread = np.linspace(1.0, 5.0, len(fit.covariance))
    unsure = replace(fit, covariance=fit.covariance * np.outer(spread, spread))
    np.testing.assert_allclose(payload_of(problem, unsure).parameters, found.parameters, atol=EXACT)


def test_records_that_do_not_belong_together_are_refused(base: BaseParametrization) -> None:
    other = reduce_model(
        InverseDynamicModel(robot=base.model.robot, friction=parse_terms("fc,fv,im,fo"))
    )
    generator = np.random.default_rng(0)
    a = _record(base, np.zeros(base.rank), 1.0, generator)
    b = _record(other, np.zeros(other.rank), 1.0, generator)
    with pytest.raises(InputError, match="other base parameters"):
        SharedProblem(problems=(a, b))
