"""The same path, slower: the first pass on a robot."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, is_dataclass, replace

from numpy.typing import ArrayLike

from dynid.core.arrays import frozen
from dynid.core.errors import InputError
from dynid.trajectory.motion import JointMotion
from dynid.trajectory.sequence import MotionSequence, Repetition
from dynid.trajectory.trajectory import Trajectory

_CLOCKS = ("period", "travel_time")


@dataclass(frozen=True, slots=True, kw_only=True)
class Slowed(Trajectory):
    """q(share t) of another motion.

    Raises:
        InputError: A share outside (0, 1].
    """

    motion: Trajectory
    """The motion at full speed."""
    share: float
    """Its speed now as a share of that."""

    def __post_init__(self) -> None:
        check_share(self.share)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.motion.joints

    @property
    def duration(self) -> float:
        """The motion's duration over the share [s]."""
        return self.motion.duration / self.share

    def evaluate(self, t: ArrayLike) -> JointMotion:
        """The motion at any times.

        Args:
            t: (N) times [s].

        Raises:
            InputError: Times that are not a list of finite numbers.
        """
        times = frozen(t, shape=(None,), name="t")
        fast = self.motion.evaluate(times * self.share)
        return JointMotion(t=times, q=fast.q, dq=self.share * fast.dq, ddq=self.share**2 * fast.ddq)


def slowed(motion: Trajectory, share: float) -> Trajectory:
    """The same path at a share of the speed, as the same kind of motion where it can be.

    Speeds fall by the share, accelerations by its square. Motions that carry their own time
    stay what they are, so that a controller can evaluate them.

    Args:
        motion: The motion at full speed.
        share: Speed as a share of full speed, in (0, 1].

    Raises:
        InputError: A share outside (0, 1].
    """
    check_share(share)
    if share == 1.0:
        return motion
    if isinstance(motion, MotionSequence):
        return replace(motion, parts=tuple(slowed(part, share) for part in motion.parts))
    if isinstance(motion, Repetition):
        return replace(motion, part=slowed(motion.part, share))
    names = {item.name for item in fields(motion)} if is_dataclass(motion) else set[str]()
    for clock in _CLOCKS:
        if clock in names and is_dataclass(motion):
            return replace(motion, **{clock: getattr(motion, clock) / share})
    return Slowed(motion=motion, share=share)


def whole_cycles_share(duration: float, share: float, rate_hz: float) -> float:
    """The largest share not above the one asked for that gives whole control cycles.

    Args:
        duration: Duration at full speed [s].
        share: The share asked for.
        rate_hz: Control cycles a second.

    Raises:
        InputError: A share outside (0, 1].
    """
    check_share(share)
    cycles = math.ceil(duration * rate_hz / share - 1e-6)
    return duration * rate_hz / cycles


def check_share(share: float) -> None:
    """Refuse what is no share of the full speed.

    Raises:
        InputError: A share outside (0, 1].
    """
    if not 0.0 < share <= 1.0:
        raise InputError("the share of the speed", value=share, limit="above 0, at most 1")
