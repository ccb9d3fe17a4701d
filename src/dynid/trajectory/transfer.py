"""From where the arm stands onto a motion, and the motion several times."""

from __future__ import annotations

from numpy.typing import ArrayLike

from dynid.core.errors import InputError
from dynid.trajectory.bounds import MotionLimits
from dynid.trajectory.quintic import Quintic, rest_to_rest
from dynid.trajectory.sequence import MotionSequence, Repetition
from dynid.trajectory.trajectory import Trajectory


def transfer_onto(
    trajectory: Trajectory,
    home: ArrayLike,
    limits: MotionLimits,
    *,
    margin: float = 0.25,
    acceleration: ArrayLike | None = None,
) -> Quintic:
    """The fifth-order polynomial from rest at a pose to rest at a motion's start.

    Args:
        trajectory: The motion to come.
        home: (n) where the arm stands [rad or m].
        limits: Joint limits; unknown positions count as -pi to pi, other unknowns do not bind.
        margin: Share of the velocity and acceleration limits to use, in (0, 1].
        acceleration: (n) or one number: acceleration limits where `limits` knows none
            [rad/s^2 or m/s^2].

    Raises:
        InputError: A pose outside the position limits, or no limit that bounds the speed.
    """
    start = trajectory.evaluate([0.0]).q[0]
    return rest_to_rest(home, start, limits, margin=margin, acceleration=acceleration)


def transfer_and_repeat(
    trajectory: Trajectory,
    home: ArrayLike,
    limits: MotionLimits,
    *,
    periods: int = 1,
    dwell: float = 0.0,
    margin: float = 0.25,
    acceleration: ArrayLike | None = None,
) -> MotionSequence:
    """A transfer onto a motion's start, a rest there, then the motion several times.

    Args:
        trajectory: The motion of one period, at rest at both ends.
        home: (n) where the arm stands [rad or m].
        limits: Joint limits; unknown positions count as -pi to pi, other unknowns do not bind.
        periods: How many times the motion runs.
        dwell: How long the arm rests at the start [s].
        margin: Share of the velocity and acceleration limits that the transfer uses.
        acceleration: (n) or one number: acceleration limits where `limits` knows none
            [rad/s^2 or m/s^2].

    Raises:
        InputError: A motion that is not at rest where it starts, a negative dwell, a pose outside
            the position limits, or no limit that bounds the speed.
    """
    way = transfer_onto(trajectory, home, limits, margin=margin, acceleration=acceleration)
    parts: list[Trajectory] = [way]
    if dwell < 0.0:
        raise InputError("the rest before the motion", value=dwell, limit="0 s or more")
    if dwell > 0.0:
        parts.append(Quintic(start=way.goal, goal=way.goal, travel_time=dwell))
    repeated = trajectory if periods == 1 else Repetition(part=trajectory, times=periods)
    return MotionSequence(parts=(*parts, repeated))
