"""A simulated arm with known parameters, to test identification against."""

from dynid.simulation.friction import Thermal
from dynid.simulation.library import SERIAL, simulated_arm
from dynid.simulation.plant import (
    Plant,
    SimulatedRun,
    simulate,
    warm_up,
)
from dynid.simulation.servo import PlantState, Servo, Target
from dynid.simulation.truth import SimulatedArm, with_payload

__all__ = [
    "SERIAL",
    "Plant",
    "PlantState",
    "Servo",
    "SimulatedArm",
    "SimulatedRun",
    "Target",
    "Thermal",
    "simulate",
    "simulated_arm",
    "warm_up",
    "with_payload",
]
