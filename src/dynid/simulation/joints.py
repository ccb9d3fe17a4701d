"""The simulated joints: friction and its warming up, servo, sensors and exact state."""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.core import Array, InputError, freeze, frozen


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
        freeze(self, "thermal", resistance=(n,), winding=(n,), warm_degC=(n,))
        freeze(self, "thermal", finite=False, capacity=(n,))
        for name in ("resistance", "capacity", "winding"):
            value = getattr(self, name)
            if not ((value >= 0) if name == "winding" else (value > 0)).all():
                raise InputError(f"thermal {name} must be positive", value=value.tolist())

    def start(self, state: Thermal) -> Array:
        """(n) the temperatures of a thermal state [degC].

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

        From those now (n) [degC], with the loss over the whole time (n) [J].
        """
        settled = self.ambient_degC + self.resistance * heat / seconds
        decay = -np.expm1(-seconds / (self.resistance * self.capacity))
        return temperature_degC + (settled - temperature_degC) * decay


@dataclass(frozen=True, slots=True, kw_only=True)
class Servo:
    """How set points become torques, after URScript's `servoj`.

    UR does not publish its law; this one shows the same delay. Set points are joined by straight
    lines, one control cycle late, and pass a critically damped second-order filter, so that the
    target follows the command by `lookahead`, or by two cycles if they are longer. The torque is

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
        freeze(self, "controller", masses=(n,), com=(n, 3), coulomb=(n,), viscous=(n,))

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
        """Measured values of true ones (..., n).

        The quantity is `position`, `velocity`, `current` or `temperature`.
        """
        return self.seen(quantity, true, generator.standard_normal(true.shape))

    def seen(self, quantity: str, true: Array, noise: Array) -> Array:
        """Measured values, as `read`, for noise (..., n) of standard deviation 1."""
        deviation: Array = getattr(self, f"{quantity}_noise")
        step: Array = getattr(self, f"{quantity}_step")
        noisy = true + deviation * noise
        grid = np.where(step > 0, step, 1.0)
        return np.where(step > 0, grid * np.round(noisy / grid), noisy)


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
