"""Bayesian estimation: published inertias as a prior, and a posterior that can be believed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.core.linalg import inverse_upper, upper_triangle
from dynid.identification.accumulate import joint_factors
from dynid.identification.conditioning import base_mapping
from dynid.identification.least_squares import (
    Estimator,
    Fit,
    WeightedLeastSquares,
    residual_noise,
    solve,
)
from dynid.identification.prior import ORTHONORMAL, InertialPrior, inertial_prior
from dynid.identification.problem import IdentificationProblem
from dynid.identification.statistics import hac_covariance, naive_covariance
from dynid.robot.inertia import from_pseudo_inertia, to_pseudo_inertia

RELATIVE = 0.3
"""Standard deviation of a published pseudo-inertia in its own metric: 30 %."""
COMPLETED = 1.0
"""The same for one with a completed part."""
WIDE = 10.0
"""Friction and motor inertia: this many times what would explain all torques."""


@dataclass(frozen=True, kw_only=True)
class BayesianRegression(Estimator):
    """Gaussian prior on standard parameters, Gaussian likelihood, both exact.

    The prior's covariance is the inverse of the pseudo-inertia metric at the published values
    (Lee, Wensing and Park 2020), so that no choice of frames or units matters. Residuals of
    robots are correlated: the likelihood is tempered by how much that inflates variances,
    otherwise the posterior would claim too much.
    """

    prior: InertialPrior | None = None
    """Inertias in the model's parameter frames; None for the robot's, completed."""
    relative: float | None = None
    """Standard deviation of the prior in its own metric; None for `RELATIVE` or `COMPLETED`."""

    @property
    def name(self) -> str:
        """See `Estimator`."""
        return "bayes"

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        model = problem.base.model
        plain = WeightedLeastSquares(prior_gain=1.0).fit(problem)
        known = self.prior or inertial_prior(model.robot, model.frames)
        relative = self.relative or (COMPLETED if known.completed else RELATIVE)
        honest = np.diag(hac_covariance(plain, problem)) / np.diag(naive_covariance(plain))
        factors = joint_factors(problem)
        tempered = plain.weights / np.sqrt(max(float(np.median(honest)), 1.0))
        mean, root = base_prior(problem, known, relative, factors, tempered)
        values, information = posterior(factors, tempered, mean, root)
        return replace(
            plain,
            values=values,
            weights=tempered,
            noise=residual_noise(factors, values, problem),
            information=information,
            prior_precision=root.T @ root,
            choices=(
                f"prior of {100 * relative:g} % on published inertias",
                f"likelihood tempered by {float(np.median(honest)):.2g} for correlated residuals",
            ),
        )


def base_prior(
    problem: IdentificationProblem,
    known: InertialPrior,
    relative: float,
    factors: Array,
    weights: Array,
) -> tuple[Array, Array]:
    """Mean (r) and root (r, r) of the precision of the base parameters' prior."""
    model = problem.base.model
    inertial = 10 * model.robot.joints
    spread = np.zeros((len(model.columns), len(model.columns)))
    for i, body in enumerate(np.linalg.cholesky(to_pseudo_inertia(known.parameters))):
        here = slice(10 * i, 10 * i + 10)
        spread[here, here] = relative * from_pseudo_inertia(body @ ORTHONORMAL @ body.T).T
    mapping = base_mapping(problem.base)
    stacked = (factors * weights[:, None, None]).reshape(-1, problem.base.rank + 1)
    energy = float(np.linalg.norm(stacked[:, -1]))
    for k, column in enumerate(problem.base.independent):
        if column >= inertial:
            spread[column, column] = WIDE * energy / float(np.linalg.norm(stacked[:, k]))
    for column in problem.base.dependent:
        if column >= inertial:
            spread[column, column] = float(np.abs(spread[inertial:, inertial:]).max())
    mean = np.zeros(len(model.columns))
    mean[:inertial] = known.parameters.ravel()
    # Covariance R'R has the precision R^-1 R^-T.
    return mapping @ mean, inverse_upper(upper_triangle((mapping @ spread).T)).T


def posterior(factors: Array, weights: Array, mean: Array, root: Array) -> tuple[Array, Array]:
    """Mean (r) of the posterior and the root (r, r) of its precision.

    Args:
        factors: (n, r + 1, r + 1) from `joint_factors`.
        weights: (n) weight of each joint.
        mean: (r) of the prior.
        root: (r, r) root of the prior's precision.
    """
    prior = np.column_stack([root, root @ mean])
    size = factors.shape[1]
    padded = np.vstack([prior, np.zeros((size - len(prior), size))])
    return solve(np.concatenate([factors, padded[None]]), np.append(weights, 1.0))
