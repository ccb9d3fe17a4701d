"""Recursive least squares: an estimate that follows the samples as they come."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.core.linalg import inverse_upper, solve_upper, upper_triangle
from dynid.identification.accumulate import joint_factors
from dynid.identification.least_squares import (
    Estimator,
    Fit,
    WeightedLeastSquares,
    residual_noise,
)
from dynid.identification.problem import IdentificationProblem

START = 1e-9
"""Root of the information before the first sample, over a typical column."""


@dataclass(slots=True)
class RecursiveEstimate:
    """The square-root information filter: one small QR a batch of rows, nothing is inverted.

    Equal to batch least squares over all rows so far where nothing is forgotten (Bierman 1977).

    Raises:
        InputError: No parameters, or a forgetting factor outside (0, 1].
    """

    parameters: int
    forgetting: float = 1.0
    """Weight of a row one update ago; 1 for none forgotten."""
    root: Array = field(init=False)
    """(r + 1, r + 1) triangle of the rows so far, torques last."""

    def __post_init__(self) -> None:
        if self.parameters < 1:
            raise InputError("needs at least one parameter", value=self.parameters)
        if not 0 < self.forgetting <= 1:
            raise InputError("forgetting outside (0, 1]", value=self.forgetting)
        self.root = np.zeros((self.parameters + 1, self.parameters + 1))

    def update(self, columns: Array, torque: Array) -> None:
        """Take in rows.

        Args:
            columns: (m, r) rows of the observation matrix, divided by their noise.
            torque: (m) torques, divided by their noise.

        Raises:
            InputError: Shapes that do not fit.
        """
        if columns.shape != (len(torque), self.parameters):
            raise InputError(
                "rows do not fit", value=columns.shape, limit=(len(torque), self.parameters)
            )
        rows = np.column_stack([columns, torque])
        self.root = upper_triangle(np.vstack([np.sqrt(self.forgetting) * self.root, rows]))

    @property
    def values(self) -> Array:
        """(r) the estimate so far; what no row has shown yet is near zero."""
        r = self.parameters
        upper, right = self._regular()
        return solve_upper(upper[:r, :r], right[:r])

    @property
    def covariance(self) -> Array:
        """(r, r) if rows were divided by their noise and are independent."""
        inverse = inverse_upper(self._regular()[0])
        return inverse @ inverse.T

    def _regular(self) -> tuple[Array, Array]:
        r = self.parameters
        scale = np.linalg.norm(self.root[:, :r], axis=0)
        least = START * np.where(scale > 0, scale, 1.0)
        upper = upper_triangle(np.vstack([self.root, np.eye(r, r + 1) * np.append(least, 1.0)]))
        return upper[:r, :r], upper[:r, r]


@dataclass(frozen=True, kw_only=True)
class RecursiveLeastSquares(Estimator):
    """Recursive least squares over the record in order of time, rows weighted by joint noise."""

    forgetting: float = 1.0
    """See `RecursiveEstimate`, a block of rows at a time."""

    @property
    def name(self) -> str:
        """See `Estimator`."""
        return "rls"

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        noise = WeightedLeastSquares().fit(problem).noise
        running = RecursiveEstimate(problem.base.rank, self.forgetting)
        for _, columns, torque in problem.chunks():
            weighted = columns / noise[:, None]
            running.update(weighted.reshape(len(weighted), -1).T, (torque / noise[:, None]).ravel())
        values = running.values
        return Fit(
            values=values,
            noise=residual_noise(joint_factors(problem), values, problem),
            weights=1.0 / noise,
            information=running.root[:-1, :-1],
        )
