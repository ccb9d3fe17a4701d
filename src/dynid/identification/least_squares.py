"""Least squares: ordinary, weighted, robust, total and recursive."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynid import core, reduction
from dynid.identification.problem import IdentificationProblem, base_mapping, joint_factors

PRIOR_GAIN = 1.0
"""Standard deviation expected of a parameter's share of the torque, over the torque itself."""
LEAST_NOISE = 1e-9
"""Noise of a joint over its torque, at least: less is rounding."""
MOST_WEIGHTINGS = 20
SETTLED = 1e-4
"""Iterations stop when no joint's noise, or no residual, changes by more than this share."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StandardFit(core.Value):
    """Standard parameters of an estimator that knows more than the data."""

    values: core.Array
    """(p) standard parameters."""
    gain: core.Array
    """(p, r) how they move with the base parameters that the data alone would give."""
    pulled: core.Array
    """(p, k) how they move with errors of the prior, those of `deviations`."""
    prior_share: core.Array
    """(p) 0: the data's word alone, to 1: the prior's."""
    prior: core.Array
    """(p) the prior; NaN where there is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit(core.Value):
    """A least-squares solution and what its statistics need."""

    values: core.Array
    """(r) base parameters."""
    noise: core.Array
    """(n) residual standard deviation of each joint [N.m or N]."""
    weights: core.Array
    """(n) weight of each joint's rows [1/(N.m)]; 1 for ordinary least squares."""
    information: core.Array
    """(r, r) upper triangular R with R'R = W' Omega^-1 W (+ prior)."""
    row_weights: core.Array | None = None
    """(n, N) further weights of single rows, for robust estimators."""
    standard: StandardFit | None = None
    """Standard parameters, from estimators that find them."""
    score_covariance: core.Array | None = None
    """(r, r) covariance of scores besides those of the residuals: the precision of a Gaussian prior
    that is part of the information, or what an estimator may be off by itself."""
    prior_strength: float = 0.0
    """Precision of the published inertias in the information, over that of `published_prior`."""
    choices: tuple[str, ...] = ()
    """What the estimator chose by itself, in words."""


class Estimator(ABC):
    """A way to fit the base parameters."""

    by_factors: ClassVar[bool] = False
    """Whether `joint_factors` are all that it needs of the rows."""

    name: ClassVar[str] = "own"
    """The word of `--estimator`."""

    @abstractmethod
    def fit(self, problem: IdentificationProblem) -> Fit:
        """Fit.

        Raises:
            JobError: The normal equations are singular to working precision.
        """

    def checked_fit(self, problem: IdentificationProblem) -> Fit:
        """As `fit`, of which users may have written their own.

        Raises:
            InputError: No `Fit`, or one with numbers that are not finite or of a wrong shape.
        """
        fit = self.fit(problem)
        where = f"{type(self).__name__}.fit"
        if not isinstance(fit, Fit):  # pyright: ignore[reportUnnecessaryIsInstance]
            kind = type(fit).__name__
            raise core.InputError("returned no Fit", where=where, value=kind, limit="dynid.Fit")
        n, r = problem.samples.joints, problem.base.rank
        shapes = {"values": (r,), "noise": (n,), "weights": (n,), "information": (r, r)}
        for name, shape in shapes.items():
            core.frozen(getattr(fit, name), shape=shape, name=f"{where}: {name}")
        return fit


@dataclass(frozen=True, kw_only=True)
class OrdinaryLeastSquares(Estimator):
    """The paper's Eq. 6: every torque sample counts the same, in N.m."""

    name: ClassVar[str] = "ols"
    by_factors: ClassVar[bool] = True

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        return _weighted(problem, np.ones(problem.samples.joints))


def _weighted(problem: IdentificationProblem, weights: core.Array) -> Fit:
    """The solution for weights (n) of the joints' rows."""
    factors = joint_factors(problem)
    values, information = solve(factors, weights, problem.base)
    noise = residual_noise(factors, values, problem)
    return Fit(values=values, noise=noise, weights=weights, information=information)


@dataclass(frozen=True, kw_only=True)
class WeightedLeastSquares(Estimator):
    """Each joint weighted by its own noise, iterated (Gautier and Poignet 2001)."""

    name: ClassVar[str] = "wls"
    by_factors: ClassVar[bool] = True
    groups: tuple[int, ...] | None = None
    """Group of each joint; joints of a group share one noise (joint sizes). None: one each."""
    prior_gain: float | None = None
    """Weak prior that tames directions without data, see `PRIOR_GAIN`; None for none."""

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        factors = joint_factors(problem)
        return reweighted(
            problem,
            factors,
            self.groups,
            lambda weights: solve(factors, weights, problem.base, self.prior_gain),
            problem.samples.noise,
        )


