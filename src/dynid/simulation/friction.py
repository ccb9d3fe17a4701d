"""Friction of the simulated joints, and how it changes as they warm up."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, frozen


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFriction:
    """Friction torques, richer than the Coulomb and viscous terms that are identified.

    With `width` unset, bristles (LuGre: Canudas de Wit, Olsson, Astrom, Lischinsky 1995) carry
    the dry part; z is their deflection:

        dz/dt = dq - stiffness |dq| z / g
        g     = Fc(T) + load_factor |load| + breakaway exp(-(dq / stribeck_velocity)^2)
        F     = stiffness z + damping dz/dt + Fv(T) dq
        Fc(T) = coulomb (1 - coulomb_drift (T - reference_degC))
        Fv(T) = viscous exp(-viscous_decay (T - reference_degC))

    The load is the torque that passes through the gear. With `width` set the law is the ideal
    one, F = Fc(T) tanh(dq / width) + Fv(T) dq, and the other dry terms are not used.

    Raises:
        InputError: Shapes that disagree, negative numbers, or a width, stiffness or Stribeck
            velocity that is zero.
    """

    coulomb: Array
    """(n) Fc, dry friction without load at the reference temperature [N.m]."""
    viscous: Array
    """(n) Fv at the reference temperature [N.m.s/rad]."""
    breakaway: Array
    """(n) dry friction at standstill above Fc [N.m]."""
    stribeck_velocity: Array
    """(n) speed over which the breakaway part fades [rad/s]."""
    load_factor: Array
    """(n) dry friction per torque through the gear [1]."""
    stiffness: Array
    """(n) presliding stiffness of the bristles [N.m/rad]."""
    damping: Array
    """(n) damping of the bristles [N.m.s/rad]."""
    viscous_decay: Array
    """(n) relative fall of Fv per degree [1/K]."""
    coulomb_drift: Array
    """(n) relative fall of Fc per degree [1/K]."""
    reference_degC: float = 24.0
    """Temperature at which `coulomb` and `viscous` hold [degC]."""
    width: float | None = None
    """Speed over which the ideal law changes sign [rad/s]; None for bristles."""

    def __post_init__(self) -> None:
        n = np.size(self.coulomb)
        for item in fields(self)[:9]:
            value = frozen(getattr(self, item.name), shape=(n,), name=f"friction {item.name}")
            object.__setattr__(self, item.name, value)
            strict = item.name in ("stribeck_velocity", "stiffness")
            if (value < 0).any() or (strict and (value == 0).any()):
                raise InputError(f"friction {item.name} must be positive", value=value.tolist())
        if self.width is not None and not self.width > 0:
            raise InputError("friction width must be positive", value=self.width)

    def coulomb_at(self, temperature_degC: Array) -> Array:
        """(n) Fc at temperatures (n) [N.m], never below a tenth of the reference value."""
        rise = temperature_degC - self.reference_degC
        return self.coulomb * np.maximum(1.0 - self.coulomb_drift * rise, 0.1)

    def viscous_at(self, temperature_degC: Array) -> Array:
        """(n) Fv at temperatures (n) [N.m.s/rad]."""
        return self.viscous * np.exp(-self.viscous_decay * (temperature_degC - self.reference_degC))


def ideal_friction(coulomb: Array, viscous: Array, width: float) -> JointFriction:
    """Friction that is exactly Fc tanh(dq / width) + Fv dq at any load and temperature.

    Args:
        coulomb: (n) Fc [N.m].
        viscous: (n) Fv [N.m.s/rad].
        width: Speed over which the sign changes [rad/s].

    Raises:
        InputError: Shapes that disagree, negative friction or a width that is not positive.
    """
    zero, one = np.zeros(np.size(coulomb)), np.ones(np.size(coulomb))
    return JointFriction(
        coulomb=coulomb,
        viscous=viscous,
        breakaway=zero,
        stribeck_velocity=one,
        load_factor=zero,
        stiffness=one,
        damping=zero,
        viscous_decay=zero,
        coulomb_drift=zero,
        width=width,
    )


Thermal = str | ArrayLike
"""`cold`, `warm`, one temperature or one a joint [degC]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointThermal:
    """One heat store a joint: capacity dT/dt = loss - (T - ambient) / resistance.

    The loss is what friction and the winding turn into heat.

    Raises:
        InputError: Shapes that disagree, or a number that is not positive.
    """

    resistance: Array
    """(n) joint to surroundings [K/W]."""
    capacity: Array
    """(n) heat capacity [J/K]; infinite where the temperature never changes."""
    winding: Array
    """(n) copper loss per current squared [W/A^2]."""
    warm_degC: Array
    """(n) temperatures after half an hour of hard motion: the state `warm` [degC]."""
    ambient_degC: float = 24.0
    """Temperature of the surroundings: the state `cold` [degC]."""

    def __post_init__(self) -> None:
        n = np.size(self.resistance)
        for name in ("resistance", "capacity", "winding", "warm_degC"):
            value = frozen(getattr(self, name), shape=(n,), name=f"thermal {name}", finite=False)
            object.__setattr__(self, name, value)
            wrong = np.isnan(value) | (value < 0 if name == "winding" else value <= 0)
            if wrong.any() and name != "warm_degC":
                raise InputError(f"thermal {name} must be positive", value=value.tolist())

    def start(self, state: Thermal) -> Array:
        """(n) the temperatures of a thermal state [degC].

        Args:
            state: `cold`, `warm`, one temperature or one a joint [degC].

        Raises:
            InputError: Another word, another number of joints, or temperatures outside -40 to
                120 degC.
        """
        n = len(self.resistance)
        if isinstance(state, str):
            states = {"cold": np.full(n, self.ambient_degC), "warm": self.warm_degC.copy()}
            if state not in states:
                raise InputError("thermal state", value=state, limit="cold, warm or degC")
            return states[state]
        try:
            values = np.array(np.broadcast_to(np.asarray(state, dtype=np.float64), (n,)))
        except (TypeError, ValueError) as error:
            raise InputError("thermal state", value=state, limit="cold, warm or degC") from error
        if not ((values >= -40) & (values <= 120)).all():
            raise InputError("temperature", value=values.tolist(), limit="-40 to 120 degC")
        return values

    def after(self, temperature_degC: Array, heat: Array, seconds: float) -> Array:
        """(n) the temperatures after a time of constant loss, exactly [degC].

        Args:
            temperature_degC: (n) now [degC].
            heat: (n) loss over the whole time [J].
            seconds: The time [s].
        """
        settled = self.ambient_degC + self.resistance * heat / seconds
        decay = -np.expm1(-seconds / (self.resistance * self.capacity))
        return temperature_degC + (settled - temperature_degC) * decay


def constant_temperature(joints: int, temperature_degC: float = 24.0) -> JointThermal:
    """Joints that never warm up."""
    one = np.ones(joints)
    return JointThermal(
        resistance=one,
        capacity=np.inf * one,
        winding=0 * one,
        warm_degC=temperature_degC * one,
        ambient_degC=temperature_degC,
    )
