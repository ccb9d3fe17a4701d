"""Random excitation: a start for an optimiser, a motion for a test."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.trajectory.bounds import MotionBounds, MotionLimits, usable_bounds
from dynid.trajectory.fourier import FourierSeries
from dynid.trajectory.rest import rest_basis, rest_series
from dynid.trajectory.scaling import derivative_scale, inner_range, largest_scale, peaks


def random_excitation(
    limits: MotionLimits,
    *,
    harmonics: int = 5,
    period: float = 10.0,
    seed: int,
    margin: float = 0.9,
    acceleration: ArrayLike | None = None,
    offset: ArrayLike | None = None,
) -> FourierSeries:
    """A random series from rest to rest, as large as its tightest limit allows.

    Coefficients are drawn with a spread of 1/l, which lets all harmonics share the velocity,
    projected onto `rest_basis`, and scaled joint by joint; `peaks` makes the limits hold between
    the samples too. Collisions are not looked at.

    Args:
        limits: Joint limits; unknown positions count as -pi to pi, other unknowns do not bind.
        harmonics: Number of harmonics H, at least 2.
        period: Period [s].
        seed: Seed of the random numbers.
        margin: Share of each limit to use, in (0, 1].
        acceleration: (n) or one number: acceleration limits where `limits` knows none
            [rad/s^2 or m/s^2].
        offset: (n) mean positions [rad or m]; drawn from the room left if not given.

    Raises:
        InputError: A period, margin or number of harmonics that is not allowed, or an offset
            outside the position limits.
    """
    bounds = usable_bounds(limits, acceleration)
    generator = np.random.default_rng(seed)
    spread = np.tile(1.0 / np.arange(1, harmonics + 1), 2)
    drawn = generator.standard_normal((bounds.joints, 2 * harmonics)) * spread
    free = drawn @ rest_basis(harmonics)
    if offset is None:
        return _with_drawn_offset(
            rest_series(period, np.zeros(bounds.joints), free), bounds, margin, generator
        )
    middle = frozen(offset, shape=(bounds.joints,), name="offset")
    series = rest_series(period, middle, free)
    return _scaled(series, largest_scale(series, bounds, margin=margin), middle)


def _with_drawn_offset(
    series: FourierSeries, bounds: MotionBounds, margin: float, generator: np.random.Generator
) -> FourierSeries:
    """The series scaled to its limits and shifted to a random place where it fits."""
    lower, upper = inner_range(bounds, margin)
    peak = peaks(series)
    scale = np.minimum(
        (upper - lower) / (peak.above - peak.below), derivative_scale(peak, bounds, margin)
    )
    first, last = lower - scale * peak.below, upper - scale * peak.above
    place = generator.uniform(size=bounds.joints)
    return _scaled(series, scale, first + place * np.maximum(last - first, 0.0))


def _scaled(series: FourierSeries, scale: Array, offset: Array) -> FourierSeries:
    if not np.isfinite(scale).all():
        raise InputError(
            "no limit bounds the motion",
            next_step="Give position, velocity or acceleration limits.",
        )
    return FourierSeries(
        period=series.period,
        offset=offset,
        a=series.a * scale[:, None],
        b=series.b * scale[:, None],
    )