def reweighted(
    problem: IdentificationProblem,
    factors: core.Array,
    groups: tuple[int, ...] | None,
    solved: Callable[[core.Array], tuple[core.Array, core.Array]],
    measured: core.Array | None = None,
) -> Fit:
    """The solution whose weights are those of its own residuals.

    From factors (n, r + 1, r + 1), `solved` gives values (r) and the root (r, r) of the information
    for weights (n). It begins with the noise (n) that was measured, else with that of the torques.

    Raises:
        InputError: Not one group a joint.
    """
    which = np.arange(len(factors)) if groups is None else np.array(groups)
    if len(which) != len(factors):
        raise core.InputError("one group a joint", value=len(which), limit=len(factors))
    noise = scale = torque_scale(factors, problem)
    if measured is not None:
        # Repetitions that are copies show none.
        noise = np.maximum(measured, LEAST_NOISE * scale)
    for _ in range(MOST_WEIGHTINGS):
        values, _ = solved(1.0 / pooled(noise, which))
        update = residual_noise(factors, values, problem)
        change = np.abs(update / noise - 1).max()
        noise = update
        if change < SETTLED:
            break
    weights = 1.0 / pooled(noise, which)
    values, information = solved(weights)
    return Fit(values=values, noise=noise, weights=weights, information=information)


def solve(
    factors: core.Array,
    weights: core.Array,
    base: reduction.BaseParametrization,
    prior_gain: float | None = None,
    known: core.Array | None = None,
) -> tuple[core.Array, core.Array]:
    """Values (r) and the triangular root (r, r) of the information of the weighted problem.

    From factors (n, r + 1, r + 1) of `joint_factors` and weights (n); `prior_gain` as `PRIOR_GAIN`,
    None for plain least squares; rows (k, r + 1) of what is `known` besides.

    The weak prior is one of the standard parameters: base columns that hardly differ from each
    other, which depends on link frames, carry torques that cancel and exceed all measured ones.

    Raises:
        JobError: Singular to working precision.
    """
    r = factors.shape[1] - 1
    rows = (factors * weights[:, None, None]).reshape(-1, r + 1)
    rows = rows if known is None else np.vstack([rows, known])
    if prior_gain is not None:
        mapping = base_mapping(base)
        # Standard column k explains norm(scale_k p_k) of the norm of all torques.
        scale = np.linalg.norm(rows[:, :r] @ mapping, axis=0)
        # What no torque shows, but for rounding, stays with the prior: zero.
        scale[scale <= 1e-12 * scale.max()] = 1.0
        expected = max(prior_gain * np.linalg.norm(rows[:, r]), 1e-300)
        root = core.inverse_upper(core.upper_triangle((mapping * expected / scale).T)).T
        rows = np.vstack([rows, np.column_stack([root, np.zeros(r)])])
    return solve_rows(rows)


def solve_rows(rows: core.Array, singular: float = 1e-13) -> tuple[core.Array, core.Array]:
    """Least squares for [A b] (m, r + 1), columns of unit norm; values (r), the root (r, r) of A'A.

    Raises:
        JobError: A smallest pivot over the largest below `singular`, or a column of zeros.
    """
    scale = np.linalg.norm(rows[:, :-1], axis=0)
    if (scale == 0).any():
        raise core.JobError(
            "a parameter has no effect on any torque or current of these recordings",
            next_step="The motion stands still or moves too few joints: record more, lock the "
            "joints that stand still ([locked] in a robot file), or identify with --preset best.",
        )
    upper = core.upper_triangle(rows / np.append(scale, 1.0))
    root = upper[:-1, :-1]
    pivots = np.abs(np.diag(root))
    if pivots.min() < singular * pivots.max():
        raise core.JobError(
            "the observation matrix is singular to working precision",
            value=f"smallest pivot {pivots.min():.1e}",
            next_step="Record motions that load and accelerate every joint, or identify with "
            "--preset best.",
        )
    return core.solve_upper(root, upper[:-1, -1]) / scale, root * scale


def autocorrelation(residual: core.Array, lag: int) -> core.Array:
    """(n) autocorrelation of (n, N) residuals at a lag."""
    centred = residual - residual.mean(axis=1, keepdims=True)
    energy = np.square(centred).sum(axis=1)
    product = (centred[:, lag:] * centred[:, :-lag]).sum(axis=1)
    return np.divide(product, energy, out=np.zeros_like(energy), where=energy > 0)


def residual_noise(
    factors: core.Array, values: core.Array, problem: IdentificationProblem
) -> core.Array:
    """(n) residual standard deviations, N - r/n degrees of freedom each."""
    norms = np.linalg.norm(factors @ np.append(values, -1.0), axis=1)
    freedom = problem.blocks - problem.base.rank / len(factors)
    # A joint that fits to rounding would get an infinite weight.
    floor = LEAST_NOISE * np.maximum(torque_scale(factors, problem), 1e-9)
    return np.maximum(norms / np.sqrt(max(freedom, 1.0)), floor)


