"""Fifth-order polynomials from rest to rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.trajectory.bounds import MotionLimits, usable_bounds
from dynid.trajectory.motion import JointMotion
from dynid.trajectory.scaling import inner_range
from dynid.trajectory.trajectory import Trajectory

_PEAK_VELOCITY = 15.0 / 8.0
_PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Quintic(Trajectory):
    """A straight line in joint space, q = start + (goal - start) (10 s^3 - 15 s^4 + 6 s^5).

    With s = t / duration it is the one fifth-order polynomial whose velocity and acceleration
    vanish at both ends; before and after, the arm stands still.

    Raises:
        InputError: A travel time that is not positive, or poses that disagree or are not finite.
    """

    start: Array
    """(n) first pose [rad or m]."""
    goal: Array
    """(n) last pose [rad or m]."""
    travel_time: float
    """Time from start to goal [s]."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.travel_time) and self.travel_time > 0):
            raise InputError("the travel time must be positive", value=self.travel_time)
        object.__setattr__(self, "start", frozen(self.start, shape=(None,), name="start"))
        goal = frozen(self.goal, shape=self.start.shape, name="goal")
        object.__setattr__(self, "goal", goal)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.start)

    @property
    def duration(self) -> float:
        """The travel time [s]."""
        return self.travel_time

    def evaluate(self, t: ArrayLike) -> JointMotion:
        """The motion at any times.

        Args:
            t: (N) times [s]; outside 0 to `duration` the arm stands at the nearer end.

        Raises:
            InputError: Times that are not a list of finite numbers.
        """
        times = frozen(t, shape=(None,), name="t")
        s = np.clip(times / self.duration, 0.0, 1.0)
        way = (self.goal - self.start)[None, :]
        place = s**3 * (10.0 + s * (6.0 * s - 15.0))
        speed = 30.0 * s**2 * (1.0 - s) ** 2 / self.duration
        push = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / self.duration**2
        return JointMotion(
            t=times,
            # From the middle outwards the goal is the anchor, so both ends are met exactly.
            q=np.where(
                s[:, None] < 0.5,
                self.start + place[:, None] * way,
                self.goal - (1.0 - place[:, None]) * way,
            ),
            dq=speed[:, None] * way,
            ddq=push[:, None] * way,
        )


def rest_to_rest(
    start: ArrayLike,
    goal: ArrayLike,
    limits: MotionLimits,
    *,
    margin: float = 0.5,
    acceleration: ArrayLike | None = None,
    shortest: float = 0.1,
) -> Quintic:
    """The fastest quintic between two poses that the limits allow.

    Its largest speed is 15/8 |goal - start| / duration and its largest acceleration
    10/sqrt(3) |goal - start| / duration^2, so the duration follows in closed form.

    Args:
        start: (n) first pose [rad or m].
        goal: (n) last pose [rad or m].
        limits: Joint limits; unknown positions count as -pi to pi, other unknowns do not bind.
        margin: Share of the velocity and acceleration limits to use, in (0, 1].
        acceleration: (n) or one number: acceleration limits where `limits` knows none
            [rad/s^2 or m/s^2].
        shortest: Duration of a move of no length [s].

    Raises:
        InputError: A pose outside the position limits, a margin outside (0, 1], or no limit
            that bounds the speed.
    """
    bounds = usable_bounds(limits, acceleration)
    poses = {
        name: frozen(value, shape=(bounds.joints,), name=name)
        for name, value in (("start", start), ("goal", goal))
    }
    inner_range(bounds, margin)
    for name, pose in poses.items():
        outside = (pose < bounds.lower) | (pose > bounds.upper)
        if outside.any():
            joint = int(np.argmax(outside))
            raise InputError(
                f"joint {joint + 1}: the {name} pose is outside the position limits",
                value=float(pose[joint]),
                limit=(float(bounds.lower[joint]), float(bounds.upper[joint])),
            )
    way = np.abs(poses["goal"] - poses["start"])
    unbounded = np.isinf(bounds.velocity) & np.isinf(bounds.acceleration) & (way > 0)
    if unbounded.any():
        raise InputError(
            f"joint {int(np.argmax(unbounded)) + 1}: neither speed nor acceleration is limited",
            next_step="Give `acceleration`.",
        )
    by_velocity = _PEAK_VELOCITY * way / (margin * bounds.velocity)
    by_acceleration = np.sqrt(_PEAK_ACCELERATION * way / (margin * bounds.acceleration))
    duration = max(shortest, float(by_velocity.max()), float(by_acceleration.max()))
    return Quintic(**poses, travel_time=duration)
