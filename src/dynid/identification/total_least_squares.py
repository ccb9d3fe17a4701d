"""Total least squares: errors in the observation matrix as well as in the torques."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import JobError
from dynid.core.linalg import upper_triangle
from dynid.identification.accumulate import joint_factors
from dynid.identification.least_squares import (
    Estimator,
    Fit,
    WeightedLeastSquares,
    residual_noise,
)
from dynid.identification.problem import IdentificationProblem

WEAK_TORQUE = 1e-8
"""Share of the torque in the smallest singular vector below which there is no solution."""


@dataclass(frozen=True, kw_only=True)
class TotalLeastSquares(Estimator):
    """The nearest consistent system to [W tau], rows weighted, columns of unit norm.

    From the singular vector of [W tau] with the smallest singular value (Golub and Van Loan
    1980; Gautier, Vandanjon and Presse 1994 for robots). It presumes errors of equal size in
    all scaled columns, which robots do not have: a yardstick, not a recommendation.
    """

    @property
    def name(self) -> str:
        """See `Estimator`."""
        return "tls"

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        plain = WeightedLeastSquares().fit(problem)
        factors = joint_factors(problem)
        width = problem.base.rank + 1
        stacked = upper_triangle((factors * plain.weights[:, None, None]).reshape(-1, width))
        values = solve_total(stacked)
        return replace(plain, values=values, noise=residual_noise(factors, values, problem))


def solve_total(augmented: Array) -> Array:
    """The total least-squares solution (r) of [A b] (m, r + 1), columns scaled to unit norm.

    Raises:
        JobError: The torque has no part in the smallest singular vector.
    """
    scale = np.linalg.norm(augmented, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    last = np.linalg.svd(augmented / scale, full_matrices=False)[2][-1]
    if abs(last[-1]) < WEAK_TORQUE:
        raise JobError(
            "total least squares has no solution for this record",
            next_step="Use --estimator wls; its columns are nearly dependent on each other.",
        )
    return -last[:-1] / last[-1] * scale[-1] / scale[:-1]
