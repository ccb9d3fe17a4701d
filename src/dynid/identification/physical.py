"""Physically consistent estimation: positive pseudo-inertias, friction that dissipates energy.

And where each standard parameter comes from: the data, or the prior.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynid.core import Array, JobError, inverse_upper, upper_triangle
from dynid.identification import bayesian, least_squares
from dynid.identification.consistent import (
    ConsistentProblem,
    ConsistentSolution,
    reduced_problem,
    solve_conic,
)
from dynid.identification.estimate import Estimate, StandardParameters
from dynid.identification.problem import IdentificationProblem, base_mapping, joint_factors
from dynid.reduction import BaseParametrization
from dynid.robot import to_pseudo_inertia

DATA_ABOVE = 0.5
"""Share of a parameter's variance that the data must have removed to be called data."""


def standard_posterior(estimate: Estimate, base: BaseParametrization) -> StandardParameters:
    """Standard parameters of an estimate: its own, or published ones corrected by its base values.

    Base parameters b = B p with covariance C; published parameters p ~ N(p0, S), S from
    `deviations`. Then p = p0 + K (b - B p0) with
    K = S B' (B S B' + C)^-1, and its covariance is S - K B S. The prior's share of a parameter is
    the share of its variance that is left. The base parametrization is that of its model, with the
    same independent columns.
    """
    if estimate.standard is not None:
        return estimate.standard
    model = estimate.model
    inertial = 10 * model.robot.joints
    known = bayesian.inertial_prior(model.robot, model.frames)
    spread = np.zeros((len(model.columns), len(model.columns)))
    spread[:inertial, :inertial] = bayesian.deviations(model.robot, model.frames)
    sizes: dict[str, float] = {}
    for name, value in zip(estimate.names, np.abs(estimate.values), strict=True):
        sizes[bayesian.symbol_of(name)] = max(
            float(value), sizes.get(bayesian.symbol_of(name), 1e-6)
        )
    # Friction and motor inertia have no published value: as wide as the largest of their kind.
    for k, name in enumerate(model.names[inertial:], start=inertial):
        spread[k, k] = sizes.get(bayesian.symbol_of(name), max(sizes.values()))
    prior = np.zeros(len(model.columns))
    prior[:inertial] = known.parameters.ravel()
    mapping = base_mapping(base)
    covariance: Array = spread @ spread.T
    seen = covariance @ mapping.T
    gain = np.linalg.solve(mapping @ seen + estimate.covariance, seen.T).T
    variance = np.maximum(np.diag(covariance - gain @ seen.T), 0.0)
    share = np.clip(variance / np.maximum(np.diag(covariance), 1e-300), 0.0, 1.0)
    return StandardParameters(
        values=prior + gain @ (estimate.values - mapping @ prior),
        std=np.sqrt(variance),
        prior_share=share,
        prior=np.where(np.arange(len(prior)) < inertial, prior, np.nan),
        origins=tuple("data" if s < 1 - DATA_ABOVE else "prior" for s in share),
    )


def standard_fit(
    problem: ConsistentProblem, gamma: float, solution: ConsistentSolution, root: Array, off: Array
) -> least_squares.StandardFit:
    """What data and prior each say about a solution, from its first-order response.

    The prior's share of a parameter is how far it moves when the prior's bodies move at random by
    one unit of their own metric, over what such a move is for the prior's parameter: 1 where the
    data say nothing or a bound of the prior holds, near 0 where they say all. Friction and motor
    inertia have no prior of their own, but move where they are seen only in sum with a link's
    inertia. `root` (m, r) are the columns of the base parameters, `off` (10 n, k) errors of the
    prior from `deviations`.
    """
    values, inertial = solution.values, 10 * problem.links
    turn = np.eye(len(values))
    turn[:inertial, :inertial] = bayesian.metric_moves(problem.pseudo_inertias(values))
    known = bayesian.metric_moves(to_pseudo_inertia(problem.prior))
    slack = np.maximum(problem.constraints @ values - problem.floor, 1e-300)
    # A bound that holds does not tell how far noise would have moved the parameter without it.
    stiff = np.where(solution.held, 0.0, np.sqrt(solution.multipliers / slack))
    rows = np.vstack(
        [
            problem.matrix @ turn,
            (stiff[:, None] * problem.constraints) @ turn,
            # In these coordinates the prior's second derivatives are gamma times the identity.
            np.sqrt(gamma) * np.eye(inertial, len(values)),
        ]
    )
    scale = 1.0 / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    inner = scale[:, None] * inverse_upper(upper_triangle(rows * scale))
    half = turn @ inner
    # The prior J0 pulls with gamma J0^-1: its unit moves shift the pull by known^-T.
    shift = gamma * half @ (half[:inertial].T @ np.linalg.inv(known).T)
    moved = np.linalg.norm(shift, axis=1)
    size = np.abs(values)
    size[:inertial] = np.linalg.norm(known, axis=1)
    share = np.divide(moved, size, out=np.ones_like(size), where=size > 0)
    bodies = np.abs(problem.constraints[solution.held][:, :inertial]) > 0
    share[:inertial][bodies.any(axis=0)] = 1.0
    return least_squares.StandardFit(
        values=values,
        gain=half @ (half.T @ (problem.matrix.T @ root)),
        pulled=shift @ np.linalg.solve(known, off),
        prior_share=np.minimum(share, 1.0),
        prior=np.concatenate([problem.prior.ravel(), np.full(len(values) - inertial, np.nan)]),
    )


