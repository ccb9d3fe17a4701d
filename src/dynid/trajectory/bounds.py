"""The bounds that a motion must respect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError

_NAMES = ("lower", "upper", "velocity", "acceleration")


class MotionLimits(Protocol):
    """Anything with joint limits, such as `RobotModel.limits`; NaN where unknown."""

    @property
    def lower(self) -> Array:
        """(n) smallest positions [rad or m]."""
        ...

    @property
    def upper(self) -> Array:
        """(n) largest positions [rad or m]."""
        ...

    @property
    def velocity(self) -> Array:
        """(n) largest speeds [rad/s or m/s]."""
        ...

    @property
    def acceleration(self) -> Array:
        """(n) largest accelerations [rad/s^2 or m/s^2]."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionBounds:
    """Bounds of position, velocity and acceleration, one number a joint.

    Raises:
        InputError: Shapes that disagree, a lower bound above its upper one, or a bound of
            velocity or acceleration that is not positive.
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
        n = np.size(self.lower)
        for name in _NAMES:
            value = frozen(getattr(self, name), shape=(n,), name=f"{name} bounds", finite=False)
            object.__setattr__(self, name, value)
        for name in ("velocity", "acceleration"):
            value = getattr(self, name)
            if (value <= 0).any():
                raise InputError(f"the {name} bounds must be positive", value=value.tolist())
        if (self.lower > self.upper).any():
            joint = int(np.argmax(self.lower > self.upper))
            raise InputError(
                f"joint {joint + 1}: lower position bound above the upper one",
                value=float(self.lower[joint]),
                limit=float(self.upper[joint]),
            )

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.lower)


def copied_bounds(limits: MotionLimits) -> MotionBounds:
    """The motion part of any limits, NaN kept."""
    return MotionBounds(**{name: getattr(limits, name) for name in _NAMES})


def usable_bounds(limits: MotionLimits, acceleration: ArrayLike | None = None) -> MotionBounds:
    """Bounds without NaN, for a search or a scaling.

    An unknown position bound becomes -pi or pi (2 pi from the known one if that is beyond); an
    unknown velocity or acceleration bound becomes infinite: it does not bind.

    Args:
        limits: The limits, NaN where unknown.
        acceleration: (n) or one number: acceleration bounds where the limits know none
            [rad/s^2 or m/s^2].
    """
    known = copied_bounds(limits)
    lower = np.where(np.isnan(known.lower), -np.pi, known.lower)
    upper = np.where(np.isnan(known.upper), np.pi, known.upper)
    crossed = lower > upper
    lower = np.where(crossed & np.isnan(known.lower), upper - 2 * np.pi, lower)
    upper = np.where(crossed & np.isnan(known.upper), lower + 2 * np.pi, upper)
    velocity = np.where(np.isnan(known.velocity), np.inf, known.velocity)
    try:
        spare = np.broadcast_to(
            np.asarray(np.inf if acceleration is None else acceleration, dtype=np.float64),
            known.acceleration.shape,
        )
    except (TypeError, ValueError) as error:
        raise InputError(
            "acceleration must be one number, or one a joint",
            value=acceleration,
            limit=known.joints,
        ) from error
    return MotionBounds(
        lower=lower,
        upper=upper,
        velocity=velocity,
        acceleration=np.where(np.isnan(known.acceleration), spare, known.acceleration),
    )
