"""Counterbalances: torques that are known functions of one joint position."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import RobotError


@dataclass(frozen=True, slots=True, kw_only=True)
class Counterbalance:
    """A gas-hydraulic cylinder between link and base (heavy KUKA, ABB and Fanuc arms).

    The cylinder's ends sit `outer` and `inner` from the joint axis; its length is
    x = sqrt(outer^2 + inner^2 - 2 outer inner cos(q + offset)) and the gas pressure is
    gas_work / (gas_volume - (x - rest_length) piston_area): the gas is pressed by pulling the
    cylinder longer, so the arm is drawn to where the cylinder is shortest, q = -offset.

    Raises:
        RobotError: A length, area, volume or work that is not positive and finite, or a gas
            volume that the longest cylinder would use up.
    """

    joint: int
    """Index of the joint, from 0."""
    outer: float
    """Distance from the axis to the far anchor [m]."""
    inner: float
    """Distance from the axis to the near anchor [m]."""
    rest_length: float
    """Cylinder length at the filling pressure [m]."""
    offset: float
    """Angle between the anchors at q = 0 [rad]."""
    piston_area: float
    """Effective area [m^2]."""
    gas_work: float
    """Pressure times volume of the gas [J]."""
    gas_volume: float
    """Gas volume at rest length [m^3]."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            positive = item.name not in ("joint", "offset")
            if not math.isfinite(value) or (positive and value <= 0):
                raise RobotError(
                    f"counterbalance {item.name} must be a positive number", value=value
                )
        if math.isclose(self.outer, self.inner):
            raise RobotError("counterbalance outer and inner must differ", value=self.outer)
        longest = self.outer + self.inner
        if self.gas_volume <= (longest - self.rest_length) * self.piston_area:
            raise RobotError(
                "counterbalance: the longest cylinder would use up the gas volume",
                value=self.gas_volume,
                limit=f"above {(longest - self.rest_length) * self.piston_area:.3g} m^3",
            )

    def torque(self, q: Array) -> Array:
        """The torque of the cylinder on the joint [N.m], positive in the joint's sense.

        It relieves the motor: the measured torque is Y p - torque(q). It is minus the slope
        of the gas's energy over q, so it draws the arm to where the cylinder is shortest.

        Args:
            q: (...) positions of the joint [rad].
        """
        delta = q + self.offset
        length = np.sqrt(
            self.outer**2 + self.inner**2 - 2 * self.outer * self.inner * np.cos(delta)
        )
        arm = self.outer * self.inner * np.sin(delta) / length
        volume = self.gas_volume - (length - self.rest_length) * self.piston_area
        return -arm * self.gas_work / volume * self.piston_area
