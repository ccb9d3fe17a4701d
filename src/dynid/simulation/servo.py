"""The joint servo of the simulated robot, its sensors and its exact state."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from dynid.core import Array, InputError, frozen


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """What the servo aims at; all arrays (n)."""

    q: Array
    """Positions [rad or m]."""
    dq: Array
    """Velocities [rad/s or m/s]."""
    ddq: Array
    """Accelerations [rad/s^2 or m/s^2]."""
    moment: Array
    """Torques of the controller's own model, without friction [N.m]."""
    feedforward: Array
    """`moment` and the friction that the controller compensates [N.m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantState:
    """The arm at the start of a control cycle; all arrays (n)."""

    t: float
    """Time since the reset [s]."""
    q: Array
    """Positions [rad or m]."""
    dq: Array
    """Velocities [rad/s or m/s]."""
    ddq: Array
    """Accelerations [rad/s^2 or m/s^2]."""
    torque: Array
    """Motor torques, joint side [N.m]."""
    friction: Array
    """Friction torques [N.m]; M ddq + bias = torque - friction (and known springs)."""
    temperature: Array
    """Joint temperatures [degC]."""
    target: Target
    """What the servo aims at."""
    saturated: NDArray[np.bool_]
    """Whether the servo hit its torque limit in this cycle."""
