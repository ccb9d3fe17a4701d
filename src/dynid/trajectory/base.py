"""What every trajectory and every family of trajectories can do."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from numbers import Integral
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, Value, freeze, frozen


@dataclass(frozen=True, slots=True, kw_only=True)
class JointMotion(Value):
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
        freeze(self, t=(None,))
        freeze(self, q=(len(self.t), None))
        freeze(self, dq=self.q.shape, ddq=self.q.shape)


def require_positive(what: str, value: float) -> None:
    """Refuse a number that is not positive and finite.

    Raises:
        InputError: It is not.
    """
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{what} must be positive", value=value)


def require_whole(what: str, value: int, least: int, most: float = math.inf) -> None:
    """Refuse a number that is not whole, or out of bounds: part of a period would end in motion.

    Raises:
        InputError: It is not, or it is.
    """
    if not (isinstance(value, Integral) and least <= value <= most):
        raise InputError(f"{what}: a whole number", value=value, limit=f"{least} to {most:g}")


def require_share(what: str, value: float) -> None:
    """Refuse what is no share in (0, 1].

    Raises:
        InputError: It is none.
    """
    if not 0.0 < value <= 1.0:
        raise InputError(what, value=value, limit="above 0, at most 1")


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
        """Positions, velocities and accelerations at times (N) from the start [s].

        Raises:
            InputError: Times that are not a list of finite numbers.
        """


_REST = {"dq": 1e-3, "ddq": 1e-2}
"""Largest velocity and acceleration of a joint that rests."""


def require_rest(trajectory: Trajectory) -> JointMotion:
    """Both ends of a motion.

    Raises:
        InputError: A joint does not rest there.
    """
    ends = trajectory.evaluate([0.0, trajectory.duration])
    for name, limit in _REST.items():
        values = np.abs(getattr(ends, name)).max(axis=0)
        if (values > limit).any():
            joint = int(np.argmax(values))
            word = "velocity" if name == "dq" else "acceleration"
            raise InputError(
                f"joint {joint + 1}: the motion does not start and end at rest ({word})",
                value=float(values[joint]),
                limit=limit,
            )
    return ends


class StandingMotion(Trajectory):
    """A motion from one pose to another; before and after, the arm stands still."""

    __slots__ = ()

    @abstractmethod
    def inside(self, t: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations (N, n) at (N) times from 0 to `duration`."""

    def evaluate(self, t: ArrayLike) -> JointMotion:
        """The motion at any times (N) [s]; outside of it the arm stands at the nearer end.

        Raises:
            InputError: Times that are not a list of finite numbers.
        """
        times = frozen(t, shape=(None,), name="t")
        held = np.clip(times, 0.0, self.duration)
        q, dq, ddq = self.inside(held)
        moves = (times == held)[:, None]
        return JointMotion(t=times, q=q, dq=np.where(moves, dq, 0.0), ddq=np.where(moves, ddq, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionFamily(ABC):
    """Motions q = offset + B0 y, dq = B1 y, ddq = B2 y, with free numbers y of each joint.

    Every member starts and ends at the same pose with no velocity and no acceleration, whatever
    y is: an optimiser needs no equality constraints, and the motion can be repeated.

    Raises:
        InputError: A duration that is not positive, or an order below the least.
    """

    name: ClassVar[str]
    """The name in settings and on the command line."""
    least: ClassVar[int] = 1
    """Smallest order."""
    duration: float
    """Time from start to end, the period of harmonics [s]."""
    order: int
    """Number of harmonics H, or of free points of each joint between the ends, in equal times."""

    def __post_init__(self) -> None:
        require_positive("the duration", self.duration)
        require_whole(f"harmonics or free points of a {self.name} motion", self.order, self.least)

    @property
    def free_count(self) -> int:
        """Free numbers k of each joint: one a point, relative to the offset."""
        return self.order

    @property
    def corners(self) -> Array:
        """(N) times on either side of jumps of the acceleration [s]; most families have none."""
        return np.empty(0)

    @abstractmethod
    def member(self, pose: Array, free: Array) -> Trajectory:
        """The member with a pose (n) and free numbers (n, k), both checked; see `trajectory`."""

    def trajectory(self, offset: ArrayLike, free: ArrayLike) -> Trajectory:
        """The member with these numbers.

        Args:
            offset: (n) what is added to every position [rad or m].
            free: (n, k) free numbers, a row a joint [rad or m].

        Raises:
            InputError: Shapes that disagree, or numbers that are not finite.
        """
        pose = frozen(offset, shape=(None,), name="offset")
        numbers = frozen(free, shape=(len(pose), self.free_count), name="free numbers")
        return self.member(pose, numbers)

    def basis(self, t: Array) -> tuple[Array, Array, Array]:
        """The columns of the motion, and their first two derivatives, at times (N) within it [s].

        They are the motion of an arm with a joint for each free number, which is one there.

        Returns:
            Three (N, k) matrices B0 [1], B1 [1/s] and B2 [1/s^2].
        """
        motion = self.member(np.zeros(self.free_count), np.eye(self.free_count)).evaluate(t)
        return motion.q, motion.dq, motion.ddq
