"""Blends: a move that goes on while the next one begins.

A move with a blend radius hands over when it brakes and its tool is within the radius of the way
point. From there on the rest of its way is added to the next move, joint by joint: the arm rounds
the way point within the radius and keeps its speed on a straight way. Where no move follows, the
rest is moved alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from dynid.simulation.controller.machine_arm import ControlledArm
from dynid.simulation.controller.motion_profile import Trapezoid


@dataclass(slots=True)
class Rest:
    """What is left of a move that has handed over."""

    profile: Trapezoid
    place: Callable[[float], list[float]]
    """Joint positions (6) at a share of the way [rad]."""
    end: list[float]
    """(6) the way point [rad]."""
    t: float
    """Time since the move began [s]."""
    last: list[float]
    """(6) the last set point [rad]."""

    def next(self, step: float) -> list[float] | None:
        """(6) how far the next set point is from the way point [rad]; None at its end.

        Args:
            step: Time that passes [s].
        """
        self.t += step
        if self.t >= self.profile.duration:
            return None
        place = self.place(self.profile.share(self.t))
        return [q - e for q, e in zip(place, self.end, strict=True)]

    def alone(self, arm: ControlledArm, step: float) -> bool:
        """Move the arm on, where no other move does; whether there is still a way to go.

        Args:
            arm: The arm; one that was moved or stopped meanwhile is left alone.
            step: Time that passes [s].
        """
        if arm.setpoint != self.last:
            return False
        offset = self.next(step)
        self.last = (
            list(self.end)
            if offset is None
            else [e + d for e, d in zip(self.end, offset, strict=True)]
        )
        arm.command(self.last)
        return offset is not None


def hands_over(distance: Callable[[], float], profile: Trapezoid, t: float, radius: float) -> bool:
    """Whether a move lets the next one begin.

    Args:
        distance: Tells how far the tool is from the way point [m].
        profile: Its profile.
        t: Time since it began [s].
        radius: The blend radius [m].
    """
    if radius <= 0.0 or not math.isfinite(radius) or profile.length == 0.0:
        return False
    braking = profile.duration - profile.peak / profile.acceleration
    return braking <= t < profile.duration and distance() <= radius
