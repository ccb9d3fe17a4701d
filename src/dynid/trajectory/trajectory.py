"""What every trajectory and every family of trajectories can do."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, frozen


@dataclass(frozen=True, slots=True, kw_only=True)
class JointMotion:
    """Samples of a motion.

    Raises:
        InputError: Shapes that disagree, or numbers that are not finite.
    """

    t: Array
    """(N) time [s]."""
    q: Array
    """(N, n) positions [rad or m]."""
    dq: Array
    """(N, n) velocities [rad/s or m/s]."""
    ddq: Array
    """(N, n) accelerations [rad/s^2 or m/s^2]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", frozen(self.t, shape=(None,), name="t"))
        object.__setattr__(self, "q", frozen(self.q, shape=(len(self.t), None), name="q"))
        for name in ("dq", "ddq"):
            value = frozen(getattr(self, name), shape=self.q.shape, name=name)
            object.__setattr__(self, name, value)


def still_outside(times: Array, inside: Array, q: Array, dq: Array, ddq: Array) -> JointMotion:
    """A motion that stands at its ends before it begins and after it is over.

    Args:
        times: (N) times that were asked for [s].
        inside: (N) the same, held within the motion [s].
        q: (N, n) positions at `inside` [rad or m].
        dq: (N, n) velocities there.
        ddq: (N, n) accelerations there.
    """
    outside = (times != inside)[:, None]
    return JointMotion(t=times, q=q, dq=np.where(outside, 0.0, dq), ddq=np.where(outside, 0.0, ddq))


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
