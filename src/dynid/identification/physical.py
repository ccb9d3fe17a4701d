"""Physically consistent estimation: positive pseudo-inertias, friction that dissipates energy.

As a cone program; and where each standard parameter comes from: the data, or the prior.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from dynid.core import Array, JobError, Mask, inverse_upper, require, scipy_part, upper_triangle
from dynid.identification import bayesian, least_squares
from dynid.identification.estimate import Estimate, StandardParameters
from dynid.identification.problem import IdentificationProblem, base_mapping, joint_factors
from dynid.reduction import BaseParametrization
from dynid.regressor import InverseDynamicModel
from dynid.robot import (
    PSEUDO_INERTIA_BASIS,
    frame_map,
    from_pseudo_inertia,
    to_pseudo_inertia,
)

BOUNDED_BY = {"Fca": "Fc", "Fva": "Fv", "Fs": "Fc"}
"""Added friction that must not outweigh its term: friction opposes motion both ways."""

MASS_FACTOR = 3.0
"""A published mass is right to this factor."""
CENTRE_MARGIN = 0.25
"""How far beside its link a centre of mass may lie, over the arm's reach."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsistentProblem:
    """Minimise ||A p - y||^2 / 2 + gamma sum_i D(J_i || J0_i) with C p >= d and J_i > 0.

    D is the log-det (entropic) divergence tr(J0^-1 J) - log det(J0^-1 J) - 4 of Lee, Wensing and
    Park (2020): zero at the prior, infinite at bodies that cannot exist, the same in all frames
    and units.
    """

    matrix: Array
    """A (m, p), the triangular root of the weighted data in standard parameters."""
    target: Array
    """y (m)."""
    prior: Array
    """(n, 10) inertial parameters of bodies that exist; p starts with the 10 n of them."""
    constraints: Array
    """C (k, p)."""
    floor: Array
    """d (k)."""
    least: float = 0.0
    """Residual sum that no parameters can go below."""

    @property
    def links(self) -> int:
        """Number of links n."""
        return len(self.prior)

    def pseudo_inertias(self, parameters: Array) -> Array:
        """(n, 4, 4) of parameters (p)."""
        return to_pseudo_inertia(parameters[: 10 * self.links].reshape(-1, 10))

    def misfit(self, parameters: Array) -> float:
        """The weighted residual sum, ||A p - y||^2 and what lies below."""
        return self.least + float(np.square(self.matrix @ parameters - self.target).sum())


def reduced_problem(
    problem: IdentificationProblem, factors: Array, weights: Array, prior: bayesian.InertialPrior
) -> ConsistentProblem:
    """The reduced problem.

    With factors (n, r + 1, r + 1) of `joint_factors`, weights (n) [1/(N.m)] and inertias in the
    model's parameter frames.
    """
    rank = problem.base.rank
    upper = upper_triangle((factors * weights[:, None, None]).reshape(-1, rank + 1))
    signs = sign_constraints(problem.base.model)
    bodies, floors = body_constraints(problem.base.model)
    return ConsistentProblem(
        matrix=upper[:rank, :rank] @ base_mapping(problem.base),
        target=upper[:rank, rank],
        prior=prior.parameters,
        constraints=np.vstack([signs, bodies]),
        floor=np.concatenate([np.zeros(len(signs)), floors]),
        least=float(upper[rank, rank] ** 2),
    )


def sign_constraints(model: InverseDynamicModel) -> Array:
    """C (k, p) with C p >= 0: friction opposes motion, motor inertia is not negative."""
    names, unit = model.names, np.eye(len(model.names))
    place = {name: k for k, name in enumerate(names)}
    rows: list[Array] = []
    for name, k in place.items():
        symbol = bayesian.symbol_of(name)
        if symbol in bayesian.NOT_NEGATIVE:
            rows.append(unit[k])
        base = BOUNDED_BY.get(symbol)
        if base is None:
            continue
        other = place.get(base + name[len(symbol) :])
        for sign in (1.0,) if symbol == "Fs" else (1.0, -1.0):
            row = sign * unit[k]
            if other is not None:
                row[other] += 1.0
            rows.append(row)
    return np.array(rows).reshape(-1, len(names))


