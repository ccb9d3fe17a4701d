"""What every trajectory can do."""

from __future__ import annotations

from abc import ABC, abstractmethod

from numpy.typing import ArrayLike

from dynid.trajectory.motion import JointMotion


class Trajectory(ABC):
    """A joint motion as a function of time."""

    __slots__ = ()

    @property
    @abstractmethod
    def joints(self) -> int:
        """Number of joints n."""

    @property
    @abstractmethod
    def duration(self) -> float:
        """Time from start to end, or one period [s]."""

    @abstractmethod
    def evaluate(self, t: ArrayLike) -> JointMotion:
        """Positions, velocities and accelerations.

        Args:
            t: (N) times from the start [s].

        Raises:
            InputError: Times that are not a list of finite numbers.
        """
