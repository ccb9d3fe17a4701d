"""Physically consistent estimation: bodies that can exist, friction that takes energy away."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.identification.accumulate import joint_factors
from dynid.identification.conditioning import base_mapping
from dynid.identification.consistent_conic import ConsistentSolution, solve_conic
from dynid.identification.consistent_problem import (
    ConsistentProblem,
    reduced_problem,
)
from dynid.identification.consistent_regions import held_out_weight
from dynid.identification.least_squares import (
    Estimator,
    Fit,
    WeightedLeastSquares,
    residual_noise,
)
from dynid.identification.origins import standard_fit
from dynid.identification.prior import InertialPrior, inertial_prior
from dynid.identification.problem import IdentificationProblem

EXCESS = 0.01
"""Share by which consistency and prior may raise the weighted residual sum (discrepancy)."""
WEIGHTS = (1e-6, 1.0)
"""Smallest and largest weight of the prior that is tried, over the weighted residual sum."""
POWER_DIGITS = 0.1
"""Decimal digits to which the weight is found."""


@dataclass(frozen=True, kw_only=True)
class PhysicallyConsistent(Estimator):
    """Weighted least squares over consistent bodies with a log-det prior on CAD values.

    On the QR-reduced problem (Sousa and Cortesao 2014) with the pseudo-inertia of every link
    positive (Wensing, Kim and Slotine 2018) and the entropic divergence of Lee, Wensing and Park
    (2020), whose weight is the largest that the data allow (discrepancy principle), or on poor
    motions the one that predicts the regions left out.
    """

    prior: InertialPrior | None = None
    """Inertias in the model's parameter frames; None for the robot's, completed."""
    prior_gain: float | None = None
    """See `WeightedLeastSquares`, whose weights and residual sum are the measure."""
    excess: float = EXCESS
    """Share by which the weighted residual sum may grow."""
    by_regions: bool = False
    """Choose the weight on regions of the motion left out instead, see `held_out_weight`."""

    @property
    def name(self) -> str:
        """See `Estimator`."""
        return "sdp"

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        plain = WeightedLeastSquares(prior_gain=self.prior_gain).fit(problem)
        model = problem.base.model
        prior = self.prior or inertial_prior(model.robot, model.frames)
        factors = joint_factors(problem)
        least = residual_sum(factors, plain.weights, plain.values)
        # In units of the plain residual sum, weights of the prior mean the same on all records.
        weights = plain.weights / np.sqrt(max(least, 1e-300))
        consistent, floor = reduced_problem(problem, factors, weights, prior)
        words: tuple[str, ...] = ()
        if self.by_regions:
            held_out = held_out_weight(problem, weights, prior)
            gamma = held_out.gamma
            solution = solve_conic(consistent, gamma)
            words = (f"prior weight from {held_out.regions} regions of the motion left out",)
        else:
            gamma, solution = largest_weight(consistent, floor, self.excess)
        values = base_mapping(problem.base) @ solution.values
        return replace(
            plain,
            values=values,
            noise=residual_noise(factors, values, problem),
            standard=standard_fit(
                consistent, gamma, solution, consistent.matrix[:, list(problem.base.independent)]
            ),
            choices=(*words, *_words(consistent, solution, gamma, floor, model.names, prior)),
        )


def residual_sum(factors: Array, weights: Array, values: Array) -> float:
    """Weighted residual sum of squares of base parameters (r)."""
    return float(np.square(weights[:, None] * (factors @ np.append(values, -1.0))).sum())


def largest_weight(
    problem: ConsistentProblem, floor: float, allowed: float
) -> tuple[float, ConsistentSolution]:
    """The largest weight of the prior that the data allow (discrepancy principle).

    Args:
        problem: A problem whose plain residual sum is one.
        floor: Residual sum that no parameters can go below.
        allowed: Share by which it may grow. Where consistency alone costs more than half of
            that, half of it comes on top of what it costs.

    Returns:
        The weight and its solution.
    """
    tried: dict[float, tuple[float, ConsistentSolution]] = {}

    def excess(power: float) -> float:
        if power not in tried:
            solution = solve_conic(problem, 10.0**power)
            tried[power] = (problem.misfit(solution.values) + floor - 1.0, solution)
        return tried[power][0]

    low, high = (float(x) for x in np.log10(WEIGHTS))
    cost = excess(low)
    limit = allowed if cost <= allowed / 2 else cost + allowed / 2
    if excess(high) <= limit:
        low = high
    while high - low > POWER_DIGITS:
        middle = (low + high) / 2
        if excess(middle) > limit:
            high = middle
        else:
            low = middle
    return 10.0**low, tried[low][1]


def _words(
    problem: ConsistentProblem,
    solution: ConsistentSolution,
    gamma: float,
    floor: float,
    names: tuple[str, ...],
    prior: InertialPrior,
) -> tuple[str, ...]:
    """What was chosen and what it cost."""
    excess = problem.misfit(solution.values) + floor - 1.0
    words = [
        f"consistent bodies, prior weight {gamma:.2g}: weighted residual sum "
        f"{100 * excess:+.2g} % against weighted least squares"
    ]
    slack = problem.constraints @ solution.values - problem.floor
    binding = [
        "-".join(names[i] for i in np.flatnonzero(row))
        for row, s, z in zip(problem.constraints, slack, solution.multipliers, strict=True)
        if z > s and not row[: 10 * problem.links].any()
    ]
    if binding:
        words.append(f"at their bounds: {', '.join(binding)}")
    if prior.completed:
        words.append(f"prior: {'; '.join(prior.completed)}")
    return tuple(words)
