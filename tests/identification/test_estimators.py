from dataclasses import replace

import numpy as np
import pytest
from known_robot import NOISE, recording, ur5
from scipy.signal import lfilter

from dynid.core import InputError, JobError
from dynid.identification import (
    IdentificationProblem,
    WeightedLeastSquares,
    autocorrelation,
    essential_parameters,
    estimator_of,
    hac_covariance,
    long_run_covariance,
    naive_covariance,
)
from dynid.identification.problem import block_mean
from dynid.identification.statistics import correlation_lag
from dynid.recording import ExperimentRecord
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.signals import ProcessingSettings, Samples, process

SOLVER = 1e-8
"""Two solvers of the same well-conditioned problem, relative to the standard deviation."""
SAME_WEIGHTS = 1e-3
"""Weights that were settled from another start."""


def problem_of(samples: Samples) -> IdentificationProblem:
    return IdentificationProblem(
        base=reduce_model(InverseDynamicModel(robot=ur5())), samples=samples
    )


@pytest.fixture(scope="module")
def problem() -> IdentificationProblem:
    return problem_of(process(recording(0), ur5(), ProcessingSettings(cutoff_hz=15.0)))


def dense(problem: IdentificationProblem) -> tuple[np.ndarray, np.ndarray]:
    samples, model = problem.samples, problem.base.model
    w = model.observation_matrix(samples.q, samples.dq, samples.ddq)
    return w[:, list(problem.base.independent)], samples.tau.T.ravel()


def test_ols_is_numpys_least_squares(problem: IdentificationProblem) -> None:
    w, y = dense(problem)
    reference = np.linalg.lstsq(w, y, rcond=None)[0]
    fit = estimator_of("ols").fit(problem)
    deviation = np.sqrt(np.diag(naive_covariance(fit)))
    assert (np.abs(fit.values - reference) / deviation).max() < SOLVER
    residual = y - w @ reference
    variance = residual @ residual / (len(y) - w.shape[1])
    classical = np.sqrt(variance * np.diag(np.linalg.inv(w.T @ w)))
    np.testing.assert_allclose(deviation, classical, rtol=1e-6, atol=0)


def test_wls_solves_the_weighted_equations_at_its_own_noise(
    problem: IdentificationProblem,
) -> None:
    w, y = dense(problem)
    fit = WeightedLeastSquares().fit(problem)
    rows = np.repeat(1 / fit.noise, problem.samples.count)
    reference = np.linalg.lstsq(w * rows[:, None], y * rows, rcond=None)[0]
    deviation = np.sqrt(np.diag(naive_covariance(fit)))
    assert (np.abs(fit.values - reference) / deviation).max() < 1e-3
    np.testing.assert_allclose(fit.noise, NOISE, rtol=0.08, atol=0)


def test_joints_of_one_group_share_one_weight(problem: IdentificationProblem) -> None:
    fit = WeightedLeastSquares(groups=(0, 0, 0, 1, 1, 1)).fit(problem)
    assert len(np.unique(fit.weights)) == 2
    with pytest.raises(InputError, match="one group a joint"):
        WeightedLeastSquares(groups=(0, 1)).fit(problem)


def test_one_group_is_ordinary_least_squares(problem: IdentificationProblem) -> None:
    grouped = WeightedLeastSquares(groups=(0,) * 6).fit(problem)
    plain = estimator_of("ols").fit(problem)
    deviation = np.sqrt(np.diag(naive_covariance(plain)))
    assert (np.abs(grouped.values - plain.values) / deviation).max() < SOLVER


def test_huber_withstands_collisions_that_break_least_squares() -> None:
    clean = recording(0)
    effort = clean.signals["effort"].copy()
    generator = np.random.default_rng(1)
    effort[generator.choice(len(effort), 60, replace=False)] += 80.0
    broken = ExperimentRecord(t=clean.t, signals={"q": clean.signals["q"], "effort": effort})
    settings = ProcessingSettings(cutoff_hz=15.0)
    reference = WeightedLeastSquares().fit(problem_of(process(clean, ur5(), settings)))
    hurt = problem_of(process(broken, ur5(), settings))
    deviation = np.sqrt(np.diag(naive_covariance(reference)))

    def distance(values: np.ndarray) -> float:
        return float(np.median(np.abs(values - reference.values) / deviation))

    huber = estimator_of("irls").fit(hurt)
    assert distance(huber.values) < 0.35 * distance(WeightedLeastSquares().fit(hurt).values)
    assert huber.row_weights is not None
    assert huber.row_weights.min() < 0.2


