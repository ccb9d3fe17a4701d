"""The safety limits that a robot's controller watches beside those of its joints."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dynid.core.errors import RobotError


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyLimits:
    """Limits of the whole arm; NaN where a number is not published.

    Raises:
        RobotError: A limit that is not positive, or an elbow that is no joint.
    """

    tcp_speed: float = math.nan
    """Largest speed of the tool's point [m/s]."""
    elbow_speed: float = math.nan
    """Largest speed of the elbow [m/s]."""
    momentum: float = math.nan
    """Largest linear momentum of the arm [kg.m/s]."""
    power: float = math.nan
    """Largest mechanical power of the arm [W]."""
    elbow: int = 0
    """The joint at whose `urdf` frame the elbow is, counted from 1; 0 where there is none."""

    def __post_init__(self) -> None:
        for name in ("tcp_speed", "elbow_speed", "momentum", "power"):
            value = getattr(self, name)
            if value <= 0 or math.isinf(value):
                raise RobotError(f"the safety limit {name} must be positive", value=value)
        if self.elbow < 0:
            raise RobotError("the elbow is a joint, counted from 1", value=self.elbow)
