"""Calibrated uncertainty: naive and autocorrelation-consistent covariances."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dynid.core import Array, inverse_upper, scipy_part, solve_upper
from dynid.identification.least_squares import Fit, autocorrelation
from dynid.identification.problem import IdentificationProblem

ITERATIONS = 8
SETTLED = 0.03
"""Change of correlations and shares that ends the search."""
FARTHEST = 60
"""Rows up to which the correlation's decay is followed."""
LARGEST_CORRELATION = 0.998
MOST_ROWS = 6000
"""Rows a joint that are looked at; longer records are thinned."""
NEGLIGIBLE = 0.05
"""Correlation at one row below which the noise counts as white."""


def ar_root(fit: Fit, problem: IdentificationProblem, residual: Array) -> Array:
    """(r, r) root G of the covariance G G' if the noise of each joint is AR(1) plus white noise.

    Of residuals (n, N).
    """
    stride = -(-problem.blocks // MOST_ROWS)
    # In coordinates where the information of these rows is the identity, traces are plain sums.
    inverse = inverse_upper(fit.information) * np.sqrt(stride)
    designs = _whitened_columns(fit, problem, inverse, stride)
    rows = residual[:, ::stride] * fit.weights[:, None]
    count = rows.shape[1]
    lag0 = np.square(rows).sum(axis=1)
    lag1 = (rows[:, 1:] * rows[:, :-1]).sum(axis=1)
    reach = _reach(rows, lag0, lag1)
    own = np.array([_beside(x[:, None], m)[2:, :, 0] for x, m in zip(rows, reach, strict=True)])
    near, late = (own * rows[:, None]).sum(axis=2).T / 2
    beside = [_beside(x, m) for x, m in zip(designs, reach, strict=True)]
    observed = np.divide(lag1, lag0, out=np.zeros_like(lag0), where=lag0 > 0)
    start = _ratio(late, near) ** (1.0 / np.array(reach))
    start = np.where(observed > NEGLIGIBLE, np.minimum(start, LARGEST_CORRELATION), 0.0)
    level = _ratio(near, lag0) / np.maximum(_series(start, reach), 1e-3)
    noise = _Noise(
        rho=np.where(level < 1.0, start, np.clip(observed, 0.0, LARGEST_CORRELATION)),
        share=np.clip(level, 0.05, 1.0),
        variance=lag0 / count,
    )
    for _ in range(ITERATIONS):
        expected = _expected_sums(designs, beside, noise, reach)
        variance = noise.variance * np.clip(lag0 / np.maximum(expected[0], 1e-300), 0.2, 5.0)
        wanted = np.clip(expected[1] / np.maximum(expected[0], 1e-300), -1.0, 1.0)
        # Work on log(1 - rho): near one, that is what the sums respond to.
        gain = np.log1p(-np.minimum(observed, 0.9995)) - np.log1p(-np.minimum(wanted, 0.9995))
        alone = 1 - (1 - noise.rho) * np.exp(np.clip(gain, -1.0, 1.0))
        decay = _ratio(late, near) / np.maximum(_ratio(expected[3], expected[2]), 1e-3)
        slower = noise.rho * np.clip(decay, 0.2, 5.0) ** (1.0 / np.array(reach))
        slower = np.minimum(slower, LARGEST_CORRELATION)
        level = _ratio(near, lag0) / np.maximum(_ratio(expected[2], expected[0]), 1e-3)
        level *= _series(noise.rho, reach) / np.maximum(_series(slower, reach), 1e-3)
        share = np.clip(noise.share * np.clip(level, 0.2, 5.0), 0.05, 1.0)
        # Without room for white noise the first lag alone decides, as for AR(1).
        rho = np.where(share < 1.0, slower, alone)
        rho = np.where(observed > NEGLIGIBLE, np.clip(rho, 0.0, LARGEST_CORRELATION), noise.rho)
        moved = np.abs(np.log1p(-rho) - np.log1p(-noise.rho)).max(initial=0.0)
        moved = max(float(moved), float(np.abs(share - noise.share).max(initial=0.0)))
        noise = _Noise(rho=rho, share=share, variance=variance)
        if moved < SETTLED:
            break
    _, spread = _spread(designs, noise, noise.variance * _thinning(noise, stride))
    values, vectors = np.linalg.eigh(spread)
    return inverse @ (vectors * np.sqrt(np.maximum(values, 0.0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Noise:
    """Correlation share rho^k at k rows, k > 0; all (n)."""

    rho: Array
    share: Array
    variance: Array

    def correlate(self, columns: Array, joint: int) -> Array:
        """Omega X for the correlation matrix Omega."""
        rho, share = float(self.rho[joint]), float(self.share[joint])
        if share * rho < NEGLIGIBLE:
            return columns
        # y_t = x_t + rho y_(t-1), along the rows and back.
        recursion = scipy_part("signal").lfilter
        ahead = recursion([1.0], [1.0, -rho], columns, axis=0)
        behind = recursion([1.0], [1.0, -rho], columns[::-1], axis=0)[::-1]
        return share * (ahead + behind) + (1.0 - 2.0 * share) * columns


def _reach(rows: Array, lag0: Array, lag1: Array) -> list[int]:
    """(n) rows after which half of the correlation at one row is left."""
    found: list[int] = []
    for row, own, first in zip(rows, lag0, lag1, strict=True):
        most = max(1, min(FARTHEST, len(row) // 20))
        lag = 1
        while lag < most and own > 0 and float(row[lag + 1 :] @ row[: -lag - 1]) > first / 2:
            lag += 1
        found.append(lag)
    return found


def _beside(columns: Array, reach: int) -> Array:
    """(4, N, r) sums of the rows before and after each one at the lags of `_expected_sums`."""
    count = len(columns)
    total = np.vstack([np.zeros((1, columns.shape[1])), np.cumsum(columns, axis=0)])
    here = np.arange(count)

    def within(lag: int) -> Array:
        return total[np.minimum(here + lag + 1, count)] - total[np.maximum(here - lag, 0)]

    narrow, middle, wide = (within(k * reach) for k in range(3))
    return np.stack([2 * columns, within(1) - narrow, middle - narrow, wide - middle])


def _ratio(part: Array, whole: Array) -> Array:
    share = np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)
    return np.maximum(share, 0.0)


def _series(rho: Array, reach: list[int]) -> Array:
    """(n) rho + ... + rho^m."""
    return rho * (1 - rho ** np.array(reach)) / (1 - rho)


def _spread(designs: Array, noise: _Noise, variance: Array) -> tuple[list[Array], Array]:
    """Omega X of each joint, and the sum of X' Omega X times its variance."""
    smoothed = [noise.correlate(x, j) for j, x in enumerate(designs)]
    crossed = np.array([x.T @ s for x, s in zip(designs, smoothed, strict=True)])
    return smoothed, np.tensordot(variance, crossed, axes=1)


def _thinning(noise: _Noise, stride: int) -> Array:
    """(n) variance of a mean of all rows over that of every `stride`-th, rho between those."""
    if stride == 1:
        return np.ones_like(noise.rho)
    single = np.maximum(noise.rho, 1e-12) ** (1.0 / stride)
    every = 1 + 2 * noise.share * single / (1 - single)
    return every / stride / (1 + 2 * noise.share * noise.rho / (1 - noise.rho))


def _whitened_columns(
    fit: Fit, problem: IdentificationProblem, inverse: Array, stride: int
) -> Array:
    """(n, N / stride, r) weighted columns times the inverse root of the information."""
    parts = [
        columns[:, :, -rows.start % stride :: stride].transpose(1, 2, 0) @ inverse
        for rows, columns, _ in problem.chunks()
    ]
    return np.concatenate(parts, axis=1) * fit.weights[:, None, None]


def _expected_sums(designs: Array, beside: list[Array], noise: _Noise, reach: list[int]) -> Array:
    """(4, n) expected sums of products of each joint's residuals after the fit.

    At lag 0, at lag 1, and over the lags 1 to m and m + 1 to 2 m.
    """
    count = designs.shape[1]
    smoothed, spread = _spread(designs, noise, noise.variance)
    sums = np.empty((4, len(designs)))
    for j, (x, s, others) in enumerate(zip(designs, smoothed, beside, strict=True)):
        lags = np.arange(1, 2 * reach[j] + 1)
        each = noise.share[j] * noise.rho[j] ** lags * (count - lags)
        own = np.array([count, each[0], each[: reach[j]].sum(), each[reach[j] :].sum()])
        taken = np.einsum("inr,nr->i", others, s)
        given = np.einsum("inr,nr->i", others, x @ spread) / 2
        sums[:, j] = noise.variance[j] * (own - taken) + given
    return sums


MIN_LAG_S = 0.3
"""Correlation of residuals is looked for at least this far [s]."""
MAX_LAG_SHARE = 0.1
"""... and at most over this share of the record."""

MODEL_CORRELATION = 0.2
"""Autocorrelation at one row from which a model of the noise supports the Newey-West sums."""


def naive_covariance(fit: Fit) -> Array:
    """(r, r) covariance if the residuals were white: s^2 (W' Omega^-1 W)^-1."""
    # Degrees of freedom are in the noise already: one for weighted fits, s^2 for ordinary ones.
    variance = float(np.mean(np.square(fit.noise * fit.weights)))
    inverse = inverse_upper(fit.information)
    return variance * (inverse @ inverse.T)


def hac_covariance(fit: Fit, problem: IdentificationProblem) -> Array:
    """(r, r) covariance that allows for correlated and unequal residuals.

    Sandwich H^-1 S H^-1 with the Newey-West (Bartlett) long-run covariance S of the scores
    sum_j w_j^2 W_j' r_j, summed over joints at each instant, so that correlation between
    joints counts too. The lag grows with the correlation time of the residuals (Andrews 1991).
    """
    scores, residual = scores_of(
        problem.chunks(), problem.blocks, fit.values, fit.weights, fit.row_weights
    )
    if fit.row_weights is not None:
        residual = residual * fit.row_weights
    lag = correlation_lag(residual, problem.rate_hz)
    floor = None
    if autocorrelation(residual, 1).max() > MODEL_CORRELATION:
        floor = ar_root(fit, problem, residual)
    bread, long_run = inverse_upper(fit.information).T, long_run_covariance(scores, lag)
    return sandwich(fit, bread, long_run, problem.blocks, lag, floor)


def scores_of(
    chunks: Iterable[tuple[slice, Array, Array]],
    rows: int,
    values: Array,
    weights: Array,
    row_weights: Array | None = None,
) -> tuple[Array, Array]:
    """Scores (r, N) and residuals (n, N) of so many rows at values (r), weighted by joint (n).

    Of parts with their columns (r, n, T) and torques (n, T); `row_weights` (n, N) as of a `Fit`.
    """
    scores, residual = np.empty((len(values), rows)), np.empty((len(weights), rows))
    square = np.square(weights)[:, None]
    for part, columns, torque in chunks:
        residual[:, part] = torque - np.tensordot(values, columns, axes=1)
        weighted = residual[:, part] * square
        if row_weights is not None:
            weighted = weighted * row_weights[:, part]
        scores[:, part] = np.einsum("rjt,jt->rt", columns, weighted, optimize=True)
    return scores, residual


def sandwich(
    fit: Fit, bread: Array, long_run: Array, rows: int, lag: int, floor: Array | None
) -> Array:
    """(r, r) covariance from the long-run covariance of the scores.

    `bread` (r, r) is the fit's information root times the inverse information for the weights of
    the scores, `long_run` (r, r) from `long_run_covariance` over so many rows a joint and so many
    lags. No combination of parameters has a variance below the naive one, or that of a root `floor`
    (r, r).
    """
    # Bartlett weights and fitted residuals both shrink S; the classical corrections restore it.
    freedom = rows / max(rows - len(fit.values) / len(fit.noise), 1.0)
    short = 1.0 / max(1.0 - 2.0 * lag / rows, 0.5)
    scores = long_run * freedom * short
    if fit.score_covariance is not None:
        scores = scores + fit.score_covariance
    # Sums over few independent stretches fall short: never below the parametric answers.
    white = at_least(bread @ scores @ bread.T, float(np.mean(np.square(fit.noise * fit.weights))))
    if floor is not None:
        values, vectors = np.linalg.eigh(white)
        root = vectors * np.sqrt(values)
        part = (vectors / np.sqrt(values)).T @ (fit.information @ floor)
        white = root @ at_least(part @ part.T, 1.0) @ root.T
    inverse = inverse_upper(fit.information)
    return inverse @ white @ inverse.T


def at_least(matrix: Array, least: float) -> Array:
    """A symmetric matrix (r, r) with no eigenvalue below `least`.

    Raised one by one, variances of base parameters depend on link frames: where base columns hardly
    differ, their torques cancel, and no more where one of them is raised alone.
    """
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return (vectors * np.maximum(values, least)) @ vectors.T


def raised(covariance: Array, floor: Array) -> Array:
    """Covariances (..., r, r) with no variance below a floor (..., r), the correlations kept."""
    own = np.einsum("...ii->...i", covariance)
    lift = np.sqrt(np.maximum(floor / np.maximum(own, 1e-300), 1.0))
    return covariance * lift[..., :, None] * lift[..., None, :]


def correlation_lag(
    residual: Array, rate_hz: float, rows: int | None = None, *, below_white: bool = False
) -> int:
    """Lags to include, from the residuals' autocorrelation.

    Andrews' rule for Bartlett weights with AR(1) noise, the slowest joint, and never less than
    `MIN_LAG_S`. `rows` is how many rows there are where the residuals are a part of them. With
    `below_white` the slow noise may lie below white noise: more lags, whose sums scatter more, for
    where no `ar_covariance` stands below them.
    """
    samples = rows or residual.shape[1]
    first = np.clip(autocorrelation(residual, 1), 0.0, 0.995)
    rho = first
    if below_white:
        # The first lag alone would understate a slow part below white noise: its decay counts.
        square = np.square(residual).sum(axis=1)
        rho = np.maximum(0.5 ** (1 / np.array(_reach(residual, square, first * square))), first)
    share = 2 * first / (1 - rho)
    alpha = np.square(share / (1 - rho) / (1 + share))
    rule = 1.1447 * (float(alpha.max(initial=0.0)) * samples) ** (1 / 3)
    least = MIN_LAG_S * rate_hz if first.max(initial=0.0) > 0.2 else 1.0
    return int(np.clip(np.ceil(max(rule, least)), 1, max(1, int(MAX_LAG_SHARE * samples))))


def long_run_covariance(scores: Array, lag: int) -> Array:
    """(r, r) sum of autocovariances of scores (r, N) with Bartlett weights up to `lag`."""
    taps = 1.0 - np.abs(np.arange(-lag, lag + 1)) / (lag + 1.0)
    smooth = scipy_part("signal").oaconvolve(scores, taps[None], mode="same", axes=1)
    result = scores @ np.asarray(smooth, dtype=np.float64).T
    return (result + result.T) / 2


def relative_std_percent(values: Array, std: Array) -> Array:
    """(r) 100 std / |value|, infinite for a value of zero."""
    size = np.abs(values)
    return 100.0 * np.divide(std, size, out=np.full_like(std, np.inf), where=size > 0)


_LARGEST_RATIO = 30.0
"""Largest over smallest relative standard deviation of what is essential."""


def essential_parameters(fit: Fit) -> tuple[int, ...]:
    """Indices of the base parameters that the data determine (Pham and Gautier 1991).

    Drops the parameter with the largest relative standard deviation and fits again until the
    largest is at most 30 times the smallest and below 100 %.
    """
    upper = fit.information
    kept = list(range(len(fit.values)))
    target = upper @ fit.values
    while len(kept) > 1:
        reduced = np.linalg.qr(np.column_stack([upper[:, kept], target]))[1]
        count = len(kept)
        root = reduced[:count, :count]
        values = solve_upper(root, reduced[:count, count])
        inverse = inverse_upper(root)
        scale = np.mean(np.square(fit.noise * fit.weights))
        relative = relative_std_percent(values, np.sqrt(scale * np.square(inverse).sum(axis=1)))
        worst = int(np.argmax(relative))
        alike = relative[worst] <= max(_LARGEST_RATIO * relative.min(), 1e-9)
        if alike and relative[worst] < 100.0:
            break
        kept.pop(worst)
    return tuple(kept)
