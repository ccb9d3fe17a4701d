"""The bounds of a motion, and Fourier series scaled or drawn at random within them."""

import math
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, MotionBounds, frozen
from dynid.trajectory.fourier import FourierSeries, harmonic_basis, rest_basis, rest_series


def usable_bounds(limits: MotionBounds, acceleration: ArrayLike | None = None) -> MotionBounds:
    """Bounds without NaN, for a search or a scaling.

    An unknown position bound becomes -pi or pi (2 pi from the known one if that is beyond); an
    unknown velocity or acceleration bound becomes infinite: it does not bind.

    Args:
        limits: The limits, NaN where unknown.
        acceleration: (n) or one number: acceleration bounds where the limits know none
            [rad/s^2 or m/s^2].
    """
    lower = np.where(np.isnan(limits.lower), -np.pi, limits.lower)
    upper = np.where(np.isnan(limits.upper), np.pi, limits.upper)
    crossed = lower > upper
    lower = np.where(crossed & np.isnan(limits.lower), upper - 2 * np.pi, lower)
    upper = np.where(crossed & np.isnan(limits.upper), lower + 2 * np.pi, upper)
    given = np.inf if acceleration is None else acceleration
    try:
        spare = np.broadcast_to(np.asarray(given, dtype=np.float64), lower.shape)
    except (TypeError, ValueError) as error:
        raise InputError(
            "acceleration must be one number, or one a joint",
            value=acceleration,
            limit=limits.joints,
        ) from error
    return MotionBounds(
        lower=lower,
        upper=upper,
        velocity=np.where(np.isnan(limits.velocity), np.inf, limits.velocity),
        acceleration=np.where(np.isnan(limits.acceleration), spare, limits.acceleration),
    )


_POINTS_PER_HARMONIC = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Extremes:
    """Nothing of a motion is beyond these."""

    lower: Array
    """(n) positions [rad or m]"""
    upper: Array
    """(n) positions [rad or m]"""
    velocity: Array
    """(n) speeds [rad/s or m/s]"""
    acceleration: Array
    """(n) accelerations [rad/s^2 or m/s^2]"""
    proven: bool = True
    """Whether they follow from the motion's formula."""

    @property
    def travel(self) -> Array:
        """(n) how far positions are from zero at the most [rad or m]."""
        return np.maximum(np.abs(self.lower), np.abs(self.upper))


def peaks(series: FourierSeries) -> Extremes:
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
    return Extremes(
        lower=series.offset + (swing.min(axis=0) - slack),
        upper=series.offset + (swing.max(axis=0) + slack),
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
    require_inside("mean position", series.offset, lower, upper)
    peak = peaks(series)
    position = np.minimum(
        _ratio(upper - series.offset, peak.upper - series.offset),
        _ratio(series.offset - lower, series.offset - peak.lower),
    )
    return np.minimum(position, _derivative_scale(peak, bounds, margin))


def require_inside(what: str, pose: Array, lower: Array, upper: Array) -> None:
    """Refuse a pose (n) outside of position limits (n).

    Raises:
        InputError: It is, in the first joint that is named.
    """
    outside = (pose < lower) | (pose > upper)
    if outside.any():
        joint = int(np.argmax(outside))
        raise InputError(
            f"joint {joint + 1}: the {what} is outside the position limits",
            value=float(pose[joint]),
            limit=(float(lower[joint]), float(upper[joint])),
        )


def _derivative_scale(peak: Extremes, bounds: MotionBounds, margin: float) -> Array:
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


def random_excitation(
    limits: MotionBounds,
    *,
    harmonics: int = 5,
    period_s: float = 10.0,
    seed: int,
    margin: float = 0.9,
    acceleration: ArrayLike | None = None,
    offset: ArrayLike | None = None,
    period: float | None = None,
) -> FourierSeries:
    """A random series from rest to rest, as large as its tightest limit allows.

    Coefficients are drawn with a spread of 1/l, which lets all harmonics share the velocity,
    projected onto `rest_basis`, and scaled joint by joint; `peaks` makes the limits hold between
    the samples too. Collisions are not looked at.

    Args:
        limits: Joint limits; unknown positions count as -pi to pi, other unknowns do not bind.
        harmonics: Number of harmonics H, at least 2.
        period_s: Period [s].
        seed: Seed of the random numbers.
        margin: Share of each limit to use, in (0, 1].
        acceleration: (n) or one number: acceleration limits where `limits` knows none
            [rad/s^2 or m/s^2].
        offset: (n) mean positions [rad or m]; drawn from the room left if not given.
        period: What release 0.1 called `period_s`, for one release.

    Raises:
        InputError: A period, margin or number of harmonics that is not allowed, or an offset
            outside the position limits.
    """
    if period is not None:
        warnings.warn(
            "random_excitation(period) is now random_excitation(period_s)",
            DeprecationWarning,
            stacklevel=3,
        )
        period_s = period
    bounds = usable_bounds(limits, acceleration)
    generator = np.random.default_rng(seed)
    spread = np.tile(1.0 / np.arange(1, harmonics + 1), 2)
    drawn = generator.standard_normal((bounds.joints, 2 * harmonics)) * spread
    free = drawn @ rest_basis(harmonics)
    given = np.zeros(bounds.joints) if offset is None else offset
    middle = frozen(given, shape=(bounds.joints,), name="offset")
    series = rest_series(period_s, middle, free)
    if offset is None:
        # Scaled to its limits, and shifted to a random place where it fits.
        lower, upper = inner_range(bounds, margin)
        peak = peaks(series)
        scale = np.minimum(
            (upper - lower) / (peak.upper - peak.lower), _derivative_scale(peak, bounds, margin)
        )
        first, last = lower - scale * peak.lower, upper - scale * peak.upper
        place = generator.uniform(size=bounds.joints)
        middle = first + place * np.maximum(last - first, 0.0)
    else:
        scale = largest_scale(series, bounds, margin=margin)
    if not np.isfinite(scale).all():
        raise InputError(
            "no limit bounds the motion",
            next_step="Give position, velocity or acceleration limits.",
        )
    a, b = series.a * scale[:, None], series.b * scale[:, None]
    return FourierSeries(period=period_s, offset=middle, a=a, b=b)
