"""Instrumental variables and output error: noise in the motion must not bias the parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array, Indices
from dynid.core.errors import JobError
from dynid.core.linalg import upper_triangle
from dynid.identification.accumulate import joint_factors
from dynid.identification.closed_loop import ClosedLoop
from dynid.identification.least_squares import (
    Estimator,
    Fit,
    WeightedLeastSquares,
    residual_noise,
)
from dynid.identification.problem import IdentificationProblem
from dynid.identification.smoothing import picked, smooth_motion
from dynid.signals.samples import Samples

ITERATIONS = 4
TOLERANCE = 1e-3
"""Change over a standard deviation at which iterations stop."""


@dataclass(frozen=True, kw_only=True)
class InstrumentalVariables(Estimator):
    """p = (Z' W)^-1 Z' tau with the simulated arm's observation matrix Z (IDIM-IV).

    Noise of the measured motion stands in W but not in Z, the columns of a noise-free
    simulation of the identified model in closed loop (Janot, Vandanjon and Gautier 2014). Its
    reference is the measured motion low-passed near its own bandwidth.
    """

    prior_gain: float | None = None
    """See `WeightedLeastSquares`, where it starts."""

    @property
    def name(self) -> str:
        """See `Estimator`."""
        return "iv"

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        smooth, inner = smooth_motion(problem.samples)
        measured = replace(problem, samples=picked(problem.samples, inner))
        # A start from the noisy motion may have a mass matrix that cannot be simulated.
        first = replace(problem, samples=picked(smooth, inner))
        fit = WeightedLeastSquares(prior_gain=self.prior_gain).fit(first)
        factors = joint_factors(measured)
        for _ in range(ITERATIONS):
            simulated = simulated_problem(problem, smooth, inner, fit.values)
            values, information = solve_instrumental(measured, simulated, fit.weights)
            step = float(np.linalg.norm(information @ (values - fit.values)))
            noise = residual_noise(factors, values, measured)
            fit = replace(
                fit, values=values, information=information, noise=noise, weights=1.0 / noise
            )
            if step < TOLERANCE * np.sqrt(len(values)):
                break
        return fit


@dataclass(frozen=True, kw_only=True)
class OutputError(Estimator):
    """Fits the torques of the simulated arm to the measured ones (DIDIM, CLIE).

    The simulated motion replaces the measured one altogether: the model is simulated forward in
    closed loop, its inverse model fitted to the measured torques, and so on (Gautier, Janot and
    Vandanjon 2013). Two or three rounds are enough.
    """

    prior_gain: float | None = None
    """See `WeightedLeastSquares`."""

    @property
    def name(self) -> str:
        """See `Estimator`."""
        return "didim"

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        weighted = WeightedLeastSquares(prior_gain=self.prior_gain)
        smooth, inner = smooth_motion(problem.samples)
        fit = weighted.fit(replace(problem, samples=picked(smooth, inner)))
        for _ in range(ITERATIONS):
            update = weighted.fit(simulated_problem(problem, smooth, inner, fit.values))
            step = float(np.linalg.norm(update.information @ (update.values - fit.values)))
            fit = update
            if step < TOLERANCE * np.sqrt(len(fit.values)):
                break
        return fit


def simulated_problem(
    problem: IdentificationProblem, smooth: Samples, inner: Indices, values: Array
) -> IdentificationProblem:
    """The same torques with the motion of the simulated arm.

    Args:
        problem: The problem.
        smooth: The reference of the simulated servo.
        inner: The samples that are kept.
        values: (r) base parameters of the arm.
    """
    parameters = np.zeros(len(problem.base.model.columns))
    parameters[list(problem.base.independent)] = values
    loop = ClosedLoop(model=problem.base.model, parameters=parameters)
    return replace(problem, samples=picked(loop.simulate(smooth), inner))


def solve_instrumental(
    measured: IdentificationProblem, simulated: IdentificationProblem, weights: Array
) -> tuple[Array, Array]:
    """The instrumental-variable solution and the root of its information.

    Args:
        measured: W and tau.
        simulated: Z, with as many rows.
        weights: (n) weight of each joint [1/(N.m)].

    Returns:
        (r) p = (Z' W)^-1 Z' tau, rows weighted, and the (r, r) triangular root of
        W' Z (Z' Z)^-1 Z' W.

    Raises:
        JobError: Z' W is singular to working precision.
    """
    rank = measured.base.rank
    cross = np.zeros((rank, rank))
    right = np.zeros(rank)
    stacked = np.zeros((rank, rank))
    for (_, w, torque), (_, z, _) in zip(measured.chunks(), simulated.chunks(), strict=True):
        square = np.square(weights)[:, None]
        cross += np.einsum("rjt,sjt->rs", z * square, w, optimize=True)
        right += np.einsum("rjt,jt->r", z * square, torque, optimize=True)
        rows = (z * weights[:, None]).reshape(rank, -1).T
        stacked = upper_triangle(np.vstack([stacked, rows]))
    scale = np.linalg.norm(stacked, axis=0)
    if (scale == 0).any() or np.linalg.cond(cross / np.outer(scale, scale)) > 1e13:
        raise JobError(
            "the instruments do not determine all parameters",
            next_step="Record a motion that excites every joint, or use --estimator wls.",
        )
    scaled = cross / np.outer(scale, scale)
    values = np.asarray(np.linalg.solve(scaled, right / scale), dtype=np.float64) / scale
    projected = np.asarray(np.linalg.solve(stacked.T, cross), dtype=np.float64)
    return values, upper_triangle(projected)
