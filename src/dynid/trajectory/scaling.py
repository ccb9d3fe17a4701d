"""Peaks of a Fourier series between its samples, and scaling onto the limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.trajectory.bounds import MotionBounds
from dynid.trajectory.fourier import FourierSeries, harmonic_basis

_POINTS_PER_HARMONIC = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Peaks:
    """Guaranteed extremes of a periodic motion over all time."""

    below: Array
    """(n) lowest position relative to the offset [rad or m], not above the true one."""
    above: Array
    """(n) highest position relative to the offset [rad or m], not below the true one."""
    velocity: Array
    """(n) largest speed [rad/s or m/s], not below the true one."""
    acceleration: Array
    """(n) largest acceleration [rad/s^2 or m/s^2], not below the true one."""


def peaks(series: FourierSeries) -> Peaks:
    """Extremes that hold between the samples too.

    A trigonometric polynomial of degree H seen at N > 2H regular points is nowhere larger than
    its largest sample over cos(pi H / N) (Ehlich and Zeller, 1964); with 64 points a harmonic
    that is 0.12 % above the samples.
    """
    count = _POINTS_PER_HARMONIC * series.harmonics
    grid = np.arange(count, dtype=np.float64) * (series.period / count)
    coefficients = np.hstack([series.a, series.b]).T
    swing, dq, ddq = (
        part @ coefficients for part in harmonic_basis(grid, series.period, series.harmonics)
    )
    excess = 1.0 / math.cos(math.pi / _POINTS_PER_HARMONIC)
    slack = (excess - 1.0) * np.abs(swing).max(axis=0)
    return Peaks(
        below=swing.min(axis=0) - slack,
        above=swing.max(axis=0) + slack,
        velocity=excess * np.abs(dq).max(axis=0),
        acceleration=excess * np.abs(ddq).max(axis=0),
    )


def largest_scale(series: FourierSeries, bounds: MotionBounds, *, margin: float = 1.0) -> Array:
    """(n) the factors on a and b that take each joint onto its tightest bound.

    Args:
        series: The motion; its offset stays where it is.
        bounds: Bounds without NaN.
        margin: The share of each bound that may be used, in (0, 1]; the position range shrinks
            about its middle.

    Raises:
        InputError: A margin outside (0, 1], another number of joints, or an offset outside the
            position bounds.
    """
    lower, upper = inner_range(bounds, margin)
    if series.joints != bounds.joints:
        raise InputError("joints of the series", value=series.joints, limit=bounds.joints)
    outside = (series.offset < lower) | (series.offset > upper)
    if outside.any():
        joint = int(np.argmax(outside))
        raise InputError(
            f"joint {joint + 1}: the mean position is outside the position limits",
            value=float(series.offset[joint]),
            limit=(float(lower[joint]), float(upper[joint])),
        )
    peak = peaks(series)
    position = np.minimum(
        _ratio(upper - series.offset, peak.above), _ratio(series.offset - lower, -peak.below)
    )
    return np.minimum(position, derivative_scale(peak, bounds, margin))


def derivative_scale(peak: Peaks, bounds: MotionBounds, margin: float) -> Array:
    """(n) the largest factors that velocity and acceleration allow."""
    return np.minimum(
        _ratio(margin * bounds.velocity, peak.velocity),
        _ratio(margin * bounds.acceleration, peak.acceleration),
    )


def inner_range(bounds: MotionBounds, margin: float) -> tuple[Array, Array]:
    """The position bounds (n) and (n), shrunk about their middle by the margin.

    Raises:
        InputError: A margin outside (0, 1].
    """
    if not 0.0 < margin <= 1.0:
        raise InputError("margin", value=margin, limit="above 0, at most 1")
    middle, half = (bounds.lower + bounds.upper) / 2, (bounds.upper - bounds.lower) / 2
    return middle - margin * half, middle + margin * half


def _ratio(room: Array, use: Array) -> Array:
    """`room / use`; infinite where nothing is used."""
    return np.divide(room, use, out=np.full(room.shape, np.inf), where=use > 0)