EXCESS = 0.01
"""Share by which consistency and prior may raise the weighted residual sum (discrepancy)."""
WEIGHTS = (1e-6, 1.0)
"""Smallest and largest weight of the prior that is tried, over the weighted residual sum."""
POWER_DIGITS = 0.1
"""Decimal digits to which the weight is found."""


@dataclass(frozen=True, kw_only=True)
class PhysicallyConsistent(least_squares.Estimator):
    """Weighted least squares over consistent bodies with a log-det prior on CAD values.

    On the QR-reduced problem (Sousa and Cortesao 2014) with the pseudo-inertia of every link
    positive (Wensing, Kim and Slotine 2018) and the entropic divergence of Lee, Wensing and Park
    (2020), whose weight is given, or the largest that the data allow (discrepancy principle).
    """

    name: ClassVar[str] = "sdp"
    by_factors: ClassVar[bool] = True
    prior_gain: float | None = None
    """See `WeightedLeastSquares`, whose weights and residual sum are the measure."""
    weight: float | None = None
    """Of the prior, over the rows of a joint as in `TowardPublished`; None for the largest."""

    def fit(self, problem: IdentificationProblem) -> least_squares.Fit:
        """See `Estimator`."""
        plain = least_squares.WeightedLeastSquares(prior_gain=self.prior_gain).fit(problem)
        model = problem.base.model
        prior = bayesian.inertial_prior(model.robot, model.frames)
        factors = joint_factors(problem)
        least = residual_sum(factors, plain.weights, plain.values)
        # In units of the plain residual sum, weights of the prior mean the same on all records.
        weights = plain.weights / np.sqrt(max(least, 1e-300))
        consistent = reduced_problem(problem, factors, weights, prior)
        if self.weight is None:
            gamma, solution = largest_weight(consistent)
        else:
            gamma = self.weight / len(factors)
            solution = solve_conic(consistent, gamma)
        values = base_mapping(problem.base) @ solution.values
        return replace(
            plain,
            values=values,
            noise=least_squares.residual_noise(factors, values, problem),
            standard=standard_fit(
                consistent,
                gamma,
                solution,
                consistent.matrix[:, list(problem.base.independent)],
                bayesian.deviations(model.robot, model.frames),
            ),
            choices=_words(consistent, solution, gamma, model.names, prior),
        )


def residual_sum(factors: Array, weights: Array, values: Array) -> float:
    """Weighted residual sum of squares of base parameters (r)."""
    return float(np.square(weights[:, None] * (factors @ np.append(values, -1.0))).sum())


def largest_weight(problem: ConsistentProblem) -> tuple[float, ConsistentSolution]:
    """The largest weight of the prior that the data allow, and its solution.

    By the discrepancy principle: the plain residual sum of the problem is one, and may grow by the
    share `EXCESS`; where consistency alone costs more than half of that, half of it comes on top of
    what it costs. A weight whose program the solver does not finish counts as too large.
    """
    tried: dict[float, tuple[float, ConsistentSolution]] = {}

    def excess(power: float) -> float:
        if power not in tried:
            try:
                solution = solve_conic(problem, 10.0**power)
            except JobError:
                if not tried:
                    raise
                return float("inf")
            tried[power] = (problem.misfit(solution.values) - 1.0, solution)
        return tried[power][0]

    low, high = (float(x) for x in np.log10(WEIGHTS))
    cost = excess(low)
    limit = EXCESS if cost <= EXCESS / 2 else cost + EXCESS / 2
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
    names: tuple[str, ...],
    prior: bayesian.InertialPrior,
) -> tuple[str, ...]:
    """What was chosen and what it cost."""
    excess = problem.misfit(solution.values) - 1.0
    words = [
        f"consistent bodies, prior weight {gamma:.2g}: weighted residual sum "
        f"{100 * excess:+.2g} % against weighted least squares"
    ]
    binding = [
        "-".join(names[i] for i in np.flatnonzero(row))
        for row in problem.constraints[solution.held]
        if not row[: 10 * problem.links].any()
    ]
    if binding:
        words.append(f"at their bounds: {', '.join(binding)}")
    if prior.completed:
        words.append(f"prior: {'; '.join(prior.completed)}")
    return tuple(words)
