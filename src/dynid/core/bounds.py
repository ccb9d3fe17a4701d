"""Bounds of motions, which robots, trajectories and judges share."""

from dataclasses import dataclass, fields

import numpy as np

from dynid.core.arrays import Array, freeze
from dynid.core.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionBounds:
    """Bounds of position, velocity and acceleration, one number a joint.

    Raises:
        InputError: Shapes that disagree, a lower limit above its upper one, one that is infinite
            beside one that is not, or another limit that is not positive.
    """

    lower: Array
    """(n) smallest positions [rad or m], NaN if unknown."""
    upper: Array
    """(n) largest positions [rad or m], NaN if unknown."""
    velocity: Array
    """(n) largest speeds [rad/s or m/s], NaN if unknown."""
    acceleration: Array
    """(n) largest accelerations [rad/s^2 or m/s^2], NaN if unknown."""

    def __post_init__(self) -> None:
        names = [item.name for item in fields(self)]
        freeze(self, "limit", finite=False, **dict.fromkeys(names, (np.size(self.lower),)))
        for name in names[2:]:
            value = getattr(self, name)
            if (value <= 0).any():
                raise InputError(f"the {name} limits must be positive", value=value.tolist())
        if (self.lower > self.upper).any():
            joint = int(np.argmax(self.lower > self.upper))
            raise InputError(
                f"joint {joint + 1}: lower position limit above the upper one",
                value=float(self.lower[joint]),
                limit=float(self.upper[joint]),
            )

        one_sided = np.isinf(self.lower) != np.isinf(self.upper)
        if one_sided.any():
            joint = int(np.argmax(one_sided))
            raise InputError(
                f"joint {joint + 1}: one position limit is infinite and the other is not",
                value=(float(self.lower[joint]), float(self.upper[joint])),
                limit="both, neither, or NaN for one that is unknown",
            )

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.lower)

    @property
    def motion(self) -> "MotionBounds":
        """These four bounds alone, without what limits that extend them know besides."""
        names = (item.name for item in fields(MotionBounds))
        return MotionBounds(**{name: getattr(self, name) for name in names})
