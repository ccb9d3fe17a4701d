"""A simulated arm with known parameters, to test identification against."""

from dynid.simulation.joints import (
    JointFriction,
    JointSensors,
    JointThermal,
    PlantState,
    Servo,
    Target,
    Thermal,
)
from dynid.simulation.kernel import mujoco_model
from dynid.simulation.library import SERIAL, simulated_arm, ur5_truth
from dynid.simulation.plant import (
    SimulatedPlant,
    SimulatedRun,
    recorded,
    simulate,
    stacked,
    warm_up,
)
from dynid.simulation.truth import (
    GroundTruth,
    SimulatedArm,
    cylinder,
    link_body,
    link_parameters,
    point_masses,
    with_payload,
)

__all__ = [
    "SERIAL",
    "GroundTruth",
    "JointFriction",
    "JointSensors",
    "JointThermal",
    "PlantState",
    "Servo",
    "SimulatedArm",
    "SimulatedPlant",
    "SimulatedRun",
    "Target",
    "Thermal",
    "cylinder",
    "link_body",
    "link_parameters",
    "mujoco_model",
    "point_masses",
    "recorded",
    "simulate",
    "simulated_arm",
    "stacked",
    "ur5_truth",
    "warm_up",
    "with_payload",
]
