"""Finite Fourier series, the excitation trajectory of the paper, at rest at both ends; bounds."""

import math
import warnings
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, MotionBounds, Value, frozen, read_only
from dynid.trajectory import base


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierSeries(Value, base.Trajectory):
    """A periodic motion, q = q0 + sum_l a_l sin(w l t) - b_l cos(w l t) with w = 2 pi / period.

    Raises:
        InputError: A period that is not positive, shapes that disagree, no harmonics, or numbers
            that are not finite.
    """

    period: float
    """Time after which the motion repeats [s]."""
    offset: Array
    """(n) q0, the mean positions [rad or m]."""
    a: Array
    """(n, H) sine coefficients, harmonics 1 to H [rad or m]."""
    b: Array
    """(n, H) negated cosine coefficients, harmonics 1 to H [rad or m]."""

    def __post_init__(self) -> None:
        base.require_positive("the period", self.period)
        object.__setattr__(self, "period", float(self.period))
        offset = frozen(self.offset, shape=(None,), name="offset")
        a, b = coefficients(self.a, self.b, len(offset))
        for name, value in (("offset", offset), ("a", a), ("b", b)):
            object.__setattr__(self, name, value)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.offset)

    @property
    def harmonics(self) -> int:
        """Number of harmonics H."""
        return self.a.shape[1]

    @property
    def duration(self) -> float:
        """The period [s]."""
        return self.period

    def evaluate(self, t: ArrayLike) -> base.JointMotion:
        """The motion at any times (N) [s], by analytic derivatives; it repeats after a period.

        Raises:
            InputError: Times that are not a list of finite numbers.
        """
        times = frozen(t, shape=(None,), name="t")
        # Reducing the time first keeps late periods as exact as the first one.
        basis = harmonic_basis(np.mod(times, self.period), self.period, self.harmonics)
        numbers = np.hstack([self.a, self.b]).T
        q, dq, ddq = (part @ numbers for part in basis)
        return base.JointMotion(t=times, q=self.offset + q, dq=dq, ddq=ddq)

    def sample(self, rate_hz: float, periods: int = 1) -> base.JointMotion:
        """The motion on a regular grid over some periods, from zero; the last end is left out.

        Raises:
            InputError: A rate or a number of periods that is not positive.
        """
        if not (math.isfinite(rate_hz) and rate_hz > 0) or periods < 1:
            raise InputError("rate and periods must be positive", value=(rate_hz, periods))
        return self.evaluate(np.arange(round(self.period * periods * rate_hz)) / rate_hz)


MOST_HARMONICS = 200
"""Twice what designs have; the memory of a certificate grows as their square, to 0.5 GB."""


def coefficients(a: ArrayLike, b: ArrayLike, joints: int) -> tuple[Array, Array]:
    """The coefficients of a series, (n, H) each, checked and read-only."""
    sines = frozen(a, shape=(joints, None), name="a")
    if sines.size == 0:
        raise InputError("a Fourier series needs a joint and a harmonic", value=sines.shape)
    if sines.shape[1] > MOST_HARMONICS:
        raise InputError("too many harmonics", value=sines.shape[1], limit=MOST_HARMONICS)
    return sines, frozen(b, shape=sines.shape, name="b")


def harmonic_basis(t: Array, period: float, harmonics: int) -> tuple[Array, Array, Array]:
    """The series' columns and their first two time derivatives at times (N) [s].

    With x = [a; b] of one joint (2H), q - q0, dq and ddq are the three matrices (N, 2H) times x
    [1, 1/s, 1/s^2].
    """
    rate = np.arange(1, harmonics + 1, dtype=np.float64) * (2.0 * np.pi / period)
    phase = np.multiply.outer(t, rate)
    sine, cosine = np.sin(phase), np.cos(phase)
    return (
        np.hstack([sine, -cosine]),
        np.hstack([cosine * rate, sine * rate]),
        np.hstack([-sine * rate**2, cosine * rate**2]),
    )


def rest_basis(harmonics: int) -> Array:
    """(2H, 2H - 2) basis of the coefficients with no velocity and acceleration at the ends.

    dq(0) = 0 means sum_l l a_l = 0, and ddq(0) = 0 means sum_l l^2 b_l = 0 (by periodicity also
    at the end). With Z the orthonormal basis of both null spaces, the a rows first, [a; b] = Z y
    for free numbers y: the conditions hold exactly, an optimiser needs no equality constraints.

    Raises:
        InputError: Fewer than two harmonics.
    """
    base.require_whole("harmonics of a motion from rest to rest", harmonics, 2)
    order = np.arange(1.0, harmonics + 1)
    return _sines_and_cosines(_orthogonal_complement(order), _orthogonal_complement(order**2))


