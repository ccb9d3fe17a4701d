"""Uncertainty that can be believed: naive and autocorrelation-consistent covariances."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.core.linalg import inverse_upper, solve_upper
from dynid.identification.correlated import ar_covariance
from dynid.identification.least_squares import Fit, autocorrelation
from dynid.identification.problem import IdentificationProblem

MIN_LAG_S = 0.3
"""Correlation of residuals is looked for at least this far [s]."""
MAX_LAG_SHARE = 0.1
"""... and at most over this share of the record."""

UNSEEN = 1e-18
"""Share of the naive variance below which sums of scores are those of an empty column."""
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
    scores = np.empty((problem.base.rank, problem.blocks))
    residual = np.empty((problem.samples.joints, problem.blocks))
    square = np.square(fit.weights)[:, None]
    for part, columns, torque in problem.chunks():
        residual[:, part] = torque - np.tensordot(fit.values, columns, axes=1)
        weighted = residual[:, part] * square
        if fit.row_weights is not None:
            weighted = weighted * fit.row_weights[:, part]
        scores[:, part] = np.einsum("rjt,jt->rt", columns, weighted, optimize=True)
    lag = correlation_lag(residual, problem.rate_hz)
    long_run = long_run_covariance(scores, lag)
    inverse = inverse_upper(fit.information)
    bread = inverse @ inverse.T
    covariance = bread @ long_run @ bread
    # Bartlett weights and fitted residuals both shrink S; the classical corrections restore it.
    samples = problem.blocks
    freedom = samples / max(samples - problem.base.rank / len(fit.noise), 1.0)
    short = 1.0 / max(1.0 - 2.0 * lag / samples, 0.5)
    covariance *= freedom * short
    if fit.prior_precision is not None:
        covariance += bread @ fit.prior_precision @ bread
    # Sums over few independent stretches fall short: never below the parametric answers.
    floor = np.diag(naive_covariance(fit))
    if autocorrelation(residual, 1).max() > MODEL_CORRELATION and fit.row_weights is None:
        floor = np.maximum(floor, np.diag(ar_covariance(fit, problem, residual)))
    # Of what no torque shows only the prior speaks: no scores, no sums to raise.
    unseen = np.diag(covariance) <= UNSEEN * floor
    covariance[unseen, :] = covariance[:, unseen] = 0.0
    covariance[unseen, unseen] = floor[unseen]
    raise_to = np.sqrt(np.maximum(floor / np.maximum(np.diag(covariance), 1e-300), 1.0))
    return covariance * raise_to[:, None] * raise_to[None, :]


def moved_by_prior(fit: Fit, problem: IdentificationProblem) -> Array:
    """(r) how far a solution lies from the weighted least-squares one, which has no prior.

    From the normal equations: H^-1 sum_j w_j^2 W_j' r_j, the wrong way round.
    """
    pull = np.zeros(problem.base.rank)
    square = np.square(fit.weights)[:, None]
    for _, columns, torque in problem.chunks():
        residual = torque - np.tensordot(fit.values, columns, axes=1)
        pull += np.einsum("rjt,jt->r", columns, residual * square, optimize=True)
    inverse = inverse_upper(fit.information)
    return np.asarray(-inverse @ (inverse.T @ pull), dtype=np.float64)


def correlation_lag(residual: Array, rate_hz: float) -> int:
    """Lags to include, from the residuals' autocorrelation.

    Andrews' rule for Bartlett weights with an AR(1) fit, the slowest joint, and never less
    than `MIN_LAG_S`.
    """
    samples = residual.shape[1]
    rho = np.clip(autocorrelation(residual, 1), 0.0, 0.995)
    alpha = 4 * rho**2 / ((1 - rho) ** 2 * (1 + rho) ** 2)
    rule = 1.1447 * (float(alpha.max(initial=0.0)) * samples) ** (1 / 3)
    least = MIN_LAG_S * rate_hz if rho.max(initial=0.0) > 0.2 else 1.0
    return int(np.clip(np.ceil(max(rule, least)), 1, max(1, int(MAX_LAG_SHARE * samples))))


def long_run_covariance(scores: Array, lag: int) -> Array:
    """(r, r) sum of autocovariances of scores (r, N) with Bartlett weights up to `lag`."""
    samples = scores.shape[1]
    size = 1 << (samples + lag).bit_length()
    taps = 1.0 - np.arange(lag + 1) / (lag + 1.0)
    kernel = np.zeros(size)
    kernel[: lag + 1] = taps
    kernel[size - lag :] = taps[:0:-1]
    # The kernel is symmetric, so its spectrum is real.
    spectrum = np.fft.rfft(kernel).real
    smooth = np.fft.irfft(np.fft.rfft(scores, size, axis=1) * spectrum, size, axis=1)
    result = scores @ smooth[:, :samples].T
    return (result + result.T) / 2


def relative_std_percent(values: Array, std: Array) -> Array:
    """(r) 100 std / |value|, infinite for a value of zero."""
    size = np.abs(values)
    return 100.0 * np.divide(std, size, out=np.full_like(std, np.inf), where=size > 0)


def essential_parameters(fit: Fit, *, ratio: float = 30.0) -> tuple[int, ...]:
    """The parameters that the data really speak about (Pham and Gautier 1991).

    Drops the parameter with the largest relative standard deviation and fits again until the
    largest is at most `ratio` times the smallest and below 100 %.

    Args:
        fit: A solution.
        ratio: Largest over smallest relative standard deviation of what stays.

    Returns:
        Indices of the base parameters that stay.
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
        if relative[worst] <= max(ratio * relative.min(), 1e-9) and relative[worst] < 100.0:
            break
        kept.pop(worst)
    return tuple(kept)
