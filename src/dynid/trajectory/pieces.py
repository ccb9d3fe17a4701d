"""Any trajectory as a list of formulas, for programs that evaluate it elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.trajectory.blends import STEP
from dynid.trajectory.bspline import BSpline
from dynid.trajectory.fourier import FourierSeries
from dynid.trajectory.fourier_quintic import FourierQuintic
from dynid.trajectory.quintic import Quintic
from dynid.trajectory.sequence import MotionSequence, Repetition
from dynid.trajectory.spline_basis import power_coefficients
from dynid.trajectory.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """q = sum_k c_k s^k + sum_l a_l sin(2 pi l s) - b_l cos(2 pi l s), s = t / duration."""

    duration: float
    """Time that the formula holds, its own t running from 0 [s]."""
    polynomial: Array
    """(n, d + 1) c, ascending powers of s [rad or m]."""
    a: Array
    """(n, H) sine coefficients, H = 0 for a polynomial alone [rad or m]."""
    b: Array
    """(n, H) negated cosine coefficients [rad or m]."""

    def __post_init__(self) -> None:
        polynomial = frozen(self.polynomial, shape=(None, None), name="polynomial")
        a = frozen(self.a, shape=(len(polynomial), None), name="a")
        b = frozen(self.b, shape=a.shape, name="b")
        for name, value in (("polynomial", polynomial), ("a", a), ("b", b)):
            object.__setattr__(self, name, value)

    @property
    def harmonics(self) -> int:
        """Number of harmonics H."""
        return self.a.shape[1]


def pieces(trajectory: Trajectory) -> tuple[Piece, ...]:
    """The formulas of a trajectory, in their order.

    Args:
        trajectory: Any trajectory of this package; a Fourier series counts as one period.

    Raises:
        InputError: A trajectory of another kind.
    """
    match trajectory:
        case FourierSeries():
            return (
                Piece(
                    duration=trajectory.period,
                    polynomial=trajectory.offset[:, None],
                    a=trajectory.a,
                    b=trajectory.b,
                ),
            )
        case FourierQuintic():
            return (
                Piece(
                    duration=trajectory.period,
                    polynomial=trajectory.polynomial(),
                    a=trajectory.a,
                    b=trajectory.b,
                ),
            )
        case Quintic():
            way = np.outer(trajectory.goal - trajectory.start, STEP)
            way[:, 0] = trajectory.start
            return (_polynomial(trajectory.duration, way),)
        case BSpline():
            knots, degree = trajectory.knots, trajectory.degree
            widths = np.diff(knots[degree:-degree])
            return tuple(
                _polynomial(float(width), coefficients)
                for width, coefficients in zip(
                    widths, power_coefficients(trajectory.control, knots, degree), strict=True
                )
            )
        case MotionSequence():
            return tuple(piece for part in trajectory.parts for piece in pieces(part))
        case Repetition():
            return trajectory.times * pieces(trajectory.part)
        case _:
            raise InputError("no formula for this trajectory", value=type(trajectory).__name__)


def _polynomial(duration: float, coefficients: Array) -> Piece:
    none = np.zeros((len(coefficients), 0))
    return Piece(duration=duration, polynomial=coefficients, a=none, b=none)
