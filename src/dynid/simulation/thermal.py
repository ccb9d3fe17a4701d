"""How the simulated joints warm up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError

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
