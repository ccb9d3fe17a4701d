"""The exact state of the simulated arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.core.arrays import Array


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
