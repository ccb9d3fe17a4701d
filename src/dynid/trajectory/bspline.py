"""Clamped uniform B-splines, at rest at both ends as a family."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dynid.core import Array, InputError, frozen, scipy_part
from dynid.trajectory.trajectory import PoseFamily, StandingMotion, require_positive


def _spline(control: Array, duration: float, degree: int) -> Any:
    """SciPy's B-spline of control points (K, n), clamped knots at equal distances to `duration`."""
    inner = np.linspace(0.0, duration, len(control) - degree + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.full(degree, duration)])
    return scipy_part("interpolate").BSpline(knots, control, degree)


_REST = 3
"""Equal control points at an end that leave it without velocity and acceleration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BSpline(StandingMotion):
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
        require_positive("the travel time", self.travel_time)
        _check_degree(self.degree)
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
        return np.asarray(_spline(self.control.T, self.travel_time, self.degree).t)

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
class BSplineFamily(PoseFamily):
    """B-splines from the offset back to the offset, exactly at rest at both ends.

    Raises:
        InputError: A travel time that is not positive, a degree below 3, or no free points.
    """

    name: ClassVar[str] = "bspline"
    degree: int = 5
    """Degree of the polynomials between the knots."""

    def __post_init__(self) -> None:
        PoseFamily.__post_init__(self)
        _check_degree(self.degree)
        if self.points + 2 * _REST <= self.degree:
            raise InputError(
                "too few control points for the degree",
                value=self.points,
                limit=self.degree + 1 - 2 * _REST,
            )

    def member(self, pose: Array, free: Array) -> BSpline:
        """The inner control points are the free numbers, relative to the pose."""
        end = np.repeat(pose[:, None], _REST, axis=1)
        return BSpline(
            travel_time=self.travel_time,
            control=np.hstack([end, pose[:, None] + free, end]),
            degree=self.degree,
        )


def _check_degree(degree: int) -> None:
    if degree < 3:
        raise InputError("the degree of a B-spline", value=degree, limit="3 or more")
