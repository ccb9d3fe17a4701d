"""Joint limits; NaN where a number is not published."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.core.errors import RobotError


@dataclass(frozen=True, slots=True, kw_only=True)
class JointLimits:
    """Bounds of each joint, joint side.

    Raises:
        RobotError: A lower bound above its upper bound, or a bound that is not positive.
    """

    lower: Array
    """(n) smallest position [rad or m], NaN if unknown."""
    upper: Array
    """(n) largest position [rad or m], NaN if unknown."""
    velocity: Array
    """(n) largest speed [rad/s or m/s], NaN if unknown."""
    acceleration: Array
    """(n) largest acceleration [rad/s^2 or m/s^2], NaN if unknown."""
    torque: Array
    """(n) largest torque or force [N.m or N], NaN if unknown."""

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.lower))
        for name in ("lower", "upper", "velocity", "acceleration", "torque"):
            value = frozen(getattr(self, name), shape=(n,), name=f"limit {name}", finite=False)
            object.__setattr__(self, name, value)
            if name not in ("lower", "upper") and (value <= 0).any():
                raise RobotError(f"the {name} limits must be positive", value=value.tolist())
        if (self.lower > self.upper).any():
            joint = int(np.argmax(self.lower > self.upper))
            raise RobotError(
                f"joint {joint + 1}: lower position limit above the upper one",
                value=float(self.lower[joint]),
                limit=float(self.upper[joint]),
            )


def unknown_limits(joints: int) -> JointLimits:
    """Limits of which nothing is known."""
    nan = np.full(joints, np.nan)
    return JointLimits(lower=nan, upper=nan, velocity=nan, acceleration=nan, torque=nan)
