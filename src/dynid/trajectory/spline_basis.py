"""The columns of a clamped uniform B-spline."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array


def clamped_knots(duration: float, count: int, degree: int) -> Array:
    """Knots at equal distances, the first and last ones repeated degree + 1 times.

    Args:
        duration: Last knot [s]; the first one is 0.
        count: Number of control points, more than the degree.
        degree: Degree of the polynomials.

    Returns:
        (count + degree + 1) knots [s].
    """
    inner = np.linspace(0.0, duration, count - degree + 1)
    return np.concatenate([np.zeros(degree), inner, np.full(degree, duration)])


def spline_basis(t: Array, knots: Array, degree: int) -> tuple[Array, Array, Array]:
    """Each control point's column and its first two time derivatives (Cox, de Boor).

    Args:
        t: (N) times from the first knot to the last one [s].
        knots: (K + degree + 1) clamped knots [s].
        degree: Degree of the polynomials, at least 2.

    Returns:
        Three (N, K) matrices [1, 1/s, 1/s^2].
    """
    spans = len(knots) - 1
    values = np.zeros((len(t), spans))
    # The last knot belongs to the last span that is not empty.
    span = np.clip(np.searchsorted(knots, t, side="right") - 1, degree, spans - 1 - degree)
    values[np.arange(len(t)), span] = 1.0
    lower: list[Array] = []
    for order in range(1, degree + 1):
        lower.append(values)
        # Divided, not multiplied by an inverse: one at the end of a span, to the last bit.
        rise = (t[:, None] - knots[None, :-order]) / _widths(knots, order)
        values = rise[:, :-1] * values[:, :-1] + (1.0 - rise[:, 1:]) * values[:, 1:]
    first = _slope(lower[-1], knots, degree)
    second = _slope(_slope(lower[-2], knots, degree - 1), knots, degree)
    return values, first, second


def _slope(lower: Array, knots: Array, order: int) -> Array:
    """The derivative's columns, from the columns of one degree less."""
    scaled = lower * (order / _widths(knots, order))
    return scaled[:, :-1] - scaled[:, 1:]


def _widths(knots: Array, order: int) -> Array:
    """Widths of the columns' supports; 1 for repeated knots, whose columns are zero anyway."""
    width = knots[order:] - knots[:-order]
    return np.where(width > 0, width, 1.0)
