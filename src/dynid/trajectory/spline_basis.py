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
    columns = spline_columns(t, knots, degree)
    first = _slope(columns[-2], knots, degree)
    second = _slope(_slope(columns[-3], knots, degree - 1), knots, degree)
    return columns[-1], first, second


def spline_columns(t: Array, knots: Array, degree: int) -> list[Array]:
    """The columns of every degree from 0 to `degree`, on the same knots.

    Args:
        t: (N) times from the first knot to the last one [s].
        knots: (K + degree + 1) knots, repeated at the ends [s].
        degree: The highest degree.

    Returns:
        degree + 1 matrices, (N, K + degree) down to (N, K).
    """
    spans = len(knots) - 1
    values = np.zeros((len(t), spans))
    # The last knot belongs to the last span that is not empty.
    last = np.count_nonzero(knots < knots[-1]) - 1
    span = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, last)
    values[np.arange(len(t)), span] = 1.0
    columns = [values]
    for order in range(1, degree + 1):
        # Divided, not multiplied by an inverse: one at the end of a span, to the last bit.
        rise = (t[:, None] - knots[None, :-order]) / _widths(knots, order)
        values = rise[:, :-1] * values[:, :-1] + (1.0 - rise[:, 1:]) * values[:, 1:]
        columns.append(values)
    return columns


def power_coefficients(control: Array, knots: Array, degree: int) -> Array:
    """Each span's polynomial in ascending powers of its own time from 0 to 1.

    Args:
        control: (n, K) control points.
        knots: (K + degree + 1) clamped knots [s].
        degree: Degree of the polynomials.

    Returns:
        (spans, n, degree + 1) coefficients, in the unit of the control points.
    """
    inner = knots[degree:-degree]
    width = np.diff(inner)
    result = np.empty((len(width), len(control), degree + 1))
    factor = np.ones(len(width))
    for order in range(degree + 1):
        # A derivative is a spline of one degree less, on the knots without the outer two.
        left = degree - order
        values = spline_columns(inner[:-1], knots, left)[-1] @ control.T
        result[:, :, order] = values * factor[:, None]
        if left:
            control = np.diff(control, axis=1) * (
                left / (knots[left + 1 : -1] - knots[1 : -left - 1])
            )
            knots = knots[1:-1]
            factor = factor * width / (order + 1)
    return result


def _slope(lower: Array, knots: Array, order: int) -> Array:
    """The derivative's columns, from the columns of one degree less."""
    scaled = lower * (order / _widths(knots, order))
    return scaled[:, :-1] - scaled[:, 1:]


def _widths(knots: Array, order: int) -> Array:
    """Widths of the columns' supports; 1 for repeated knots, whose columns are zero anyway."""
    width = knots[order:] - knots[:-order]
    width[width <= 0] = 1.0
    return width
