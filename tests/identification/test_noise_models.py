"""Intervals under noise that is part slow, part white, and of solutions that a prior has moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_robot import recording, ur5
from scipy.signal import lfilter

from dynid import identify
from dynid.core import Array
from dynid.identification import (
    IdentificationProblem,
    OrdinaryLeastSquares,
    WeightedLeastSquares,
    hac_covariance,
    moved_by_prior,
)
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.signals import ProcessingSettings, process
from dynid.workflow import IdentifySettings

SEEDS = range(14)


def _noise(seed: int, rows: int, correlation: float, white: float) -> Array:
    generator = np.random.default_rng(seed)
    drive = generator.normal(size=(rows + 1000, 6))
    slow = lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], drive, axis=0)[1000:]
    return np.sqrt(1 - white) * slow + np.sqrt(white) * generator.normal(size=(rows, 6))


@pytest.mark.parametrize(
    ("correlation", "white"),
    [
        pytest.param(0.93, 0.0, marks=pytest.mark.long),
        pytest.param(0.93, 0.3, marks=pytest.mark.long),
        pytest.param(0.96, 0.6, marks=pytest.mark.long),
        (0.0, 1.0),
    ],
)
def test_intervals_cover_whatever_the_colour_of_the_noise(correlation: float, white: float) -> None:
    base = reduce_model(InverseDynamicModel(robot=ur5()))
    samples = process(recording(3), ur5(), ProcessingSettings(cutoff_hz=8.0))
    hits: list[Array] = []
    for seed in SEEDS:
        noise = _noise(seed, samples.count, correlation, white)
        problem = IdentificationProblem(base=base, samples=replace(samples, tau=noise))
        fit = OrdinaryLeastSquares().fit(problem)
        std = np.sqrt(np.diag(hac_covariance(fit, problem)))
        # The truth is zero: what is left is noise alone.
        hits.append(np.abs(fit.values) < 1.96 * std)
    assert 0.92 <= np.mean(hits) <= 0.995


def test_what_a_prior_moved_is_found_from_the_normal_equations() -> None:
    base = reduce_model(InverseDynamicModel(robot=ur5()))
    samples = process(recording(3), ur5(), ProcessingSettings(cutoff_hz=8.0))
    problem = IdentificationProblem(base=base, samples=samples)
    fit = WeightedLeastSquares().fit(problem)
    std = np.sqrt(np.diag(hac_covariance(fit, problem)))
    np.testing.assert_allclose(moved_by_prior(fit, problem) / std, 0.0, atol=1e-6)
    moved = np.random.default_rng(0).normal(size=base.rank) * std
    found = moved_by_prior(replace(fit, values=fit.values + moved), problem)
    np.testing.assert_allclose(found / std, moved / std, atol=1e-6)


def test_intervals_of_consistent_bodies_reach_what_the_data_alone_say() -> None:
    pytest.importorskip("clarabel")
    record = recording(0)
    plain, consistent = (
        identify([record], ur5(), IdentifySettings(preset="paper", estimator=name)).estimate
        for name in ("wls", "sdp")
    )
    apart = np.abs(consistent.values - plain.values)
    assert (apart > 1.5 * plain.std).any()
    # The deviations of the same motion and noise, and what the prior moved.
    expected = np.hypot(plain.std, apart)
    assert (consistent.std > 0.9 * expected).all()
