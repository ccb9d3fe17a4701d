"""Families of motions that are linear in their free numbers, for an optimiser."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from numpy.typing import ArrayLike

from dynid.core.arrays import Array
from dynid.trajectory.trajectory import Trajectory


class MotionFamily(ABC):
    """Motions q = offset + B0 y, dq = B1 y, ddq = B2 y, with free numbers y of each joint.

    Every member starts and ends at the same pose with no velocity and no acceleration, whatever
    y is: an optimiser needs no equality constraints, and the motion can be repeated.
    """

    __slots__ = ()

    name: ClassVar[str]
    """The name in settings and on the command line."""

    @property
    @abstractmethod
    def duration(self) -> float:
        """Time from start to end [s]."""

    @property
    @abstractmethod
    def free_count(self) -> int:
        """Free numbers k of each joint."""

    @abstractmethod
    def basis(self, t: Array) -> tuple[Array, Array, Array]:
        """The columns of the motion and their first two time derivatives.

        Args:
            t: (N) times within the duration [s].

        Returns:
            Three (N, k) matrices B0 [1], B1 [1/s] and B2 [1/s^2].
        """

    @abstractmethod
    def trajectory(self, offset: ArrayLike, free: ArrayLike) -> Trajectory:
        """The member with these numbers.

        Args:
            offset: (n) what is added to every position [rad or m].
            free: (n, k) free numbers, a row a joint [rad or m].

        Raises:
            InputError: Shapes that disagree, or numbers that are not finite.
        """
