"""Intervals under noise that is part slow, part white, and of consistent bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_robot import oracle, recording, ur5
from scipy.signal import lfilter

from dynid import identify
from dynid.core import Array
from dynid.identification import (
    IdentificationProblem,
    estimator_of,
    hac_covariance,
)
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.signals import ProcessingSettings, process
from dynid.workflow import IdentifySettings

pytestmark = pytest.mark.usefixtures("undiagnosed")

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
        fit = estimator_of("ols").fit(problem)
        std = np.sqrt(np.diag(hac_covariance(fit, problem)))
        # The truth is zero: what is left is noise alone.
        hits.append(np.abs(fit.values) < 1.96 * std)
    assert 0.92 <= np.mean(hits) <= 0.995


def test_deviations_of_robust_fits_allow_for_correlated_noise() -> None:
    base = reduce_model(InverseDynamicModel(robot=ur5()))
    samples = process(recording(3), ur5(), ProcessingSettings(cutoff_hz=8.0))
    scores: list[Array] = []
    for seed in SEEDS[:4]:
        noise = _noise(seed, samples.count, 0.93, 0.0)
        problem = IdentificationProblem(base=base, samples=replace(samples, tau=noise))
        fit = estimator_of("irls").fit(problem)
        scores.append(fit.values / np.sqrt(np.diag(hac_covariance(fit, problem))))
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.25


def test_intervals_of_consistent_bodies_hold_the_truth() -> None:
    pytest.importorskip("clarabel")
    settings = IdentifySettings(preset="paper", estimator="sdp")
    scores: list[Array] = []
    for seed in (0, 1):
        estimate = identify([recording(seed)], ur5(), settings).estimate
        base, standard = reduce_model(estimate.model), estimate.standard
        assert standard is not None
        scores.append((estimate.values - base.from_standard(oracle()[1])) / estimate.std)
        # Torques of the same bodies: where the data say nothing, the prior's errors remain.
        assert (standard.std[:60] > 0).all()
    away = np.concatenate(scores)
    assert (np.abs(away) < 1.96).mean() > 0.88
    assert 0.5 < np.sqrt(np.mean(np.square(away))) < 2.5
