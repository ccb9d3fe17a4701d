"""TLS, IV, ML, DIDIM, Bayesian and recursive estimators against plain formulas and the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_robot import NOISE, oracle, recording, torques, ur5

from dynid import identify
from dynid.identification import (
    ESTIMATORS,
    ClosedLoop,
    IdentificationProblem,
    Likelihood,
    WeightedLeastSquares,
    estimator_of,
    hac_covariance,
    inertial_prior,
    motion_covariance,
    motion_noise,
    naive_covariance,
    posterior,
    published_prior,
    smooth_motion,
    solve_instrumental,
    solve_total,
)
from dynid.identification.problem import base_mapping, joint_factors, observation_root
from dynid.recording import ExperimentRecord
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.robot import from_pseudo_inertia, is_physical, move, to_pseudo_inertia
from dynid.signals import ProcessingSettings, Samples, joined, process
from dynid.trajectory import random_excitation
from dynid.workflow import IdentifySettings

pytestmark = pytest.mark.usefixtures("undiagnosed")

REFERENCE = 1e-6
"""Against another solver of the same equations, relative."""


def problem_of(
    seed: int = 0, cutoff: float = 15.0, seconds: float = 10.0, **noise: float
) -> IdentificationProblem:
    samples = process(
        recording(seed, seconds=seconds, **noise),  # pyright: ignore
        ur5(),
        ProcessingSettings(cutoff_hz=cutoff),
    )
    return IdentificationProblem(
        base=reduce_model(InverseDynamicModel(robot=ur5())), samples=samples
    )


@pytest.fixture(scope="module")
def problem() -> IdentificationProblem:
    return problem_of()


@pytest.fixture(scope="module")
def truth(problem: IdentificationProblem) -> np.ndarray:
    return problem.base.from_standard(oracle()[1])


def dense(problem: IdentificationProblem, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    samples, model = problem.samples, problem.base.model
    w = model.observation_matrix(samples.q, samples.dq, samples.ddq)
    rows = np.repeat(weights, samples.count)
    return w[:, list(problem.base.independent)] * rows[:, None], samples.tau.T.ravel() * rows


def test_total_least_squares_is_the_nearest_consistent_system() -> None:
    generator = np.random.default_rng(0)
    exact = generator.normal(size=(60, 4))
    augmented = np.column_stack([exact, exact @ [1.0, -2.0, 0.5, 3.0]])
    augmented += 0.1 * generator.normal(size=augmented.shape)
    scaled = augmented / np.linalg.norm(augmented, axis=0)
    u, s, vt = np.linalg.svd(scaled, full_matrices=False)
    nearest = (u * [*s[:-1], 0.0]) @ vt * np.linalg.norm(augmented, axis=0)
    found = solve_total(augmented)
    np.testing.assert_allclose(nearest[:, :4] @ found, nearest[:, 4], rtol=0, atol=1e-9)


def test_total_least_squares_on_a_robot(problem: IdentificationProblem) -> None:
    fit = estimator_of("tls").fit(problem)
    a, b = dense(problem, fit.weights)
    np.testing.assert_allclose(
        fit.values,
        solve_total(np.column_stack([a, b])),
        rtol=0,
        atol=1e-6 * np.abs(fit.values).max(),
    )


def test_total_least_squares_is_no_further_off_than_it_says(truth: np.ndarray) -> None:
    held = []
    for seed in range(3):
        problem = problem_of(seed, noise=2.0)
        fit = estimator_of("tls").fit(problem)
        deviation = np.sqrt(np.diag(hac_covariance(fit, problem)))
        held.append(np.abs(fit.values - truth) < 1.96 * deviation)
    assert np.mean(held) > 0.92


def test_recursive_equals_batch(problem: IdentificationProblem) -> None:
    fit = estimator_of("rls").fit(problem)
    a, b = dense(problem, fit.weights)
    reference = np.linalg.lstsq(a, b, rcond=None)[0]
    deviation = np.sqrt(np.diag(naive_covariance(fit)))
    assert (np.abs(fit.values - reference) / deviation).max() < REFERENCE


def test_the_posterior_is_bayes_rule(problem: IdentificationProblem) -> None:
    weights = np.full(6, 0.5)
    prior = published_prior(problem.base)
    factors, mean, root = joint_factors(problem), prior.mean, prior.root / 0.3
    values, information = posterior(factors, weights, problem.base, mean, root)
    a, b = dense(problem, weights)
    precision = root.T @ root
    total = a.T @ a + precision
    scale = 1 / np.sqrt(np.diag(total))
    reference = scale * np.linalg.solve(
        total * np.outer(scale, scale), scale * (a.T @ b + precision @ mean)
    )
    deviation = np.sqrt(np.diag(np.linalg.inv(total)))
    assert (np.abs(values - reference) / deviation).max() < REFERENCE
    np.testing.assert_allclose(
        information.T @ information, total, rtol=1e-8, atol=1e-8 * total.max()
    )


def test_the_prior_has_the_spread_it_says(problem: IdentificationProblem) -> None:
    prior, known = inertial_prior(ur5(), "dh"), published_prior(problem.base)
    mean, free = known.mean, np.linalg.qr(known.free)[0]
    # What friction and motor inertias add is free: as wide as can be.
    covariance = np.linalg.inv(known.root.T @ known.root / 0.2**2 + 1e-9 * free @ free.T)
    # Random bodies near the prior, by their own metric, seen through the base parameters.
    generator = np.random.default_rng(0)
    roots = np.linalg.cholesky(to_pseudo_inertia(prior.parameters))
    draws: list[np.ndarray] = []
    mapping = base_mapping(problem.base)[:, :60]
    for _ in range(4000):
        turn = generator.normal(size=(6, 4, 4))
        turn = np.tril(turn, -1) * np.sqrt(0.5)
        turn = turn + turn.transpose(0, 2, 1)
        turn[:, range(4), range(4)] = generator.normal(size=(6, 4))
        bodies = roots @ (np.eye(4) + 0.2 * turn) @ roots.transpose(0, 2, 1)
        draws.append(mapping @ from_pseudo_inertia(bodies).ravel())
    seen = [k for k, c in enumerate(problem.base.independent) if c < 60]
    spread = np.std(draws, axis=0)[seen]
    expected = np.sqrt(np.diag(covariance))[seen]
    # Motor inertias have a prior of their own: leave out what they are regrouped into.
    alone = ~base_mapping(problem.base)[seen][:, 60:].any(axis=1)
    assert alone.sum() > 25
    np.testing.assert_allclose(spread[alone], expected[alone], rtol=0.06, atol=0)
    off = np.abs(np.mean(draws, axis=0)[seen] - mean[seen])[alone] / expected[alone]
    assert off.max() < 5 / np.sqrt(len(draws))


def in_links(bodies: np.ndarray) -> np.ndarray:
    """Inertias (6, 10) in DH frames in the frames in which a robot has its published ones."""
    return np.array(
        [move(row, x) for row, x in zip(bodies, ur5().parameter_frames["dh"], strict=True)]
    )


@pytest.mark.long
def test_a_bayesian_fit_is_honest(truth: np.ndarray) -> None:
    found: list[np.ndarray] = []
    generator = np.random.default_rng(0)
    roots = np.linalg.cholesky(to_pseudo_inertia(oracle()[1][:60].reshape(6, 10)))
    for seed in range(3):
        # CAD is off by 20 %, the prior says 30 %.
        half = 0.1 * generator.normal(size=(6, 4, 4))
        turn = np.eye(4) + half + half.transpose(0, 2, 1)
        cad = from_pseudo_inertia(roots @ turn @ roots.transpose(0, 2, 1))
        assert all(is_physical(row) for row in cad)
        told = reduce_model(InverseDynamicModel(robot=replace(ur5(), inertias=in_links(cad))))
        problem = replace(problem_of(seed, noise=2.0, correlation=0.8), base=told)
        fit = estimator_of("bayes").fit(problem)
        deviation = np.sqrt(np.diag(hac_covariance(fit, problem)))
        found.append((fit.values - truth) / deviation)
    share = np.mean(np.abs(found) < 1.96)
    assert share > 0.9


@pytest.mark.parametrize("heavier", [1.0, 1000.0])
def test_plausible_bodies_do_not_hold_heavy_ones_back(truth: np.ndarray, heavier: float) -> None:
    unknown = replace(ur5(), inertias=np.full((6, 10), np.nan))
    base, problem = reduce_model(InverseDynamicModel(robot=unknown)), problem_of(1)
    samples = replace(problem.samples, tau=heavier * problem.samples.tau)
    problem = replace(problem, base=base, samples=samples)
    fit = estimator_of("bayes").fit(problem)
    deviation = np.sqrt(np.diag(hac_covariance(fit, problem)))
    assert np.mean(np.abs(fit.values - heavier * truth) < 1.96 * deviation) > 0.85


def test_little_data_leaves_the_prior(problem: IdentificationProblem) -> None:
    prior = published_prior(problem.base)
    factors = joint_factors(problem) * 1e-6
    values, _ = posterior(factors, np.ones(6), problem.base, prior.mean, prior.root / 0.3)
    # Friction and motor inertia have no prior: the data alone speak of them.
    away = prior.root @ (values - prior.mean)
    np.testing.assert_allclose(away, 0.0, atol=1e-6 * np.abs(prior.root @ prior.mean).max())


def test_instruments_solve_their_equations(problem: IdentificationProblem) -> None:
    smooth, _ = smooth_motion(problem.samples)
    weights = np.linspace(0.4, 2.0, 6)
    values, information = solve_instrumental(problem, replace(problem, samples=smooth), weights)
    w, y = dense(problem, weights)
    z, _ = dense(replace(problem, samples=smooth), weights)
    reference = np.linalg.solve(z.T @ w, z.T @ y)
    deviation = np.sqrt(np.diag(np.linalg.inv(w.T @ w)))
    assert (np.abs(values - reference) / deviation).max() < REFERENCE
    expected = w.T @ z @ np.linalg.solve(z.T @ z, z.T @ w)
    np.testing.assert_allclose(
        information.T @ information, expected, rtol=0, atol=1e-6 * np.abs(expected).max()
    )


def test_own_columns_as_instruments_are_least_squares(problem: IdentificationProblem) -> None:
    values, _ = solve_instrumental(problem, problem, np.ones(6))
    plain = estimator_of("ols").fit(problem)
    deviation = np.sqrt(np.diag(naive_covariance(plain)))
    assert (np.abs(values - plain.values) / deviation).max() < REFERENCE


def test_the_simulated_arm_follows_and_obeys_its_own_dynamics() -> None:
    series = random_excitation(ur5().limits, seed=3, period_s=10.0, acceleration=5.5 * np.pi)
    t = np.arange(1250) / 125
    motion = series.evaluate(t)
    samples = process(recording(3, noise=0.0), ur5(), ProcessingSettings(cutoff_hz=40.0))
    reference = replace(
        samples, t=t, q=motion.q, dq=motion.dq, ddq=motion.ddq, tau=torques(series, t),
        unfiltered_q=None,
    )  # fmt: skip
    model = InverseDynamicModel(robot=ur5())
    simulated = ClosedLoop(model=model, parameters=oracle()[1]).simulate(reference)
    assert np.abs(simulated.q - reference.q).max() < 2e-3
    # pinocchio agrees that these torques make these accelerations.
    torque = model.inverse_dynamics(simulated.q, simulated.dq, simulated.ddq, oracle()[1])
    error = torque - torques(series, t)
    assert np.sqrt(np.mean(np.square(error))) < 0.03 * np.sqrt(np.mean(np.square(torque)))


def test_each_of_several_records_is_simulated_as_alone() -> None:
    # They end and begin 3 rad apart.
    parts = [process(recording(seed), ur5(), ProcessingSettings(cutoff_hz=15.0)) for seed in (0, 1)]
    loop = ClosedLoop(model=InverseDynamicModel(robot=ur5()), parameters=oracle()[1])
    together, alone = loop.simulate(joined(parts)), [loop.simulate(part) for part in parts]
    for name in ("q", "dq", "ddq"):
        expected = np.concatenate([getattr(part, name) for part in alone])
        np.testing.assert_allclose(getattr(together, name), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("rates", [(500.0, 125.0), (125.0, 500.0)])
def test_records_of_different_rates_are_simulated_at_one(rates: tuple[float, float]) -> None:
    records = [recording(seed, rate=rate) for seed, rate in enumerate(rates)]
    settings = IdentifySettings(estimator="iv", preset="paper", cutoff_hz=15.0)
    estimate = identify(records, ur5(), settings).estimate
    error = estimate.values - reduce_model(estimate.model).from_standard(oracle()[1])
    assert np.sqrt(np.mean(np.square(error / estimate.std))) < 1.5


def bias(
    problems: list[IdentificationProblem], values: list[np.ndarray], truth: np.ndarray
) -> float:
    """Size in torque of the mean error: what noise in the motion does to every estimate."""
    mean = np.mean(values, axis=0) - truth
    return float(np.linalg.norm(observation_root(problems[0]) @ mean))


def test_noise_in_the_motion_does_not_bias_iv_and_didim(truth: np.ndarray) -> None:
    # Four times the position noise of a good encoder, and a filter that lets it through.
    problems = [problem_of(seed, 50.0, position_noise=1e-4) for seed in range(2)]
    by_ols, by_iv, by_didim = (
        bias(problems, [estimator.fit(p).values for p in problems], truth)
        for estimator in (estimator_of("ols"), estimator_of("iv"), estimator_of("didim"))
    )
    assert by_iv <= by_ols / 3
    assert by_didim <= by_ols / 3


def test_the_noise_of_the_motion_is_seen() -> None:
    level = 1e-4
    samples = problem_of(0, 30.0, position_noise=level).samples
    noise = motion_noise(samples)
    # White noise of 125 samples a second spreads over 62.5 Hz.
    np.testing.assert_allclose(noise, level**2 / 62.5, rtol=0.35)
    covariance = motion_covariance(noise, samples.cutoff_hz)
    assert covariance.shape == (18, 18)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12


def test_the_likelihood_has_its_gradient(problem: IdentificationProblem) -> None:
    noisy = problem_of(0, 30.0, position_noise=5e-5)
    start = WeightedLeastSquares().fit(noisy)
    likelihood = Likelihood.of(noisy, start, slice(None))
    generator = np.random.default_rng(0)
    deviation = np.sqrt(np.diag(naive_covariance(start)))
    for _ in range(3):
        direction = generator.normal(size=len(start.values)) * deviation
        ends = [likelihood.cost(start.values + s * 1e-3 * direction)[0] for s in (1, -1)]
        slope = likelihood.cost(start.values)[1] @ direction
        assert (ends[0] - ends[1]) / 2e-3 == pytest.approx(slope, rel=1e-5, abs=1e-5)


def test_without_noise_in_the_motion_likelihood_is_weighted_least_squares() -> None:
    # A filter so low leaves no room above the motion to see its noise in.
    problem = problem_of(cutoff=6.0)
    assert not motion_noise(problem.samples).any()
    fit = estimator_of("ml").fit(problem)
    start = WeightedLeastSquares().fit(problem)
    a, b = dense(problem, 1 / start.noise)
    reference = np.linalg.lstsq(a, b, rcond=None)[0]
    deviation = np.sqrt(np.diag(naive_covariance(start)))
    assert (np.abs(fit.values - reference) / deviation).max() < 1e-4


def test_likelihood_beats_least_squares_on_noisy_motions(truth: np.ndarray) -> None:
    problems = [problem_of(seed, 50.0, 20.0, position_noise=2e-5) for seed in range(2)]
    by_ols, by_ml = (
        bias(problems, [estimator.fit(p).values for p in problems], truth)
        for estimator in (estimator_of("ols"), estimator_of("ml"))
    )
    assert by_ml < 0.8 * by_ols


def likelihood_scores(samples: Samples, truth: np.ndarray) -> np.ndarray:
    base = reduce_model(InverseDynamicModel(robot=ur5()))
    problem = IdentificationProblem(base=base, samples=samples)
    fit = estimator_of("ml").fit(problem)
    return (fit.values - truth) / np.sqrt(np.diag(hac_covariance(fit, problem)))


def test_likelihood_uses_every_instant_that_its_deviations_count(truth: np.ndarray) -> None:
    settings = ProcessingSettings(cutoff_hz=15.0)
    parts = [process(recording(seed, rate=500.0), ur5(), settings) for seed in (0, 1)]
    scores = [likelihood_scores(part, truth) for part in parts]
    assert np.sqrt(np.mean(np.square(scores))) < 1.5


def test_scatter_between_periods_is_no_error_of_the_model(truth: np.ndarray) -> None:
    settings = ProcessingSettings(cutoff_hz=15.0, period_s=10.0)
    scores: list[np.ndarray] = []
    for seed in (0, 1):
        plain = recording(seed, seconds=30.0)
        left_out = 2.0 * NOISE * np.sin(37.0 * plain.signals["q"])
        signals = {**plain.signals, "effort": plain.signals["effort"] + left_out}
        samples = process(ExperimentRecord(t=plain.t, signals=signals), ur5(), settings)
        scores.append(likelihood_scores(samples, truth))
    assert np.sqrt(np.mean(np.square(scores))) < 1.5


@pytest.mark.parametrize("word", ESTIMATORS)
def test_every_estimator_gives_a_whole_result(word: str) -> None:
    settings = IdentifySettings(preset="paper", estimator=word, cutoff_hz=10.0)
    result = identify(recording(0), ur5(), settings, validation=recording(1))
    assert result.estimate.estimator == word
    assert np.isfinite(result.estimate.std).all()
    assert result.validation is not None
    # Total least squares presumes errors that robots do not have, and shows it.
    assert result.validation.metrics.r2.min() > (0.4 if word == "tls" else 0.9)
