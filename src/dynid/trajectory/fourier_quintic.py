"""A Fourier series carried from one given pose to another by a fifth-order polynomial."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.trajectory.blends import ACCELERATION, STEP, VELOCITY, three_values
from dynid.trajectory.family import MotionFamily
from dynid.trajectory.fourier import check_period, coefficients, harmonic_basis
from dynid.trajectory.motion import JointMotion
from dynid.trajectory.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierQuintic(Trajectory):
    """q = sum_l a_l sin(w l t) - b_l cos(w l t) + c(t), w = 2 pi / period, c of fifth order.

    The six coefficients of each c are those that make q(0) = start, q(period) = goal, and
    velocity and acceleration zero at both ends, whatever a and b are. Before and after, the arm
    stands still. Not periodic inside: averaging over periods still works, Fourier filtering of one
    period sees the polynomial's other frequencies.

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
        check_period(self.period)
        object.__setattr__(self, "period", float(self.period))
        start = frozen(self.start, shape=(None,), name="start")
        a, b = coefficients(self.a, self.b, len(start))
        for name, value in (
            ("start", start),
            ("goal", frozen(self.goal, shape=start.shape, name="goal")),
            ("a", a),
            ("b", b),
        ):
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

    def evaluate(self, t: ArrayLike) -> JointMotion:
        """The motion at any times.

        Args:
            t: (N) times [s]; outside 0 to `duration` the arm stands at the nearer end.

        Raises:
            InputError: Times that are not a list of finite numbers.
        """
        times = frozen(t, shape=(None,), name="t")
        inside = np.clip(times, 0.0, self.period)
        numbers = np.hstack([self.a, self.b]).T
        q, dq, ddq = (
            part @ numbers for part in _held_harmonics(inside, self.period, self.harmonics)
        )
        step, speed, push = three_values(STEP, inside / self.period)
        way = self.goal - self.start
        return JointMotion(
            t=times,
            q=self.start + np.outer(step, way) + q,
            dq=np.outer(speed / self.period, way) + dq,
            ddq=np.outer(push / self.period**2, way) + ddq,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierQuinticFamily(MotionFamily):
    """Fourier series with a fifth-order polynomial, from the offset back to the offset.

    Raises:
        InputError: A period that is not positive, or no harmonics.
    """

    name: ClassVar[str] = "fourier-quintic"
    period: float
    """Time from start to end [s]."""
    harmonics: int
    """Number of harmonics H."""

    def __post_init__(self) -> None:
        check_period(self.period)
        if self.harmonics < 1:
            raise InputError("a Fourier series needs a harmonic", value=self.harmonics)

    @property
    def duration(self) -> float:
        """The period [s]."""
        return self.period

    @property
    def free_count(self) -> int:
        """2H free numbers of each joint: a, then b."""
        return 2 * self.harmonics

    def basis(self, t: Array) -> tuple[Array, Array, Array]:
        """The harmonics' columns, each with the polynomial that holds its ends.

        Args:
            t: (N) times within the period [s].
        """
        return _held_harmonics(t, self.period, self.harmonics)

    def trajectory(self, offset: ArrayLike, free: ArrayLike) -> FourierQuintic:
        """The member with these numbers.

        Args:
            offset: (n) pose at both ends [rad or m].
            free: (n, 2H) a, then b of each joint [rad or m].

        Raises:
            InputError: Shapes that disagree, or numbers that are not finite.
        """
        pose = frozen(offset, shape=(None,), name="offset")
        numbers = frozen(free, shape=(len(pose), self.free_count), name="free numbers")
        return FourierQuintic(
            period=self.period,
            start=pose,
            goal=pose,
            a=numbers[:, : self.harmonics],
            b=numbers[:, self.harmonics :],
        )


def _corrections(harmonics: int) -> tuple[Array, Array]:
    """(H, 6) the polynomials that hold the ends of each sine, and of each negated cosine."""
    turns = 2.0 * np.pi * np.arange(1, harmonics + 1, dtype=np.float64)
    cosines = -np.outer(turns**2, ACCELERATION)
    cosines[:, 0] += 1.0
    return -np.outer(turns, VELOCITY), cosines


def _held_harmonics(t: Array, period: float, harmonics: int) -> tuple[Array, Array, Array]:
    """Three (N, 2H) matrices: columns that vanish, with two derivatives, at both ends."""
    values = harmonic_basis(t, period, harmonics)
    held = np.vstack(_corrections(harmonics))
    powers = (t / period)[:, None] ** np.arange(6)
    slopes = held[:, 1:] * np.arange(1.0, 6.0)
    curves = slopes[:, 1:] * np.arange(1.0, 5.0)
    return (
        values[0] + powers @ held.T,
        values[1] + powers[:, :5] @ slopes.T / period,
        values[2] + powers[:, :4] @ curves.T / period**2,
    )
