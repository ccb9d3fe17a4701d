"""Motions from rest to rest: fifth-order polynomials, with or without harmonics, and splines."""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, MotionBounds, Value, freeze, frozen, read_only, scipy_part
from dynid.trajectory import base, fourier

STEP = read_only(np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]))
"""From 0 to 1 with no velocity and acceleration at either end."""

VELOCITY = read_only(np.array([0.0, 1.0, 0.0, -10.0, 15.0, -6.0]))
"""Velocity 1 at both ends, position and acceleration 0."""

ACCELERATION = read_only(np.array([0.0, 0.0, 0.5, -1.0, 0.5, 0.0]))
"""Acceleration 1 at both ends, position and velocity 0."""


def step(s: Array) -> tuple[Array, Array, Array]:
    """10 s^3 - 15 s^4 + 6 s^5 and its first two derivatives, each (N), at (N) s."""
    return (
        s**3 * (10.0 + s * (6.0 * s - 15.0)),
        30.0 * s**2 * (1.0 - s) ** 2,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )


_SHORTEST = 0.1
"""Duration of a move of no length [s]."""
_PEAK_VELOCITY = 15.0 / 8.0
_PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class StraightMove(Value, base.StandingMotion):
    """From one pose to another along a straight line in joint space, at rest at both ends.

    Raises:
        InputError: A travel time that is not positive, or poses that disagree or are not finite.
    """

    start: Array
    """(n) first pose [rad or m]."""
    goal: Array
    """(n) last pose [rad or m]."""
    travel_time: float
    """Time from start to goal [s]."""

    def __post_init__(self) -> None:
        base.require_positive("the travel time", self.travel_time)
        freeze(self, start=(None,))
        freeze(self, goal=self.start.shape)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.start)

    @property
    def duration(self) -> float:
        """The travel time [s]."""
        return self.travel_time

    @abstractmethod
    def profile(self, s: Array) -> tuple[Array, Array, Array]:
        """The way from 0 to 1 and its first two derivatives at (N) shares s of the time."""

    def inside(self, t: Array) -> tuple[Array, Array, Array]:
        """See `StandingMotion`."""
        way = (self.goal - self.start)[None, :]
        place, speed, push = (x[:, None] for x in self.profile(t / self.duration))
        # From the middle outwards the goal is the anchor, so both ends are met exactly.
        onwards, back = self.start + place * way, self.goal - (1.0 - place) * way
        q = np.where(place < 0.5, onwards, back)
        return q, speed / self.duration * way, push / self.duration**2 * way


@dataclass(frozen=True, slots=True, kw_only=True)
class Quintic(StraightMove):
    """A straight line in joint space, q = start + (goal - start) (10 s^3 - 15 s^4 + 6 s^5).

    With s = t / duration it is the one fifth-order polynomial whose velocity and acceleration
    vanish at both ends.

    Raises:
        InputError: A travel time that is not positive, or poses that disagree or are not finite.
    """

    def profile(self, s: Array) -> tuple[Array, Array, Array]:
        """See `StraightMove`."""
        return step(s)


