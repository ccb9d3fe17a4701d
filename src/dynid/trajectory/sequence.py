"""Motions in sequence, repeated motions, and motions through a list of poses."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, frozen
from dynid.trajectory.bounds import MotionLimits
from dynid.trajectory.quintic import rest_to_rest
from dynid.trajectory.trajectory import JointMotion, Trajectory, still_outside

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


def through_poses(
    poses: ArrayLike,
    limits: MotionLimits,
    *,
    margin: float = 0.5,
    acceleration: ArrayLike | None = None,
) -> Trajectory:
    """The fastest fifth-order polynomials from pose to pose that the limits allow.

    Args:
        poses: (m, n) poses, two or more [rad or m].
        limits: Joint limits; unknown positions count as -pi to pi, other unknowns do not bind.
        margin: Share of the velocity and acceleration limits to use, in (0, 1].
        acceleration: (n) or one number: acceleration limits where `limits` knows none
            [rad/s^2 or m/s^2].

    Raises:
        InputError: Fewer than two poses, a pose outside the position limits, a margin outside
            (0, 1], or no limit that bounds the speed.
    """
    places = frozen(poses, shape=(None, None), name="poses")
    if len(places) < 2:
        raise InputError("a motion needs two poses", value=len(places))
    return chained(
        [
            rest_to_rest(start, goal, limits, margin=margin, acceleration=acceleration)
            for start, goal in itertools.pairwise(places)
        ]
    )