def torque_scale(factors: core.Array, problem: IdentificationProblem) -> core.Array:
    """(n) root mean square of the torques, one where a joint carries none."""
    scale = np.linalg.norm(factors[:, :, -1], axis=1) / np.sqrt(problem.blocks)
    return np.where(scale > 0, scale, 1.0)


def pooled(noise: core.Array, groups: core.Indices) -> core.Array:
    """Noise (n) with the root mean square of its group in each joint's place."""
    return np.array([np.sqrt(np.mean(np.square(noise[groups == g]))) for g in groups])


HUBER = 1.345
"""95 % efficient on Gaussian noise."""
MAD_TO_SIGMA = 1.4826
MOST_ROBUST = 30


@dataclass(frozen=True, kw_only=True)
class HuberRegression(Estimator):
    """IRLS: rows far from the model count less, w = min(1, k s_j / |r|) (Huber 1964)."""

    name: ClassVar[str] = "irls"
    prior_gain: float | None = None
    """See `WeightedLeastSquares`."""

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        start = WeightedLeastSquares(prior_gain=self.prior_gain).fit(problem)
        values, noise = start.values, start.noise
        rows = residual = np.ones((problem.samples.joints, problem.blocks))
        for _ in range(MOST_ROBUST):
            residual = problem.residual(values)
            away = np.abs(residual - np.median(residual, axis=1, keepdims=True))
            spread = MAD_TO_SIGMA * np.median(away, axis=1)
            noise = np.maximum(spread, 1e-12 * np.abs(residual).max(initial=1e-12))
            rows = np.minimum(1.0, HUBER * noise[:, None] / (np.abs(residual) + 1e-300))
            # Least squares multiplies rows by the root of their weight.
            factors = joint_factors(problem, np.sqrt(rows))
            update, information = solve(factors, 1.0 / noise, problem.base, self.prior_gain)
            step = np.linalg.norm(information @ (update - values))
            size = np.linalg.norm(information @ update)
            values = update
            if step <= SETTLED * size:
                break
        # Torques that are clipped hold no parameter: errors follow the clipped residuals over the
        # share that is not (Huber 1981, chapter 7), half and more of residuals that centre on zero.
        free, clipped = (rows == 1.0).mean(axis=1), rows * residual / noise[:, None]
        free = np.maximum(free, 0.5)
        level = float(free.mean() / np.square(clipped).mean())
        held = joint_factors(problem) * np.sqrt(level * free)[:, None, None]
        return Fit(
            values=values,
            noise=noise,
            weights=1.0 / noise,
            information=solve(held, 1.0 / noise, problem.base, self.prior_gain)[1],
            row_weights=level * rows,
        )


WEAK_TORQUE = 1e-8
"""Share of the torque in the smallest singular vector below which there is no solution."""


@dataclass(frozen=True, kw_only=True)
class TotalLeastSquares(Estimator):
    """The nearest consistent system to [W tau], rows weighted, columns of unit norm.

    From the singular vector of [W tau] with the smallest singular value (Golub and Van Loan
    1980; Gautier, Vandanjon and Presse 1994 for robots). It presumes errors of equal size in
    all scaled columns, which robots do not have, and whose scales depend on how link frames lie:
    a yardstick, not a recommendation.
    """

    name: ClassVar[str] = "tls"
    by_factors: ClassVar[bool] = True

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        plain = WeightedLeastSquares().fit(problem)
        factors = joint_factors(problem)
        width = problem.base.rank + 1
        stacked = core.upper_triangle((factors * plain.weights[:, None, None]).reshape(-1, width))
        values = solve_total(stacked)
        # What it takes for errors of the columns may be none: as far off as it moved.
        moved = plain.information.T @ (plain.information @ (values - plain.values))
        noise, off = residual_noise(factors, values, problem), np.outer(moved, moved)
        return replace(plain, values=values, noise=noise, score_covariance=off)


def solve_total(augmented: core.Array) -> core.Array:
    """The total least-squares solution (r) of [A b] (m, r + 1), columns scaled to unit norm.

    Raises:
        JobError: The torque has no part in the smallest singular vector.
    """
    scale = np.linalg.norm(augmented, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    last = np.linalg.svd(augmented / scale, full_matrices=False)[2][-1]
    if abs(last[-1]) < WEAK_TORQUE:
        raise core.JobError(
            "total least squares has no solution for this record",
            next_step="Use --estimator wls; its columns are nearly dependent on each other.",
        )
    return -last[:-1] / last[-1] * scale[-1] / scale[:-1]


@dataclass(frozen=True, kw_only=True)
class RecursiveLeastSquares(Estimator):
    """Recursive least squares over the record in order of time, rows weighted by joint noise.

    The square-root information filter: one small QR a batch of rows, nothing is inverted (Bierman
    1977), see `joint_factors`. At the end it equals weighted least squares over all rows.
    """

    name: ClassVar[str] = "rls"

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        return _weighted(problem, 1.0 / WeightedLeastSquares().fit(problem).noise)