def _sines_and_cosines(sines: Array, cosines: Array) -> Array:
    """The block diagonal of two bases."""
    upper = np.hstack([sines, np.zeros((len(sines), cosines.shape[1]))])
    lower = np.hstack([np.zeros((len(cosines), sines.shape[1])), cosines])
    return read_only(np.vstack([upper, lower]))


def _orthogonal_complement(direction: Array) -> Array:
    # A Householder reflection takes `direction` to the first axis, so its other columns are an
    # orthonormal basis of the rest: no factorisation whose signs depend on the LAPACK at hand.
    mirror = direction / np.linalg.norm(direction)
    mirror[0] += 1.0 if mirror[0] >= 0.0 else -1.0
    reflection = np.eye(len(mirror)) - 2.0 * np.outer(mirror, mirror) / (mirror @ mirror)
    return reflection[:, 1:]


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierFamily(base.MotionFamily):
    """The paper's series with no velocity and acceleration at the ends; the offset is q0.

    Raises:
        InputError: A duration that is not positive, or fewer than two harmonics.
    """

    name: ClassVar[str] = "fourier"
    least: ClassVar[int] = 2

    @property
    def free_count(self) -> int:
        """2H - 2 free numbers of each joint."""
        return self._coefficients().shape[1]

    def member(self, pose: Array, free: Array) -> FourierSeries:
        """The series about the pose."""
        numbers = free @ self._coefficients().T
        a, b = numbers[:, : self.order], numbers[:, self.order :]
        return FourierSeries(period=self.duration, offset=pose, a=a, b=b)

    def _coefficients(self) -> Array:
        """(2H, k) [a; b] of one joint is this matrix times its free numbers."""
        return rest_basis(self.order)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModifiedFourierFamily(FourierFamily):
    """A periodic series that also starts and ends at a given pose: the offset.

    Meets what Wu et al. (2012), doi 10.5772/45818, ask of their modified Fourier series: periodic,
    with position, velocity and acceleration given at the ends. Their own formula was not at hand;
    this one is the whole space of series of H harmonics that meets the conditions.

    Raises:
        InputError: A duration that is not positive, or fewer than three harmonics.
    """

    name: ClassVar[str] = "modified-fourier"
    least: ClassVar[int] = 3

    def _coefficients(self) -> Array:
        order = np.arange(1.0, self.order + 1)
        cosines = _orthogonal_complement(order**2)
        # Within the cosines that have no acceleration at the ends, those that add up to zero, so
        # that q(0) = q0 as well.
        cosines = cosines @ _orthogonal_complement(cosines.sum(axis=0))
        return _sines_and_cosines(_orthogonal_complement(order), cosines)


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
        limits: Joint limits; unknown and infinite positions count as -pi to pi, other unknowns do
            not bind.
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
    ends = {name: getattr(limits, name) for name in ("lower", "upper")}
    ends = {name: np.where(np.isinf(end), np.nan, end) for name, end in ends.items()}
    bounds = usable_bounds(replace(limits, **ends), acceleration)
    basis, generator = rest_basis(harmonics), np.random.default_rng(seed)
    spread = np.tile(1.0 / np.arange(1, harmonics + 1), 2)
    drawn = generator.standard_normal((bounds.joints, 2 * harmonics)) * spread
    a, b = np.split(drawn @ basis @ basis.T, 2, axis=1)
    given = np.zeros(bounds.joints) if offset is None else offset
    middle = frozen(given, shape=(bounds.joints,), name="offset")
    series = FourierSeries(period=period_s, offset=middle, a=a, b=b)
    base.require_share("margin", margin)
    centre, half = (bounds.lower + bounds.upper) / 2, (bounds.upper - bounds.lower) / 2
    lower, upper = centre - margin * half, centre + margin * half
    peak = peaks(series)
    scale = np.minimum(
        _ratio(margin * bounds.velocity, peak.velocity),
        _ratio(margin * bounds.acceleration, peak.acceleration),
    )
    if offset is None:
        # Scaled to its limits, and shifted to a random place where it fits.
        scale = np.minimum(scale, (upper - lower) / (peak.upper - peak.lower))
        first, last = lower - scale * peak.lower, upper - scale * peak.upper
        place = generator.uniform(size=bounds.joints)
        middle = first + place * np.maximum(last - first, 0.0)
    else:
        require_inside("mean position", middle, lower, upper)
        below = _ratio(middle - lower, middle - peak.lower)
        above = _ratio(upper - middle, peak.upper - middle)
        scale = np.minimum(scale, np.minimum(below, above))
    if not np.isfinite(scale).all():
        raise InputError(
            "no limit bounds the motion",
            next_step="Give position, velocity or acceleration limits.",
        )
    a, b = series.a * scale[:, None], series.b * scale[:, None]
    return FourierSeries(period=period_s, offset=middle, a=a, b=b)
