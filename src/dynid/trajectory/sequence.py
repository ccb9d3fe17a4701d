"""Motions one after the other, and one motion again and again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.trajectory.motion import JointMotion, still_outside
from dynid.trajectory.trajectory import Trajectory

_JUMP = 1e-6
"""Largest jump where two parts meet: rad, rad/s and rad/s^2 (m for prismatic joints)."""
_MOST = 10_000
"""Repetitions; more is a mistake, and would fill the memory of what lists them."""
_WORDS = {"q": "position", "dq": "velocity", "ddq": "acceleration"}


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionSequence(Trajectory):
    """Parts run one after the other; before and after, the arm stands still.

    Raises:
        InputError: No parts, parts of different joints, or a part that does not go on from where
            the one before ends, in position, velocity and acceleration.
    """

    parts: tuple[Trajectory, ...]
    """The motions in their order."""

    def __post_init__(self) -> None:
        if not self.parts:
            raise InputError("a sequence needs a part")
        object.__setattr__(self, "parts", tuple(self.parts))
        for index, (before, after) in enumerate(
            zip(self.parts[:-1], self.parts[1:], strict=True), start=2
        ):
            _check_meeting(before, after, f"part {index} of the sequence")

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.parts[0].joints

    @property
    def starts(self) -> Array:
        """(parts) when each part starts [s]."""
        return np.concatenate([[0.0], np.cumsum([part.duration for part in self.parts[:-1]])])

    @property
    def duration(self) -> float:
        """The parts' durations added up [s]."""
        return float(self.starts[-1]) + self.parts[-1].duration

    def evaluate(self, t: ArrayLike) -> JointMotion:
        """The motion at any times.

        Args:
            t: (N) times [s]; outside 0 to `duration` the arm stands at the nearer end.

        Raises:
            InputError: Times that are not a list of finite numbers.
        """
        times = frozen(t, shape=(None,), name="t")
        starts = self.starts
        inside = np.clip(times, 0.0, self.duration)
        index = np.searchsorted(starts, inside, side="right") - 1
        q, dq, ddq = (np.empty((len(times), self.joints)) for _ in range(3))
        for number, part in enumerate(self.parts):
            mine = index == number
            if not mine.any():
                continue
            # A time that rounding puts after the part belongs to its end, not to a new period.
            motion = part.evaluate(np.minimum(inside[mine] - starts[number], part.duration))
            q[mine], dq[mine], ddq[mine] = motion.q, motion.dq, motion.ddq
        return still_outside(times, inside, q, dq, ddq)


@dataclass(frozen=True, slots=True, kw_only=True)
class Repetition(Trajectory):
    """One motion several times over; before and after, the arm stands still.

    Raises:
        InputError: No repetition, more than 10 000 of them, or a motion that does not end where
            and as it starts.
    """

    part: Trajectory
    """The motion of one period."""
    times: int
    """How many periods."""

    def __post_init__(self) -> None:
        if not 1 <= self.times <= _MOST:
            raise InputError("the number of repetitions", value=self.times, limit=(1, _MOST))
        if self.times > 1:
            _check_meeting(self.part, self.part, "the repetition")

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.part.joints

    @property
    def duration(self) -> float:
        """All periods together [s]."""
        return self.times * self.part.duration

    def evaluate(self, t: ArrayLike) -> JointMotion:
        """The motion at any times.

        Args:
            t: (N) times [s]; outside 0 to `duration` the arm stands at the nearer end.

        Raises:
            InputError: Times that are not a list of finite numbers.
        """
        times = frozen(t, shape=(None,), name="t")
        inside = np.clip(times, 0.0, self.duration)
        period = self.part.duration
        local = np.where(inside < self.duration, np.mod(inside, period), period)
        motion = self.part.evaluate(local)
        return still_outside(times, inside, motion.q, motion.dq, motion.ddq)


def chained(parts: Sequence[Trajectory]) -> Trajectory:
    """The parts as one motion; a single part stays what it is.

    Raises:
        InputError: No parts, or parts that do not meet.
    """
    return parts[0] if len(parts) == 1 else MotionSequence(parts=tuple(parts))


def _check_meeting(before: Trajectory, after: Trajectory, where: str) -> None:
    if before.joints != after.joints:
        raise InputError(
            "joints of the motion", where=where, value=after.joints, limit=before.joints
        )
    end, start = before.evaluate([before.duration]), after.evaluate([0.0])
    for name, word in _WORDS.items():
        jump = np.abs(getattr(start, name) - getattr(end, name))[0]
        if (jump > _JUMP).any():
            joint = int(np.argmax(jump))
            raise InputError(
                f"joint {joint + 1}: the {word} jumps where the motions meet",
                where=where,
                value=float(jump[joint]),
                limit=_JUMP,
            )