def rest_to_rest(
    start: ArrayLike,
    goal: ArrayLike,
    limits: MotionBounds,
    *,
    margin: float = 0.5,
    acceleration: ArrayLike | None = None,
) -> Quintic:
    """The fastest quintic between two poses that the limits allow.

    Its largest speed is 15/8 |goal - start| / duration and its largest acceleration
    10/sqrt(3) |goal - start| / duration^2, so the duration follows in closed form.

    Args:
        start: (n) first pose [rad or m].
        goal: (n) last pose [rad or m].
        limits: Joint limits; unknown positions count as -pi to pi, other unknowns do not bind.
        margin: Share of the velocity and acceleration limits to use, in (0, 1].
        acceleration: (n) or one number: acceleration limits where `limits` knows none
            [rad/s^2 or m/s^2].

    Raises:
        InputError: A pose outside the position limits, a margin outside (0, 1], or no limit
            that bounds the speed.
    """
    bounds = fourier.usable_bounds(limits, acceleration)
    poses = {
        name: frozen(value, shape=(bounds.joints,), name=name)
        for name, value in (("start", start), ("goal", goal))
    }
    base.require_share("margin", margin)
    for name, pose in poses.items():
        fourier.require_inside(f"{name} pose", pose, bounds.lower, bounds.upper)
    way = np.abs(poses["goal"] - poses["start"])
    unbounded = np.isinf(bounds.velocity) & np.isinf(bounds.acceleration) & (way > 0)
    if unbounded.any():
        raise InputError(
            f"joint {int(np.argmax(unbounded)) + 1}: neither speed nor acceleration is limited",
            next_step="Give `acceleration`.",
        )
    by_velocity = _PEAK_VELOCITY * way / (margin * bounds.velocity)
    by_acceleration = np.sqrt(_PEAK_ACCELERATION * way / (margin * bounds.acceleration))
    duration = max(_SHORTEST, float(by_velocity.max()), float(by_acceleration.max()))
    return Quintic(**poses, travel_time=duration)


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierQuintic(Value, base.StandingMotion):
    """q = sum_l a_l sin(w l t) - b_l cos(w l t) + c(t), w = 2 pi / period, c of fifth order.

    The six coefficients of each c are those that make q(0) = start, q(period) = goal, and
    velocity and acceleration zero at both ends, whatever a and b are. Not periodic inside:
    averaging over periods still works, Fourier filtering of one period sees the polynomial's other
    frequencies.

    Raises:
        InputError: A period that is not positive, shapes that disagree, no harmonics, or numbers
            that are not finite.
    """

    period: float
    """Time from start to goal, and period of the first harmonic [s]."""
    start: Array
    """(n) first pose [rad or m]."""
    goal: Array
    """(n) last pose [rad or m]."""
    a: Array
    """(n, H) sine coefficients, harmonics 1 to H [rad or m]."""
    b: Array
    """(n, H) negated cosine coefficients, harmonics 1 to H [rad or m]."""

    def __post_init__(self) -> None:
        base.require_positive("the period", self.period)
        object.__setattr__(self, "period", float(self.period))
        start = frozen(self.start, shape=(None,), name="start")
        a, b = fourier.coefficients(self.a, self.b, len(start))
        goal = frozen(self.goal, shape=start.shape, name="goal")
        for name, value in (("start", start), ("goal", goal), ("a", a), ("b", b)):
            object.__setattr__(self, name, value)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.start)

    @property
    def harmonics(self) -> int:
        """Number of harmonics H."""
        return self.a.shape[1]

    @property
    def duration(self) -> float:
        """The period [s]."""
        return self.period

    def polynomial(self) -> Array:
        """(n, 6) the coefficients of c in ascending powers of t / period [rad or m]."""
        sines, cosines = _corrections(self.harmonics)
        powers = np.outer(self.goal - self.start, STEP) + self.a @ sines + self.b @ cosines
        powers[:, 0] += self.start
        return powers

    def inside(self, t: Array) -> tuple[Array, Array, Array]:
        """See `StandingMotion`."""
        numbers, way = np.hstack([self.a, self.b]).T, self.goal - self.start
        q, dq, ddq = (part @ numbers for part in _held_harmonics(t, self.period, self.harmonics))
        place, speed, push = step(t / self.period)
        return (
            self.start + np.outer(place, way) + q,
            np.outer(speed / self.period, way) + dq,
            np.outer(push / self.period**2, way) + ddq,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierQuinticFamily(base.MotionFamily):
    """Fourier series with a fifth-order polynomial, from the offset back to the offset.

    Raises:
        InputError: A duration that is not positive, or no harmonics.
    """

    name: ClassVar[str] = "fourier-quintic"

    @property
    def free_count(self) -> int:
        """2H free numbers of each joint: a, then b."""
        return 2 * self.order

    def member(self, pose: Array, free: Array) -> FourierQuintic:
        """The motion from the pose back to it."""
        a, b = free[:, : self.order], free[:, self.order :]
        return FourierQuintic(period=self.duration, start=pose, goal=pose, a=a, b=b)


def _corrections(harmonics: int) -> tuple[Array, Array]:
    """(H, 6) the polynomials that hold the ends of each sine, and of each negated cosine."""
    turns = 2.0 * np.pi * np.arange(1, harmonics + 1, dtype=np.float64)
    cosines = -np.outer(turns**2, ACCELERATION)
    cosines[:, 0] += 1.0
    return -np.outer(turns, VELOCITY), cosines


def _held_harmonics(t: Array, period: float, harmonics: int) -> tuple[Array, Array, Array]:
    """Three (N, 2H) matrices: columns that vanish, with two derivatives, at both ends."""
    values = fourier.harmonic_basis(t, period, harmonics)
    held = np.vstack(_corrections(harmonics))
    powers = (t / period)[:, None] ** np.arange(6)
    slopes = held[:, 1:] * np.arange(1.0, 6.0)
    curves = slopes[:, 1:] * np.arange(1.0, 5.0)
    return (
        values[0] + powers @ held.T,
        values[1] + powers[:, :5] @ slopes.T / period,
        values[2] + powers[:, :4] @ curves.T / period**2,
    )


def _spline(control: Array, duration: float, degree: int) -> Any:
    """SciPy's B-spline of control points (K, n), clamped knots at equal distances to `duration`."""
    inner = np.linspace(0.0, duration, len(control) - degree + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.full(degree, duration)])
    return scipy_part("interpolate").BSpline(knots, control, degree)