def test_blocks_average_columns_and_torques_alike(problem: IdentificationProblem) -> None:
    from dataclasses import replace

    thin = replace(problem, samples=replace(problem.samples, block=3))
    assert thin.blocks == problem.samples.count // 3
    fine, coarse = estimator_of("ols").fit(problem), estimator_of("ols").fit(thin)
    deviation = np.sqrt(np.diag(hac_covariance(fine, problem)))
    assert np.abs((coarse.values - fine.values) / deviation).max() < 1.0
    values = np.arange(12.0).reshape(2, 6)
    np.testing.assert_array_equal(block_mean(values, 3), [[1.0, 4.0], [7.0, 10.0]])


def test_long_run_covariance_is_the_bartlett_sum() -> None:
    scores = np.random.default_rng(0).normal(size=(3, 50))
    lag = 4
    expected = scores @ scores.T
    for k in range(1, lag + 1):
        gamma = scores[:, k:] @ scores[:, :-k].T
        expected += (1 - k / (lag + 1)) * (gamma + gamma.T)
    np.testing.assert_allclose(long_run_covariance(scores, lag), expected, rtol=1e-10, atol=1e-10)


def test_a_slow_part_below_white_noise_is_summed_to_its_end() -> None:
    """The first autocorrelation alone, 0.48 here, asked for lags that hold two thirds of it."""
    rho, generator = 0.95, np.random.default_rng(0)
    white, drive = generator.normal(size=(2, 100, 2500))
    slow = lfilter([np.sqrt(1 - rho**2)], [1, -rho], drive, axis=1)
    noise = (white + slow) / np.sqrt(2)
    lag = correlation_lag(noise[:6], 125.0, below_white=True)
    variance = np.diag(long_run_covariance(noise, lag)).mean() / noise.shape[1]
    assert 0.8 < variance / (0.5 + 0.5 * (1 + rho) / (1 - rho)) < 1.0


def test_honest_deviations_are_never_below_naive_ones(problem: IdentificationProblem) -> None:
    fit = WeightedLeastSquares().fit(problem)
    honest = np.diag(hac_covariance(fit, problem))
    naive = np.diag(naive_covariance(fit))
    assert (honest >= naive * (1 - 1e-12)).all()
    assert np.median(honest / naive) < 1.5


def test_the_covariance_is_positive(problem: IdentificationProblem) -> None:
    covariance = hac_covariance(estimator_of("ols").fit(problem), problem)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12 * np.trace(covariance)


def test_essential_parameters_are_the_certain_ones(problem: IdentificationProblem) -> None:
    fit = WeightedLeastSquares().fit(problem)
    kept = essential_parameters(fit)
    names = problem.base.names
    assert 10 < len(kept) < 52
    assert {"Fc1", "Fc2", "Fc3", "Fv1", "Fv2"} <= {names[k] for k in kept}
    deviation = np.sqrt(np.diag(naive_covariance(fit)))
    hopeless = np.flatnonzero(deviation > 3 * np.abs(fit.values))
    assert not set(hopeless.tolist()) & set(kept)


def test_autocorrelation_of_a_known_process() -> None:
    wave = np.cos(2 * np.pi * np.arange(1000) / 10)[None]
    for size in (1.0, 1e-3):
        assert autocorrelation(size * wave, 5)[0] == pytest.approx(-1.0, abs=0.01)
    assert autocorrelation(np.zeros((2, 50)), 1).tolist() == [0.0, 0.0]


def test_a_motionless_record_is_a_failed_job() -> None:
    t = np.arange(400) / 125
    still = ExperimentRecord(t=t, signals={"q": np.zeros((400, 6)), "effort": np.ones((400, 6))})
    with pytest.raises(JobError, match="no effect on any torque"):
        estimator_of("ols").fit(problem_of(process(still, ur5())))


def test_repetitions_that_are_copies_have_no_infinite_weights() -> None:
    """The scatter between them is zero, of which the first weights were one over."""
    once = recording(0)
    count = once.samples
    twice = ExperimentRecord(
        t=np.arange(2 * count) / once.rate_hz,
        signals={name: np.tile(once.signals[name], (2, 1)) for name in ("q", "effort")},
    )
    copied = process(twice, ur5(), ProcessingSettings(period_s=count / once.rate_hz))
    assert copied.noise is not None
    assert not copied.noise.any()
    found, usual = (
        WeightedLeastSquares().fit(problem_of(samples))
        for samples in (copied, replace(copied, noise=None))
    )
    assert found.noise == pytest.approx(usual.noise, rel=SAME_WEIGHTS)
