"""Clamped uniform B-splines, at rest at both ends as a family."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.trajectory.family import MotionFamily
from dynid.trajectory.motion import JointMotion, still_outside
from dynid.trajectory.spline_basis import clamped_knots, spline_basis
from dynid.trajectory.trajectory import Trajectory

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
