"""What the simulated robot measures of itself."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class JointSensors:
    """White noise of a standard deviation, then rounding to a step; zero for neither.

    Raises:
        InputError: Shapes that disagree or negative numbers.
    """

    position_noise: Array
    """(n) [rad or m]."""
    position_step: Array
    """(n) [rad or m]."""
    velocity_noise: Array
    """(n) [rad/s or m/s]."""
    velocity_step: Array
    """(n) [rad/s or m/s]."""
    current_noise: Array
    """(n) [A]."""
    current_step: Array
    """(n) [A]."""
    temperature_noise: Array
    """(n) [K]."""
    temperature_step: Array
    """(n) [K]."""

    def __post_init__(self) -> None:
        n = np.size(self.position_noise)
        for item in fields(self):
            value = frozen(getattr(self, item.name), shape=(n,), name=f"sensor {item.name}")
            object.__setattr__(self, item.name, value)
            if (value < 0).any():
                raise InputError(f"sensor {item.name} must not be negative", value=value.tolist())

    def read(self, quantity: str, true: Array, generator: np.random.Generator) -> Array:
        """Measured values.

        Args:
            quantity: `position`, `velocity`, `current` or `temperature`.
            true: (..., n) true values.
            generator: Where the noise comes from.
        """
        noise: Array = getattr(self, f"{quantity}_noise")
        step: Array = getattr(self, f"{quantity}_step")
        noisy = true + noise * generator.standard_normal(true.shape)
        grid = np.where(step > 0, step, 1.0)
        return np.where(step > 0, grid * np.round(noisy / grid), noisy)


def perfect_sensors(joints: int) -> JointSensors:
    """Sensors that measure the truth."""
    zero = np.zeros(joints)
    return JointSensors(**{item.name: zero for item in fields(JointSensors)})


def chosen_sensors(
    joints: int, *, position: float = 0.0, velocity: float = 0.0, current: float = 0.0
) -> JointSensors:
    """Sensors with white noise alone, the same for all joints.

    Args:
        joints: Number of joints n.
        position: Standard deviation [rad or m].
        velocity: Standard deviation [rad/s or m/s].
        current: Standard deviation [A].

    Raises:
        InputError: A negative standard deviation.
    """
    one, zero = np.ones(joints), np.zeros(joints)
    return JointSensors(
        position_noise=position * one,
        position_step=zero,
        velocity_noise=velocity * one,
        velocity_step=zero,
        current_noise=current * one,
        current_step=zero,
        temperature_noise=zero,
        temperature_step=zero,
    )
