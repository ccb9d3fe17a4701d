"""Fourier series as families: at rest at the ends, and at a given pose too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.trajectory.family import MotionFamily
from dynid.trajectory.fourier import FourierSeries, check_period, harmonic_basis
from dynid.trajectory.rest import held_basis, rest_basis


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierFamily(MotionFamily):
    """The paper's series with no velocity and acceleration at the ends; the offset is q0.

    Raises:
        InputError: A period that is not positive, or fewer than two harmonics.
    """

    name: ClassVar[str] = "fourier"
    period: float
    """Period [s]."""
    harmonics: int
    """Number of harmonics H, at least 2."""

    def __post_init__(self) -> None:
        check_period(self.period)
        self._coefficients()

    @property
    def duration(self) -> float:
        """The period [s]."""
        return self.period

    @property
    def free_count(self) -> int:
        """2H - 2 free numbers of each joint."""
        return self._coefficients().shape[1]

    def basis(self, t: Array) -> tuple[Array, Array, Array]:
        """The harmonics' columns in the coordinates of `rest_basis`.

        Args:
            t: (N) times [s].
        """
        free = self._coefficients()
        q, dq, ddq = harmonic_basis(np.mod(t, self.period), self.period, self.harmonics)
        return q @ free, dq @ free, ddq @ free

    def trajectory(self, offset: ArrayLike, free: ArrayLike) -> FourierSeries:
        """The series with these numbers.

        Args:
            offset: (n) mean positions q0 [rad or m].
            free: (n, k) free numbers, a row a joint [rad or m].

        Raises:
            InputError: Shapes that disagree, or numbers that are not finite.
        """
        middle = frozen(offset, shape=(None,), name="offset")
        numbers = frozen(free, shape=(len(middle), self.free_count), name="free numbers")
        coefficients = numbers @ self._coefficients().T
        return FourierSeries(
            period=self.period,
            offset=middle,
            a=coefficients[:, : self.harmonics],
            b=coefficients[:, self.harmonics :],
        )

    def _coefficients(self) -> Array:
        """(2H, k) [a; b] of one joint is this matrix times its free numbers."""
        return rest_basis(self.harmonics)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModifiedFourierFamily(FourierFamily):
    """A periodic series that also starts and ends at a given pose: the offset.

    Meets what Wu et al. (2012), doi 10.5772/45818, ask of their modified Fourier series: periodic,
    with position, velocity and acceleration given at the ends. Their own formula was not at hand;
    this one is the whole space of series of H harmonics that meets the conditions.

    Raises:
        InputError: A period that is not positive, or fewer than three harmonics.
    """

    name: ClassVar[str] = "modified-fourier"

    def __post_init__(self) -> None:
        if self.harmonics < 3:
            raise InputError(
                "a series that starts at a given pose needs three harmonics", value=self.harmonics
            )
        check_period(self.period)

    def _coefficients(self) -> Array:
        return held_basis(self.harmonics)
