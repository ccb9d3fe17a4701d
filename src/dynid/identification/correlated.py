"""Covariance under a first-order autoregressive model of the residuals.

Newey-West sums are free of assumptions but fall short when a record holds few independent
stretches: fitting has taken the slow part of the noise away. Here each joint's noise is AR(1)
with the correlation and variance whose residuals, after the fit, would look like those found.
"""

from __future__ import annotations

import numpy as np
from scipy import signal  # pyright: ignore[reportMissingTypeStubs]

from dynid.core.arrays import Array
from dynid.core.linalg import inverse_upper
from dynid.identification.least_squares import Fit
from dynid.identification.problem import IdentificationProblem

ITERATIONS = 6
LARGEST_CORRELATION = 0.998
MOST_ROWS = 6000
"""Rows a joint that are looked at; longer records are thinned."""
NEGLIGIBLE = 0.05
"""Correlation at one row below which the noise counts as white."""


def ar_covariance(fit: Fit, problem: IdentificationProblem, residual: Array) -> Array:
    """(r, r) covariance if each joint's noise is AR(1).

    Args:
        fit: The solution.
        problem: Its problem.
        residual: (n, N) residuals [N.m or N].
    """
    stride = -(-problem.blocks // MOST_ROWS)
    # In coordinates where the information of these rows is the identity, traces are plain sums.
    inverse = inverse_upper(fit.information) * np.sqrt(stride)
    designs = _whitened_columns(fit, problem, inverse, stride)
    rows = residual[:, ::stride] * fit.weights[:, None]
    count = rows.shape[1]
    lag0 = np.square(rows).sum(axis=1)
    lag1 = (rows[:, 1:] * rows[:, :-1]).sum(axis=1)
    observed = np.divide(lag1, lag0, out=np.zeros_like(lag0), where=lag0 > 0)
    rho: Array = np.clip(observed, 0.0, LARGEST_CORRELATION)
    variance = lag0 / count
    for _ in range(ITERATIONS):
        smoothed = [_correlate(x, r) for x, r in zip(designs, rho.tolist(), strict=True)]
        crossed = np.array([x.T @ s for x, s in zip(designs, smoothed, strict=True)])
        spread = np.tensordot(variance, crossed, axes=1)
        expected0, expected1 = _expected_sums(designs, smoothed, spread, rho, variance)
        variance = variance * np.clip(lag0 / np.maximum(expected0, 1e-300), 0.2, 5.0)
        wanted = np.clip(expected1 / np.maximum(expected0, 1e-300), -1.0, 1.0)
        # Work on log(1 - rho): near one, that is what the sums respond to.
        gain = np.log1p(-np.minimum(observed, 0.9995)) - np.log1p(-np.minimum(wanted, 0.9995))
        update = 1 - (1 - rho) * np.exp(np.clip(gain, -1.0, 1.0))
        rho = np.where(observed > NEGLIGIBLE, np.clip(update, 0.0, LARGEST_CORRELATION), rho)
        if np.abs(gain).max() < 0.02:
            break
    smoothed = [_correlate(x, r) for x, r in zip(designs, rho.tolist(), strict=True)]
    crossed = np.array([x.T @ s for x, s in zip(designs, smoothed, strict=True)])
    spread = np.tensordot(variance * _thinning(rho, stride), crossed, axes=1)
    return inverse @ spread @ inverse.T


def _thinning(rho: Array, stride: int) -> Array:
    """(n) variance of a mean of all rows over that of every `stride`-th, rho between those."""
    if stride == 1:
        return np.ones_like(rho)
    single = np.maximum(rho, 1e-12) ** (1.0 / stride)
    return (1 + single) / (1 - single) / stride / ((1 + rho) / (1 - rho))


def _whitened_columns(
    fit: Fit, problem: IdentificationProblem, inverse: Array, stride: int
) -> Array:
    """(n, N / stride, r) weighted columns times the inverse root of the information."""
    parts = [
        columns[:, :, -rows.start % stride :: stride].transpose(1, 2, 0) @ inverse
        for rows, columns, _ in problem.chunks()
    ]
    return np.concatenate(parts, axis=1) * fit.weights[:, None, None]


def _correlate(columns: Array, rho: float) -> Array:
    """Omega X for the correlation matrix Omega_ts = rho^|t - s|."""
    if rho < NEGLIGIBLE:
        return columns
    ahead = _recursion(columns, rho)
    behind = _recursion(columns[::-1], rho)[::-1]
    return ahead + behind - columns


def _recursion(columns: Array, rho: float) -> Array:
    """y_t = x_t + rho y_(t-1) along the first axis."""
    filtered = signal.lfilter([1.0], [1.0, -rho], columns, axis=0)  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
    return np.asarray(filtered, dtype=np.float64)


def _expected_sums(
    designs: Array, smoothed: list[Array], spread: Array, rho: Array, variance: Array
) -> tuple[Array, Array]:
    """Expected lag-0 and lag-1 sums of products of each joint's residuals after the fit."""
    count = designs.shape[1]
    lag0, lag1 = np.empty(len(designs)), np.empty(len(designs))
    for j, (x, s) in enumerate(zip(designs, smoothed, strict=True)):
        back = x @ spread
        shared0 = float((x * s).sum())
        shared1 = float((s[1:] * x[:-1]).sum() + (s[:-1] * x[1:]).sum())
        lag0[j] = variance[j] * (count - 2 * shared0) + float((back * x).sum())
        lag1[j] = variance[j] * (rho[j] * (count - 1) - shared1) + float((back[1:] * x[:-1]).sum())
    return lag0, lag1
