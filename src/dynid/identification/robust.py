"""Robust estimation: iteratively reweighted least squares with Huber's weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.identification.accumulate import joint_factors
from dynid.identification.least_squares import (
    Estimator,
    Fit,
    WeightedLeastSquares,
    solve,
)
from dynid.identification.problem import IdentificationProblem

HUBER = 1.345
"""95 % efficient on Gaussian noise."""
MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True, kw_only=True)
class HuberRegression(Estimator):
    """IRLS: rows far from the model count less, w = min(1, k s_j / |r|) (Huber 1964)."""

    prior_gain: float | None = None
    """See `WeightedLeastSquares`."""
    threshold: float = HUBER
    max_iterations: int = 30
    tolerance: float = 1e-4

    @property
    def name(self) -> str:
        """See `Estimator`."""
        return "irls"

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        start = WeightedLeastSquares(prior_gain=self.prior_gain).fit(problem)
        values, noise, information = start.values, start.noise, start.information
        rows = np.ones((problem.samples.joints, problem.blocks))
        for _ in range(self.max_iterations):
            residual = problem.residual(values)
            noise = np.maximum(_spread(residual), 1e-12 * np.abs(residual).max(initial=1e-12))
            rows = np.minimum(1.0, self.threshold * noise[:, None] / (np.abs(residual) + 1e-300))
            # Least squares multiplies rows by the root of their weight.
            factors = joint_factors(problem, np.sqrt(rows))
            update, information = solve(factors, 1.0 / noise, self.prior_gain)
            step = np.linalg.norm(information @ (update - values))
            size = np.linalg.norm(information @ update)
            values = update
            if step <= self.tolerance * size:
                break
        return Fit(
            values=values,
            noise=noise,
            weights=1.0 / noise,
            information=information,
            row_weights=rows,
        )


def _spread(residual: Array) -> Array:
    centre = np.median(residual, axis=1, keepdims=True)
    return MAD_TO_SIGMA * np.median(np.abs(residual - centre), axis=1)
