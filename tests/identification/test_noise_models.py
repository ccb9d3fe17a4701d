"""Intervals under noise that is part slow, part white, as drives give it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_robot import recording, ur5
from scipy.signal import lfilter

from dynid.core.arrays import Array
from dynid.identification.least_squares import OrdinaryLeastSquares
from dynid.identification.problem import IdentificationProblem
from dynid.identification.statistics import hac_covariance
from dynid.reduction.base import reduce_model
from dynid.regressor.model import InverseDynamicModel
from dynid.signals.process import process
from dynid.signals.samples import ProcessingSettings

SEEDS = range(14)


def _noise(seed: int, rows: int, correlation: float, white: float) -> Array:
    generator = np.random.default_rng(seed)
    drive = generator.normal(size=(rows + 1000, 6))
    slow = lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], drive, axis=0)[1000:]
    return np.sqrt(1 - white) * slow + np.sqrt(white) * generator.normal(size=(rows, 6))


@pytest.mark.parametrize(
    ("correlation", "white"), [(0.93, 0.0), (0.93, 0.3), (0.96, 0.6), (0.0, 1.0)]
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
