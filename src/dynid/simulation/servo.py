"""The joint servo of the simulated robot: from set points to torques."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class Servo:
    """How set points become torques, after URScript's `servoj`.

    UR does not publish its law; this one shows the same delay. Set points are joined by straight
    lines, one control cycle late, and pass a critically damped second-order filter, so that the
    target follows the command by `lookahead`. The torque is

        tau = feed-forward + M_jj(q) (w^2 (target_q - q) + 2 w (target_dq - dq)),  w = 4 sqrt(gain)

    with the feed-forward of `ControllerModel`, clipped at the joint's torque limit.

    Raises:
        InputError: A lookahead outside 0.03 to 0.2 s, or a gain outside 100 to 2000.
    """

    lookahead: float = 0.03
    """Delay from command to target [s]."""
    gain: float = 500.0
    """Stiffness of the position loop, as in `servoj` [1]."""

    def __post_init__(self) -> None:
        for name, low, high in (("lookahead", 0.03, 0.2), ("gain", 100.0, 2000.0)):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"servo {name}", value=value, limit=(low, high))

    @property
    def bandwidth(self) -> float:
        """w, natural frequency of the position loop [rad/s]."""
        return 4.0 * math.sqrt(self.gain)

    def filter_rate(self, cycle: float) -> float:
        """Natural frequency of the target filter [rad/s] for a control cycle [s].

        A critically damped filter delays a ramp by 2 / rate; the straight lines already delay it
        by one cycle.
        """
        return 2.0 / max(self.lookahead - cycle, cycle)


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerModel:
    """What the controller believes of its arm: point masses and a simple friction.

    UR's own model (`target_moment`) has masses and centres of mass but next to no inertia
    tensors; `target_current` adds a friction term. It is wrong on purpose.

    Raises:
        InputError: Shapes that disagree.
    """

    masses: Array
    """(n) [kg]."""
    com: Array
    """(n, 3) centres of mass in the joint frames [m]."""
    coulomb: Array
    """(n) dry friction that the feed-forward compensates [N.m]."""
    viscous: Array
    """(n) viscous friction that the feed-forward compensates [N.m.s/rad]."""
    width: float = 0.01
    """Speed over which the compensated dry friction changes sign [rad/s]."""

    def __post_init__(self) -> None:
        n = np.size(self.masses)
        for name, shape in (
            ("masses", (n,)),
            ("com", (n, 3)),
            ("coulomb", (n,)),
            ("viscous", (n,)),
        ):
            value = frozen(getattr(self, name), shape=shape, name=f"controller {name}")
            object.__setattr__(self, name, value)

    def friction(self, dq: Array) -> Array:
        """(n) the friction that it expects at speeds dq (n) [N.m]."""
        return self.coulomb * np.tanh(dq / self.width) + self.viscous * dq
