"""Criteria of extreme eigenvalues, smoothed for an optimiser.

Where several eigenvalues share the smallest place, as they do near every optimum, the smallest
one has a kink and a gradient method stops there. Norms take its place: with p the sharpness,
(sum lambda^p)^(1/p) for the largest and (sum lambda^-p)^(-1/p) for the smallest, which are
smooth, bound the true ones, and meet them as p grows. p = 1 for the smallest is A-optimality.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.excitation.criteria import (
    Condition,
    ConditionAndSigma,
    Criterion,
    EOptimal,
    ScaledCondition,
)
from dynid.excitation.criteria_matrix import eigenvectors, normalised

Extreme = tuple[float, Array]
"""Logarithm of a soft extreme, and its derivative (b) by the logarithms of the eigenvalues."""


def smoothed(criterion: Criterion, sharpness: float) -> Criterion:
    """The smooth relative of a criterion; criteria that are smooth come back as they are.

    Args:
        criterion: Any criterion.
        sharpness: The exponent p; the larger, the nearer to the criterion.
    """
    scale, previous = criterion.scale, criterion.previous
    match criterion:
        case Condition():
            return SmoothCondition(scale=scale, previous=previous, sharpness=sharpness)
        case ScaledCondition():
            return SmoothScaledCondition(scale=scale, previous=previous, sharpness=sharpness)
        case EOptimal():
            return SmoothEOptimal(scale=scale, previous=previous, sharpness=sharpness)
        case ConditionAndSigma():
            weight = criterion.weight
            return SmoothConditionAndSigma(
                scale=scale, previous=previous, sharpness=sharpness, weight=weight
            )
        case _:
            return criterion


@dataclass(frozen=True, kw_only=True)
class SmoothCondition(Condition):
    """The condition number with norms for the extreme eigenvalues."""

    sharpness: float

    def evaluate(self, matrix: Array, *, slope: bool) -> tuple[float, Array] | None:
        """See `Criterion`."""

        def ratio(largest: Extreme, smallest: Extreme) -> tuple[float, Array]:
            value = math.exp((largest[0] - smallest[0]) / 2)
            return value, value / 2 * (largest[1] - smallest[1])

        return _of_extremes(matrix, self.sharpness, ratio)


@dataclass(frozen=True, kw_only=True)
class SmoothScaledCondition(ScaledCondition):
    """The same of the columns scaled to unit norm."""

    sharpness: float

    def evaluate(self, matrix: Array, *, slope: bool) -> tuple[float, Array] | None:
        """See `Criterion`."""
        unit = normalised(matrix)
        inner = SmoothCondition(sharpness=self.sharpness)
        found = None if unit is None else inner.evaluate(unit[0], slope=slope)
        if unit is None or found is None:
            return found
        through_norms = (found[1] * unit[0]).sum(axis=1) / np.square(unit[1])
        return found[0], found[1] / unit[1][:, None] / unit[1] - np.diag(through_norms)


@dataclass(frozen=True, kw_only=True)
class SmoothEOptimal(EOptimal):
    """1 / lambda_min with a norm for the smallest eigenvalue."""

    sharpness: float

    def evaluate(self, matrix: Array, *, slope: bool) -> tuple[float, Array] | None:
        """See `Criterion`."""

        def inverse(_largest: Extreme, smallest: Extreme) -> tuple[float, Array]:
            value = math.exp(-smallest[0])
            return value, -value * smallest[1]

        return _of_extremes(matrix, self.sharpness, inverse)


@dataclass(frozen=True, kw_only=True)
class SmoothConditionAndSigma(ConditionAndSigma):
    """cond + weight / sigma_min with norms for the extreme eigenvalues."""

    sharpness: float

    def evaluate(self, matrix: Array, *, slope: bool) -> tuple[float, Array] | None:
        """See `Criterion`."""

        def both(largest: Extreme, smallest: Extreme) -> tuple[float, Array]:
            condition = math.exp((largest[0] - smallest[0]) / 2)
            sigma = self.weight * math.exp(-smallest[0] / 2)
            slopes = condition / 2 * (largest[1] - smallest[1]) - sigma / 2 * smallest[1]
            return condition + sigma, slopes

        return _of_extremes(matrix, self.sharpness, both)


def _of_extremes(
    matrix: Array, sharpness: float, combine: Callable[[Extreme, Extreme], tuple[float, Array]]
) -> tuple[float, Array] | None:
    """A function of the soft extremes, and its derivative by the matrix; None if singular.

    Args:
        matrix: (b, b) symmetric.
        sharpness: The exponent p.
        combine: From the largest and the smallest to the value, and its derivative (b) by the
            logarithms of the eigenvalues.
    """
    found = eigenvectors(matrix)
    if found is None:
        return None
    values, vectors = found
    value, slopes = combine(*_extremes(values, sharpness))
    return value, (vectors * (slopes / values)) @ vectors.T


def _extremes(values: Array, p: float) -> tuple[Extreme, Extreme]:
    """Logarithms of the soft largest and smallest of (b), and d log / d log values (b) of each."""
    logs = np.log(values)
    high, low = np.exp(p * (logs - logs[-1])), np.exp(-p * (logs - logs[0]))
    largest = float(logs[-1] + math.log(high.sum()) / p)
    smallest = float(logs[0] - math.log(low.sum()) / p)
    return (largest, high / high.sum()), (smallest, low / low.sum())
