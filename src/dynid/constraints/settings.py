"""What a motion is held to."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from dynid.constraints.scene import Scene
from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.trajectory.bounds import MotionBounds

_HEAVIEST = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstraintSettings:
    """The limits that are switched on.

    What is on but unknown for a robot (no torque limits, no capsules) does not bind; the
    judge reports it as not judged.

    Raises:
        InputError: Bounds with NaN, or a clearance, share or tool point out of range.
    """

    bounds: MotionBounds
    """Position, velocity, acceleration; usable, that is without NaN."""
    torque: bool = True
    """Hold the robot's torque limits, with the prior model."""
    tcp_speed: bool = True
    elbow_speed: bool = True
    momentum: bool = True
    power: bool = True
    self_collision: bool = True
    scene: Scene | None = None
    """What stands around the robot and what it carries; None for nothing."""
    clearance: float = 0.01
    """Smallest distance to the scene that counts as safe [m]."""
    self_clearance: float = 0.001
    """The same between bodies of the arm, whose places are known better [m]."""
    torque_uncertainty: float = 0.15
    """Share by which the prior model may underestimate a torque."""
    tcp: Array = field(default_factory=lambda: np.zeros(3))
    """(3) the tool's point in the flange's frame [m]."""
    payload_mass: float = 0.0
    """What the flange carries, as a point: it counts for torque, momentum and power [kg]."""
    payload_com: Array = field(default_factory=lambda: np.zeros(3))
    """(3) its centre of mass in the flange's frame [m]."""

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "velocity", "acceleration"):
            if np.isnan(getattr(self.bounds, name)).any():
                raise InputError(
                    f"the {name} bounds hold an unknown number", next_step="Use usable_bounds."
                )
        if (self.bounds.lower >= self.bounds.upper).any():
            joint = int(np.argmax(self.bounds.lower >= self.bounds.upper))
            raise InputError(
                f"joint {joint + 1}: the position limits leave no room to move",
                value=(float(self.bounds.lower[joint]), float(self.bounds.upper[joint])),
            )
        object.__setattr__(self, "tcp", frozen(self.tcp, shape=(3,), name="tool point"))
        centre = frozen(self.payload_com, shape=(3,), name="centre of the payload")
        object.__setattr__(self, "payload_com", centre)
        if not (math.isfinite(self.payload_mass) and 0 <= self.payload_mass < _HEAVIEST):
            raise InputError(
                "mass of the payload", value=self.payload_mass, limit=f"0 to {_HEAVIEST:g} kg"
            )
        for name in ("clearance", "self_clearance"):
            value = getattr(self, name)
            if not (math.isfinite(value) and 0 <= value < 1):
                raise InputError(name, value=value, limit="0 to 1 m")
        if not (math.isfinite(self.torque_uncertainty) and 0 <= self.torque_uncertainty < 10):
            raise InputError("share of uncertain torque", value=self.torque_uncertainty)

    @property
    def clearances(self) -> dict[str, float]:
        """Kind of distance to the smallest that is allowed [m]."""
        return {"self_collision": self.self_clearance, "environment": self.clearance}