_REST = 3
"""Equal control points at an end that leave it without velocity and acceleration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BSpline(Value, base.StandingMotion):
    """q = sum_i control_i B_i(t), with clamped knots at equal distances.

    Starts at the first control point and ends at the last one. With three equal control points at
    an end, it starts or ends at rest.

    Raises:
        InputError: A travel time that is not positive, a degree below 3 (its acceleration would
            jump), fewer control points than degree + 1, or numbers that are not finite.
    """

    travel_time: float
    """Time from start to end [s]."""
    control: Array
    """(n, K) control points [rad or m]."""
    degree: int = 5
    """Degree of the polynomials between the knots."""

    def __post_init__(self) -> None:
        base.require_positive("the travel time", self.travel_time)
        base.require_whole("the degree of a B-spline", self.degree, 3)
        object.__setattr__(self, "travel_time", float(self.travel_time))
        control = frozen(self.control, shape=(None, None), name="control points")
        if len(control) == 0 or control.shape[1] <= self.degree:
            raise InputError(
                "a B-spline needs a joint and more control points than its degree",
                value=control.shape,
                limit=(1, self.degree + 1),
            )
        object.__setattr__(self, "control", control)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.control)

    @property
    def duration(self) -> float:
        """The travel time [s]."""
        return self.travel_time

    def inside(self, t: Array) -> tuple[Array, Array, Array]:
        """See `StandingMotion`."""
        # The columns add up to one: measured from the first point, rests come out as exact zeros.
        way = self.control - self.control[:, :1]
        curve = _spline(way.T, self.travel_time, self.degree)
        q, dq, ddq = (np.asarray(curve(t, order), dtype=np.float64) for order in range(3))
        return self.control[:, 0] + q, dq, ddq

    def polynomials(self) -> tuple[tuple[float, Array], ...]:
        """Duration [s] and ascending coefficients (n, degree + 1) of each span, in 0 to 1."""
        curve = _spline(self.control.T, self.travel_time, self.degree)
        starts = curve.t[self.degree : -self.degree]
        widths = np.diff(starts)
        powers = [
            np.asarray(curve(starts[:-1], order)).T * (widths**order / math.factorial(order))
            for order in range(self.degree + 1)
        ]
        return tuple(
            zip(widths.tolist(), np.stack(powers, axis=-1).transpose(1, 0, 2), strict=True)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class BSplineFamily(base.MotionFamily):
    """B-splines from the offset back to the offset, exactly at rest at both ends.

    Raises:
        InputError: A duration that is not positive, or no free points.
    """

    name: ClassVar[str] = "bspline"

    def member(self, pose: Array, free: Array) -> BSpline:
        """The inner control points are the free numbers, relative to the pose."""
        end = np.repeat(pose[:, None], _REST, axis=1)
        control = np.hstack([end, pose[:, None] + free, end])
        return BSpline(travel_time=self.duration, control=control)