def body_constraints(model: InverseDynamicModel) -> tuple[Array, Array]:
    """C (k, p) and d (k) with C p >= d: masses and centres of mass where they can be.

    A published mass is right to `MASS_FACTOR`; the last link may carry a tool besides. A centre
    of mass lies in the box of its link's joint and the next, wider by `CENTRE_MARGIN`.
    """
    robot, unit = model.robot, np.eye(len(model.columns))
    ends = bayesian.link_ends(robot)
    margin = CENTRE_MARGIN * bayesian.reach(ends)
    rows: list[Array] = []
    floors: list[float] = []
    for i, end in enumerate(ends):
        known = robot.inertias[i]
        here = slice(10 * i, 10 * i + 10)
        if known[0] > 0:
            rows.append(unit[10 * i])
            floors.append(float(known[0]) / MASS_FACTOR)
            if i < robot.joints - 1:
                rows.append(-unit[10 * i])
                floors.append(-float(known[0]) * MASS_FACTOR)
        published = known[1:4] / known[0] if known[0] > 0 else np.zeros(3)
        corners = np.array([np.zeros(3), end, np.nan_to_num(published)])
        lower, upper = corners.min(axis=0) - margin, corners.max(axis=0) + margin
        first = frame_map(robot.parameter_frames[model.frames][i])[:4]
        for axis in range(3):
            for sign, bound in ((1.0, lower[axis]), (-1.0, upper[axis])):
                row = np.zeros(len(unit))
                row[here] = sign * (first[1 + axis] - bound * first[0])
                rows.append(row)
                floors.append(0.0)
    return np.array(rows), np.array(floors)


