"""Speed profiles of moves: how far along its way a move is at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dynid.core import InputError


@dataclass(frozen=True, slots=True)
class Trapezoid:
    """From rest to rest with constant acceleration, constant speed, constant deceleration."""

    length: float
    """Way to go [m or rad]."""
    peak: float
    """Largest speed reached [m/s or rad/s]."""
    acceleration: float
    """[m/s^2 or rad/s^2]."""

    @property
    def duration(self) -> float:
        """Time from rest to rest [s]."""
        if self.length == 0.0:
            return 0.0
        return self.length / self.peak + self.peak / self.acceleration

    def share(self, t: float) -> float:
        """Share of the way done at a time [s], 0 to 1."""
        total = self.duration
        if t >= total or self.length == 0.0:
            return 1.0
        ramp = self.peak / self.acceleration
        if t < ramp:
            way = 0.5 * self.acceleration * t * t
        elif t > total - ramp:
            way = self.length - 0.5 * self.acceleration * (total - t) ** 2
        else:
            way = self.peak * (t - 0.5 * ramp)
        return way / self.length


def trapezoid(length: float, speed: float, acceleration: float, time: float = 0.0) -> Trapezoid:
    """The profile of a move.

    Args:
        length: Way to go, not negative [m or rad].
        speed: Speed asked for [m/s or rad/s].
        acceleration: Acceleration asked for [m/s^2 or rad/s^2].
        time: If positive, how long the move takes, in place of speed and acceleration [s].

    Raises:
        InputError: A speed or acceleration that is not positive, or numbers that are not finite.
    """
    if not all(map(math.isfinite, (length, speed, acceleration, time))):
        raise InputError("a move needs finite numbers", value=(length, speed, acceleration, time))
    if time > 0.0:
        # A quarter of the time each to speed up and to slow down.
        peak = length / (0.75 * time)
        return Trapezoid(length, peak, peak / (0.25 * time))
    if speed <= 0.0 or acceleration <= 0.0:
        raise InputError(
            "speed and acceleration of a move must be positive", value=(speed, acceleration)
        )
    return Trapezoid(length, min(speed, math.sqrt(length * acceleration)), acceleration)
