"""Half an hour of hard motion, in seconds."""

from __future__ import annotations

import math

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.simulation.plant import Plant
from dynid.simulation.thermal import Thermal
from dynid.simulation.truth import SimulatedArm
from dynid.trajectory.trajectory import Trajectory


def warm_up(
    arm: SimulatedArm,
    trajectory: Trajectory,
    seconds: float = 1800.0,
    *,
    thermal: Thermal = "cold",
    looks: int = 12,
) -> Array:
    """The temperatures after repeating a trajectory for a long time.

    Heat flows far more slowly than the arm moves, so one period is simulated `looks` times on
    the way and its mean loss is held in between.

    Args:
        arm: The simulated arm.
        trajectory: What to repeat.
        seconds: For how long [s].
        thermal: `cold`, `warm`, one temperature or one a joint [degC], at the start.
        looks: How often the losses are looked at.

    Returns:
        (n) temperatures [degC].

    Raises:
        InputError: As `simulate`, or a time or number of looks that is not positive.
        JobError: The simulated arm ran away.
    """
    if not (math.isfinite(seconds) and seconds > 0) or looks < 1:
        raise InputError("seconds and looks must be positive", value=(seconds, looks))
    plant = Plant(arm, thermal=thermal)
    count = max(round(trajectory.duration / plant.cycle), 2)
    command = trajectory.evaluate(np.arange(count) * plant.cycle).q
    temperature = plant.temperature
    for _ in range(looks):
        plant.temperature = temperature
        plant.reset(command[0])
        for setpoint in command:
            plant.tick(setpoint)
        power = plant.heat / (count * plant.cycle)
        stretch = seconds / looks
        temperature = arm.truth.thermal.after(temperature, power * stretch, stretch)
    return temperature