TRIANGLE = tuple((a, b) for a in range(4) for b in range(a + 1))
"""Entries of the lower triangle Z."""
EXTRA = 14
"""Variables a link besides its parameters: the ten of Z and four logarithms."""
TOLERANCE = 1e-10
"""Of gaps and residuals."""
THINNEST = 1e-9
"""Least size of a body along any axis of its pseudo-inertia, over that of the prior's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsistentSolution:
    """A minimiser."""

    values: Array
    """(p) standard parameters."""
    multipliers: Array
    """(k) of the bounds, zero where they do not bind."""
    held: Mask
    """(k) which bounds bind."""


def solve_conic(problem: ConsistentProblem, gamma: float) -> ConsistentSolution:
    """The minimiser by an interior-point method, gamma > 0 the weight of the prior.

    Raises:
        MissingExtraError: Clarabel is not installed.
        JobError: The solver does not find a solution.
    """
    clarabel: Any = require("clarabel", "sdp")
    width, columns = problem.matrix.shape[1], problem.matrix.shape[1] + EXTRA * problem.links
    units = _units(problem)
    matrix, bounds = problem.matrix @ units, problem.constraints @ units
    sizes = np.linalg.norm(bounds, axis=1)
    quadratic = np.zeros((columns, columns))
    quadratic[:width, :width] = matrix.T @ matrix
    linear = np.zeros(columns)
    linear[:width] = -matrix.T @ problem.target
    # Clarabel: minimise x'Px/2 + q'x with A x + s = b, s in cones.
    padding = np.zeros((len(sizes), columns - width))
    rows = [np.hstack([-bounds / sizes[:, None], padding])]
    right = [-problem.floor / sizes]
    cones: list[Any] = [clarabel.NonnegativeConeT(len(sizes))]
    for i in range(problem.links):
        first = width + EXTRA * i
        linear[10 * i : 10 * i + 10] += gamma * np.trace(PSEUDO_INERTIA_BASIS, axis1=1, axis2=2)
        linear[first + 10 : first + EXTRA] = -gamma
        rows += _link_rows(10 * i, first, columns)
        right += [np.zeros(36), *[np.array([0.0, 1.0, 0.0])] * 4]
        cones += [clarabel.PSDTriangleConeT(8), *[clarabel.ExponentialConeT()] * 4]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    settings.max_iter = 400
    matrix = scipy_part("sparse").csc_matrix
    cost = matrix(np.triu(quadratic)), linear
    limits = matrix(np.vstack(rows)), np.concatenate(right)
    solution = clarabel.DefaultSolver(*cost, *limits, cones, settings).solve()
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise JobError("the conic solver found no solution", value=str(solution.status))
    # In the solver's units, which those of the arm do not change.
    multipliers, slack = (np.array(x[: len(sizes)]) for x in (solution.z, solution.s))
    return ConsistentSolution(
        values=_within_the_cone(problem, units @ np.array(solution.x[:width], dtype=np.float64)),
        multipliers=np.maximum(multipliers / sizes, 0.0),
        held=multipliers > slack,
    )


def _within_the_cone(problem: ConsistentProblem, values: Array) -> Array:
    """Parameters (p) whose bodies exist: the solver meets its cones to its tolerance alone."""
    roots = np.linalg.cholesky(to_pseudo_inertia(problem.prior))
    inverses = np.linalg.inv(roots)
    turned = inverses @ problem.pseudo_inertias(values) @ inverses.transpose(0, 2, 1)
    sizes, axes = np.linalg.eigh(turned)
    flat = sizes[:, 0] < THINNEST
    if flat.any():
        axes = roots @ axes
        bodies = (axes * np.maximum(sizes, THINNEST)[:, None]) @ axes.transpose(0, 2, 1)
        values[: 10 * problem.links].reshape(-1, 10)[flat] = from_pseudo_inertia(bodies[flat])
    return values


def _units(problem: ConsistentProblem) -> Array:
    """(p, p) parameters in which the solver works: bodies in those of the prior, columns of one.

    Friction in N.m beside inertias of a wrist would stop the solver short of its tolerance.
    """
    units, inertial = np.eye(problem.matrix.shape[1]), 10 * problem.links
    bodies = to_pseudo_inertia(problem.prior)
    units[:inertial, :inertial] = bayesian.metric_moves(bodies, PSEUDO_INERTIA_BASIS)
    norms = np.linalg.norm(problem.matrix[:, inertial:], axis=0)
    for k, norm in enumerate(norms, start=inertial):
        units[k, k] = 1.0 / norm if norm > 0 else 1.0
    return units


def _link_rows(here: int, first: int, columns: int) -> list[Array]:
    """Rows of one link: its 8x8 matrix, then the cone of each logarithm."""
    block = np.zeros((columns, 8, 8))
    block[here : here + 10, :4, :4] = PSEUDO_INERTIA_BASIS
    for k, (a, b) in enumerate(TRIANGLE):
        block[first + k, a, 4 + b] = block[first + k, 4 + b, a] = 1.0
        if a == b:
            block[first + k, 4 + a, 4 + a] = 1.0
    rows = [-_upper_triangles(block).T]
    for a in range(4):
        cone = np.zeros((3, columns))
        cone[0, first + 10 + a] = -1.0
        cone[2, first + TRIANGLE.index((a, a))] = -1.0
        rows.append(cone)
    return rows


def _upper_triangles(matrices: Array) -> Array:
    """(..., k (k + 1) / 2) upper triangles by columns, off-diagonal entries times sqrt(2)."""
    columns, rows = np.tril_indices(matrices.shape[-1])
    return matrices[..., rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2.0))


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
        symbol = bayesian.symbol_of(name)
        sizes[symbol] = max(float(value), sizes.get(symbol, 1e-6))
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
    slack = problem.constraints @ values - problem.floor
    # A bound that holds does not tell how far noise would have moved the parameter without it.
    free = (slack > 0) & ~solution.held
    stiff = np.sqrt(np.divide(solution.multipliers, slack, out=np.zeros_like(slack), where=free))
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
    share = np.divide(np.minimum(moved, size), size, out=np.ones_like(size), where=size > 0)
    bodies = np.abs(problem.constraints[solution.held][:, :inertial]) > 0
    share[:inertial][bodies.any(axis=0)] = 1.0
    return least_squares.StandardFit(
        values=values,
        gain=half @ (half.T @ (problem.matrix.T @ root)),
        pulled=shift @ np.linalg.solve(known, off),
        prior_share=share,
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
            prior_strength=gamma * least,
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
    held = problem.constraints[solution.held]
    of_friction = held[~held[:, : 10 * problem.links].any(axis=1)]
    binding = ["-".join(names[i] for i in np.flatnonzero(row)) for row in of_friction]
    if binding:
        words.append(f"at their bounds: {', '.join(binding)}")
    if prior.completed:
        words.append(f"prior: {'; '.join(prior.completed)}")
    return tuple(words)
