"""A simulated arm with known parameters, to test identification against."""

from dynid.simulation.controller.process import controller_process
from dynid.simulation.controller.serve import ControllerOptions, serve
from dynid.simulation.friction import Thermal
from dynid.simulation.library import simulated_arm
from dynid.simulation.plant import (
    Plant,
    SimulatedRun,
    simulate,
    warm_up,
)
from dynid.simulation.servo import PlantState
from dynid.simulation.truth import SimulatedArm, with_payload

__all__ = [
    "ControllerOptions",
    "Plant",
    "PlantState",
    "SimulatedArm",
    "SimulatedRun",
    "Thermal",
    "controller_process",
    "serve",
    "simulate",
    "simulated_arm",
    "warm_up",
    "with_payload",
]
