"""The fifth-order polynomials on 0 to 1 that everything at rest is blended with.

Coefficients stand in ascending powers of s = t / duration, six a polynomial.
"""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array, read_only

STEP = read_only(np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]))
"""From 0 to 1 with no velocity and acceleration at either end."""

VELOCITY = read_only(np.array([0.0, 1.0, 0.0, -10.0, 15.0, -6.0]))
"""Velocity 1 at both ends, position and acceleration 0."""

ACCELERATION = read_only(np.array([0.0, 0.0, 0.5, -1.0, 0.5, 0.0]))
"""Acceleration 1 at both ends, position and velocity 0."""


def horner(coefficients: Array, s: Array) -> Array:
    """Values of one polynomial.

    Args:
        coefficients: (d + 1) ascending powers.
        s: (N) arguments.
    """
    value = np.zeros(len(s))
    for coefficient in coefficients[::-1]:
        value = value * s + coefficient
    return value


def derivative(coefficients: Array) -> Array:
    """(d) the coefficients of the derivative of (d + 1)."""
    return coefficients[1:] * np.arange(1.0, len(coefficients))


def three_values(coefficients: Array, s: Array) -> tuple[Array, Array, Array]:
    """A polynomial and its first two derivatives, each (N), at (N) arguments."""
    first = derivative(coefficients)
    return horner(coefficients, s), horner(first, s), horner(derivative(first), s)
