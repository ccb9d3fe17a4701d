"""Estimates of bodies that can exist, against another solver and against the known robot."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_robot import MASSES, oracle, recording, ur5
from scipy.optimize import minimize

from dynid import identify, random_excitation
from dynid.core import JobError, MissingExtraError
from dynid.identification import (
    IdentificationProblem,
    PhysicallyConsistent,
    WeightedLeastSquares,
    inertial_prior,
    read_estimate,
    write_estimate,
)
from dynid.identification.physical import (
    EXCESS,
    ConsistentProblem,
    ConsistentSolution,
    body_constraints,
    largest_weight,
    residual_sum,
    sign_constraints,
    solve_conic,
    standard_fit,
)
from dynid.identification.problem import joint_factors
from dynid.recording import ExperimentRecord
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel, parse_terms
from dynid.robot import (
    from_body,
    from_pseudo_inertia,
    is_physical,
    robot_from_chain,
    to_pseudo_inertia,
)
from dynid.signals import ProcessingSettings, process
from dynid.workflow import Identification, IdentifySettings

pytestmark = pytest.mark.usefixtures("undiagnosed")

SOLVERS_AGREE = 1e-6
"""Two solvers of one convex problem, relative to the parameters."""
POSES = 100_000


def body(generator: np.random.Generator) -> np.ndarray:
    root = generator.normal(size=(4, 6))
    return from_pseudo_inertia(root @ root.T)


def small_problem(seed: int) -> ConsistentProblem:
    generator = np.random.default_rng(seed)
    truth = np.concatenate([body(generator), body(generator), [0.3, -0.2]])
    # Fewer rows than parameters, as in every robot: the prior fills what the data leave open.
    matrix = generator.normal(size=(15, 22))
    return ConsistentProblem(
        matrix=matrix,
        target=matrix @ truth + 0.1 * generator.normal(size=15),
        prior=np.array([body(generator), body(generator)]),
        constraints=np.eye(22)[20:],
        floor=np.zeros(2),
    )


def divergence(problem: ConsistentProblem, parameters: np.ndarray) -> float:
    """The sum of D over the links; infinite outside the bodies that exist."""
    bodies, prior = problem.pseudo_inertias(parameters), to_pseudo_inertia(problem.prior)
    try:
        # Not by the determinant: two negative eigenvalues make a positive one.
        roots = np.linalg.cholesky(bodies)
    except np.linalg.LinAlgError:
        return float("inf")
    size = 2.0 * np.log(np.diagonal(roots, axis1=1, axis2=2)).sum()
    known = np.linalg.slogdet(prior)[1].sum()
    trace = np.trace(np.linalg.solve(prior, bodies), axis1=1, axis2=2).sum()
    return float(trace - size + known - 4.0 * problem.links)


def triangles(free: np.ndarray) -> np.ndarray:
    """(2, 10) parameters of Cholesky factors with exponential diagonals: no cone is left."""
    rows = []
    for part in free[:20].reshape(2, 10):
        root = np.zeros((4, 4))
        root[np.tril_indices(4)] = part
        root[np.diag_indices(4)] = np.exp(np.diag(root))
        rows.append(from_pseudo_inertia(root @ root.T))
    return np.array(rows)


@pytest.mark.parametrize(
    ("seed", "gamma"), [pytest.param(0, 0.1, marks=pytest.mark.long), (1, 1.0)]
)
def test_conic_and_unconstrained_solvers_agree(seed: int, gamma: float) -> None:
    problem = small_problem(seed)

    def parameters(free: np.ndarray) -> np.ndarray:
        return np.concatenate([triangles(free).ravel(), np.square(free[20:])])

    def cost(free: np.ndarray) -> float:
        p = parameters(free)
        return problem.misfit(p) / 2 + gamma * divergence(problem, p)

    found = solve_conic(problem, gamma).values
    roots = np.linalg.cholesky(problem.pseudo_inertias(found))
    roots[:, range(4), range(4)] = np.log(roots[:, range(4), range(4)])
    near = np.concatenate([r[np.tril_indices(4)] for r in roots] + [np.sqrt(np.abs(found[20:]))])
    generator = np.random.default_rng(seed)
    start = near + 0.05 * generator.normal(size=len(near))
    best = minimize(cost, start, method="BFGS", options={"gtol": 1e-9, "maxiter": 4000})
    least = cost(best.x)
    reached = problem.misfit(found) / 2 + gamma * divergence(problem, found)
    # The unconstrained search stops at its finite differences; it must not get below.
    assert reached <= least + SOLVERS_AGREE * abs(least)
    scale = np.abs(found).max()
    np.testing.assert_allclose(parameters(best.x), found, rtol=0, atol=1e-4 * scale)


@pytest.mark.parametrize("seed", range(4))
def test_the_solution_meets_its_optimality_conditions(seed: int) -> None:
    problem, gamma = small_problem(seed), 0.1
    solution = solve_conic(problem, gamma)
    p = solution.values
    basis = to_pseudo_inertia(np.eye(10))
    gradient = problem.matrix.T @ (problem.matrix @ p - problem.target)
    pull = np.linalg.inv(to_pseudo_inertia(problem.prior)) - np.linalg.inv(
        problem.pseudo_inertias(p)
    )
    gradient[:20] += gamma * np.einsum("kab,iba->ik", basis, pull).ravel()
    gradient -= problem.constraints.T @ solution.multipliers
    scale = np.abs(problem.matrix.T @ problem.target).max()
    assert np.abs(gradient).max() < SOLVERS_AGREE * scale
    slack = problem.constraints @ p
    assert slack.min() > -1e-9
    assert np.abs(slack * solution.multipliers).max() < SOLVERS_AGREE


@pytest.mark.parametrize("size", [1e-4, 1e4])
def test_the_solution_does_not_depend_on_the_size_of_friction(size: float) -> None:
    problem = small_problem(2)
    scale = np.ones(22)
    scale[20:] = size
    other = replace(problem, matrix=problem.matrix / scale, constraints=problem.constraints / scale)
    here, there = solve_conic(problem, 0.1), solve_conic(other, 0.1)
    atol = SOLVERS_AGREE * np.abs(here.values).max()
    np.testing.assert_allclose(there.values / scale, here.values, rtol=0, atol=atol)


@pytest.mark.parametrize("size", [1e-8, 1.0, 1e8])
def test_a_bound_that_holds_does_not_make_its_parameter_certain(size: float) -> None:
    plain = small_problem(2)
    scale = np.ones(22)
    scale[20:] = size
    problem = replace(plain, matrix=plain.matrix / scale, constraints=plain.constraints / scale)
    solution = solve_conic(problem, 0.1)
    assert solution.held.tolist() == [True, False]
    fit = standard_fit(problem, 0.1, solution, problem.matrix, np.eye(20))
    # Noise would have moved it as much as the parameter beside it, which is free.
    held, free = np.linalg.norm(fit.gain[20:] / scale[20:, None] * scale, axis=1)
    assert 0.3 < held / free < 3


def test_a_bound_that_rounding_lies_beyond_holds() -> None:
    problem = small_problem(2)
    beyond = solve_conic(problem, 0.1)
    beyond = replace(beyond, multipliers=np.array([1e9, 0.0]))
    beyond.values[20] = -1e-12
    one, other = (
        standard_fit(problem, 0.1, replace(beyond, held=held), problem.matrix, np.eye(20))
        for held in (np.array([True, False]), np.array([False, False]))
    )
    np.testing.assert_array_equal(one.gain, other.gain)


def test_the_divergence_is_zero_at_the_prior_and_infinite_outside() -> None:
    problem = small_problem(0)
    at_prior = np.concatenate([problem.prior.ravel(), np.zeros(2)])
    assert divergence(problem, at_prior) == pytest.approx(0.0, abs=1e-9)
    two_negative = at_prior.copy()
    values, vectors = np.linalg.eigh(to_pseudo_inertia(problem.prior[0]))
    flipped = (vectors * (values * [-1, -1, 1, 1])) @ vectors.T
    two_negative[:10] = from_pseudo_inertia(flipped)
    assert divergence(problem, two_negative) == float("inf")


def test_unpublished_inertias_become_uniform_bodies() -> None:
    robot = ur5()
    prior = inertial_prior(robot, "dh")
    assert all(is_physical(row) for row in prior.parameters)
    np.testing.assert_allclose(prior.parameters[:, 0], MASSES, rtol=1e-12)
    assert any("inertia tensor" in word for word in prior.completed)
    bare = replace(robot, inertias=np.full((6, 10), np.nan))
    guessed = inertial_prior(bare, "dh")
    assert all(is_physical(row) for row in guessed.parameters)
    ratio = guessed.parameters[1:3, 0] / MASSES[1:3]
    # A guess from lengths alone.
    assert ratio.min() > 0.2
    assert ratio.max() < 5
    assert any("mass" in word for word in guessed.completed)


def test_friction_and_motors_must_not_give_energy() -> None:
    model = InverseDynamicModel(robot=ur5(), friction=parse_terms("fc,fv,im,fo,fca:2,fs:3"))
    rows = sign_constraints(model)
    place = {name: k for k, name in enumerate(model.names)}
    p = np.zeros(len(place))
    p[place["Fc2"]], p[place["Fca2"]] = 1.0, 0.5
    p[place["Fo1"]] = -3.0
    assert (rows @ p).min() >= 0
    for name, value in (("Fc1", -0.1), ("Fca2", 1.5), ("Fca2", -1.5), ("Fs3", -0.1), ("Im4", -1)):
        bad = p.copy()
        bad[place[name]] = value
        assert (rows @ bad).min() < 0, name


def test_bodies_stay_near_their_links() -> None:
    model = InverseDynamicModel(robot=ur5())
    rows, floor = body_constraints(model)
    prior = inertial_prior(ur5(), "dh").parameters
    p = np.concatenate([prior.ravel(), np.zeros(18)])
    assert (rows @ p - floor).min() > 0
    for change in (3.5, 0.2):
        wrong = p.copy()
        wrong[10:20] *= change
        assert (rows @ wrong - floor).min() < 0
    away = p.copy()
    away[12] += 2.0 * away[10]
    assert (rows @ away - floor).min() < 0


def test_a_body_may_lie_beside_axes_that_meet_in_one_point() -> None:
    robot = robot_from_chain(placements=np.tile(np.eye(4), (2, 1, 1)), axes=np.eye(3)[[2, 1]])
    published = from_body(1.0, np.zeros(3), 0.01 * np.eye(3))
    robot = replace(robot, inertias=np.tile(published, (2, 1)))
    rows, floor = body_constraints(InverseDynamicModel(robot=robot))
    link = from_body(1.0, np.array([0.05, -0.05, 0.05]), 0.01 * np.eye(3))
    assert (rows @ np.concatenate([link, link, np.zeros(6)]) - floor).min() > 0


@pytest.fixture(scope="module")
def consistent() -> Identification:
    settings = IdentifySettings(preset="paper", estimator="sdp", cutoff_hz=15.0)
    return identify(
        recording(0, seconds=20.0), ur5(), settings, validation=recording(1, seconds=10.0)
    )


@pytest.fixture(scope="module")
def plain() -> Identification:
    settings = IdentifySettings(preset="paper", estimator="wls", cutoff_hz=15.0)
    return identify(
        recording(0, seconds=20.0), ur5(), settings, validation=recording(1, seconds=10.0)
    )


def test_the_estimate_is_consistent_and_near_cad(consistent: Identification) -> None:
    standard = consistent.estimate.standard
    assert standard is not None
    bodies = to_pseudo_inertia(standard.values[:60].reshape(6, 10))
    assert np.linalg.eigvalsh(bodies).min() > 0
    assert standard.values[60:].min() >= -1e-6
    ratio = standard.values[:60:10] / MASSES
    assert ratio.max() < 3
    assert ratio.min() > 1 / 3
    assert "not_physical" not in {notice.code for notice in consistent.warnings}


def test_base_and_standard_parameters_say_the_same(consistent: Identification) -> None:
    estimate = consistent.estimate
    base = reduce_model(estimate.model)
    np.testing.assert_allclose(
        base.from_standard(estimate.standard_parameters()), estimate.values, rtol=0, atol=1e-9
    )


def test_consistency_costs_little(consistent: Identification, plain: Identification) -> None:
    assert consistent.validation is not None
    assert plain.validation is not None
    ours, theirs = (x.validation.metrics.normalized_error for x in (consistent, plain))
    assert ours <= 1.01 * theirs
    samples = process(recording(0, seconds=20.0), ur5(), ProcessingSettings(cutoff_hz=15.0))
    problem = IdentificationProblem(base=reduce_model(consistent.estimate.model), samples=samples)
    factors = joint_factors(problem)
    fit = WeightedLeastSquares().fit(problem)
    least = residual_sum(factors, fit.weights, fit.values)
    reached = residual_sum(factors, fit.weights, consistent.estimate.values)
    assert 1.0 < reached / least < 1.0 + 1.05 * EXCESS


def test_marks_follow_the_structure(consistent: Identification) -> None:
    estimate = consistent.estimate
    standard = estimate.standard
    assert standard is not None
    marks = dict(zip(estimate.model.names, standard.origins, strict=True))
    share = dict(zip(estimate.model.names, standard.prior_share, strict=True))
    unseen = reduce_model(estimate.model).classes
    for k in unseen.unidentifiable:
        name = estimate.model.names[k]
        assert marks[name] == "prior"
        assert share[name] > 0.99
    assert all(marks[f"{symbol}{j}"] == "data" for symbol in ("Fc", "Fv") for j in range(1, 7))


def test_what_the_data_say_holds_the_truth(consistent: Identification) -> None:
    _, truth = oracle()
    estimate = consistent.estimate
    standard = estimate.standard
    assert standard is not None
    friction = slice(60, 72)
    z = (standard.values[friction] - truth[friction]) / standard.std[friction]
    assert np.abs(z).max() < 4


def test_the_mass_matrix_is_positive_everywhere(consistent: Identification) -> None:
    model, p = consistent.estimate.model, consistent.estimate.standard_parameters()
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, size=(POSES, 6))
    assert np.linalg.eigvalsh(model.mass_matrix(q, p)).min() > 0


@pytest.mark.parametrize("seed", [17, 27])
def test_torques_that_no_bodies_have_give_bodies_all_the_same(seed: int) -> None:
    """The solver left its cone by its tolerance, which ended in an error of linear algebra."""
    draw, t = np.random.default_rng(seed), np.arange(1000) / 125.0
    series = random_excitation(ur5().limits, seed=seed, period_s=8.0, harmonics=8)
    motion, model = series.evaluate(t), InverseDynamicModel(robot=ur5())
    random = draw.uniform(0.1, 2.0, len(model.columns))
    torque = model.inverse_dynamics(motion.q, motion.dq, motion.ddq, random)
    noise = np.array([0.02, 0.025, 0.015, 0.004, 0.004, 0.003])
    torque = torque + noise * draw.normal(size=torque.shape)
    record = ExperimentRecord(t=t, signals={"q": motion.q, "qd": motion.dq, "effort": torque})
    samples = process(record, ur5(), ProcessingSettings(cutoff_hz=5.0))
    problem = IdentificationProblem(base=reduce_model(model), samples=samples)
    found = PhysicallyConsistent().fit(problem).standard
    assert found is not None
    bodies = to_pseudo_inertia(found.values[:60].reshape(-1, 10))
    assert (np.linalg.eigvalsh(bodies)[:, 0] > 0).all()


def test_standard_parameters_survive_the_file(consistent: Identification, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_estimate(consistent.estimate, path)
    back = read_estimate(path).standard
    kept = consistent.estimate.standard
    assert back is not None
    assert kept is not None
    for name in ("values", "std", "prior_share", "prior"):
        np.testing.assert_array_equal(getattr(back, name), getattr(kept, name))
    assert back.origins == kept.origins


def test_older_files_have_no_standard_parameters(plain: Identification, tmp_path: Path) -> None:
    path = tmp_path / "old.json"
    write_estimate(plain.estimate, path)
    assert "standard" not in json.loads(path.read_text(encoding="utf-8"))
    assert read_estimate(path).standard is None


def test_a_missing_solver_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "clarabel", None)
    with pytest.raises(MissingExtraError, match=r"clarabel.*dynid\[sdp\]"):
        solve_conic(small_problem(0), 0.1)


def test_a_weight_that_the_solver_does_not_finish_is_too_large(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unfinished(problem: ConsistentProblem, gamma: float) -> ConsistentSolution:
        if gamma > 1e-4:
            raise JobError("no solution")
        return solve_conic(problem, gamma)

    known = small_problem(0)
    # Its residual sum is one, whatever the weight.
    none = {"matrix": np.zeros_like(known.matrix), "target": np.zeros_like(known.target)}
    small = replace(known, **none, least=1.0)
    monkeypatch.setattr("dynid.identification.physical.solve_conic", unfinished)
    found, solution = largest_weight(small)
    assert 10**-4.1 <= found <= 1e-4
    assert np.array_equal(solution.values, solve_conic(small, found).values)


def test_the_prior_is_what_the_robot_file_says() -> None:
    samples = process(recording(0), ur5(), ProcessingSettings(cutoff_hz=15.0))
    heavy = ur5().inertias.copy()
    heavy[0] *= 2.0
    robot = replace(ur5(), inertias=heavy)
    problem = IdentificationProblem(
        base=reduce_model(InverseDynamicModel(robot=robot)), samples=samples
    )
    fit = PhysicallyConsistent().fit(problem)
    assert fit.standard is not None
    # Nothing in the data speaks of the first mass.
    assert fit.standard.values[0] == pytest.approx(2 * MASSES[0], rel=0.02)
