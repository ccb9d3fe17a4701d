"""Clamped uniform B-splines, at rest at both ends as a family."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, frozen
from dynid.trajectory.trajectory import JointMotion, MotionFamily, Trajectory, still_outside


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


_REST = 3
"""Equal control points at an end that leave it without velocity and acceleration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BSpline(Trajectory):
    """q = sum_i control_i B_i(t), with clamped knots at equal distances.

    Starts at the first control point and ends at the last one; before and after, the arm stands
    still. With three equal control points at an end, it starts or ends at rest.

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
        _check(self.travel_time, self.degree)
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

    @property
    def knots(self) -> Array:
        """(K + degree + 1) knots, clamped at both ends [s]."""
        return clamped_knots(self.travel_time, self.control.shape[1], self.degree)

    def evaluate(self, t: ArrayLike) -> JointMotion:
        """The motion at any times.

        Args:
            t: (N) times [s]; outside 0 to `duration` the arm stands at the nearer end.

        Raises:
            InputError: Times that are not a list of finite numbers.
        """
        times = frozen(t, shape=(None,), name="t")
        inside = np.clip(times, 0.0, self.travel_time)
        q, dq, ddq = spline_basis(inside, self.knots, self.degree)
        # The columns add up to one: measured from the first point, rests come out as exact zeros.
        way = (self.control - self.control[:, :1]).T
        return still_outside(times, inside, self.control[:, 0] + q @ way, dq @ way, ddq @ way)


@dataclass(frozen=True, slots=True, kw_only=True)
class BSplineFamily(MotionFamily):
    """B-splines from the offset back to the offset, exactly at rest at both ends.

    Raises:
        InputError: A travel time that is not positive, a degree below 3, or no free points.
    """

    name: ClassVar[str] = "bspline"
    travel_time: float
    """Time from start to end [s]."""
    points: int
    """Free control points of each joint."""
    degree: int = 5
    """Degree of the polynomials between the knots."""

    def __post_init__(self) -> None:
        _check(self.travel_time, self.degree)
        if self.points < 1:
            raise InputError("a B-spline needs a free control point", value=self.points)
        if self.points + 2 * _REST <= self.degree:
            raise InputError(
                "too few control points for the degree",
                value=self.points,
                limit=self.degree + 1 - 2 * _REST,
            )

    @property
    def duration(self) -> float:
        """The travel time [s]."""
        return self.travel_time

    @property
    def free_count(self) -> int:
        """One free number a free control point, relative to the offset."""
        return self.points

    def basis(self, t: Array) -> tuple[Array, Array, Array]:
        """The columns of the inner control points.

        Args:
            t: (N) times within the travel time [s].
        """
        knots = clamped_knots(self.travel_time, self.points + 2 * _REST, self.degree)
        q, dq, ddq = spline_basis(t, knots, self.degree)
        return q[:, _REST:-_REST], dq[:, _REST:-_REST], ddq[:, _REST:-_REST]

    def trajectory(self, offset: ArrayLike, free: ArrayLike) -> BSpline:
        """The member with these numbers.

        Args:
            offset: (n) pose at both ends [rad or m].
            free: (n, points) inner control points relative to the offset [rad or m].

        Raises:
            InputError: Shapes that disagree, or numbers that are not finite.
        """
        pose = frozen(offset, shape=(None,), name="offset")[:, None]
        numbers = frozen(free, shape=(len(pose), self.points), name="free numbers")
        end = np.repeat(pose, _REST, axis=1)
        return BSpline(
            travel_time=self.travel_time,
            control=np.hstack([end, pose + numbers, end]),
            degree=self.degree,
        )


def _check(travel_time: float, degree: int) -> None:
    if not (math.isfinite(travel_time) and travel_time > 0):
        raise InputError("the travel time must be positive", value=travel_time)
    if degree < 3:
        raise InputError("the degree of a B-spline", value=degree, limit="3 or more")
