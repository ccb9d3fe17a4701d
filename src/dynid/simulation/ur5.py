"""The truth of the simulated UR5.

Masses and centres of mass are UR's ("DH Parameters for calculations of kinematics and dynamics",
the same numbers as UR's ROS 2 description, `config/ur5/physical_parameters.yaml`). Everything
else is THE SIMULATED ARM'S OWN, NOT UR'S: UR publishes no inertia tensors, rotor inertias,
friction or heat data for this arm. The values are chosen so that a run looks like a real one:

- tensors: a solid cylinder about each published centre of mass;
- drive gains: those of the robot (`RobotModel.drives`), or the paper's where it has none;
- Coulomb and viscous friction: near a fit of real UR5 logs (Fc 7.7, 8.4, 8.3, 1.9, 1.8, 1.8
  N.m; Fv 10.8, 8.8, 5.5, 2.8, 1.9, 1.4 N.m.s/rad with 10.7 and 10.2 N.m/A), rescaled to the
  paper's gains;
- temperature: viscous friction falls by 20 to 35 % over the warm-up that the paper reports
  (about 22 to 34 degC), Coulomb friction hardly changes;
- resolution: the steps seen in real CB3 recordings (5e-6 rad, 2.24 and 1.52 mA).
"""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import RobotError
from dynid.robot.model import RobotModel
from dynid.simulation.friction import JointFriction
from dynid.simulation.inertia import cylinder, in_parent_frame, link_parameters
from dynid.simulation.sensors import JointSensors
from dynid.simulation.thermal import JointThermal
from dynid.simulation.truth import GroundTruth

LABEL = "masses and centres of mass by UR; all else is the simulated arm's own, not UR's numbers"

PUBLISHED_MASSES = (3.7, 8.393, 2.33, 1.219, 1.219, 0.1879)
"""UR's masses [kg]."""
PUBLISHED_COM = (
    (0.0, -0.02561, 0.00193),
    (0.2125, 0.0, 0.11336),
    (0.15, 0.0, 0.0265),
    (0.0, -0.0018, 0.01634),
    (0.0, 0.0018, 0.01634),
    (0.0, 0.0, -0.001159),
)
"""UR's centres of mass in the DH link frames [m]."""

_CYLINDERS = (
    (0.060, 0.178, 1),
    (0.054, 0.425, 0),
    (0.048, 0.392, 0),
    (0.0375, 0.12, 1),
    (0.0375, 0.12, 1),
    (0.0375, 0.0345, 2),
)
"""Radius [m], length [m] and axis of the cylinder of each link, in its DH frame."""
_MOTOR_INERTIA = (1.10, 1.06, 0.98, 0.17, 0.16, 0.15)
_COULOMB = (9.8, 10.7, 10.5, 1.7, 1.6, 1.6)
_VISCOUS = (13.7, 11.2, 7.0, 2.5, 1.7, 1.3)
_VISCOUS_DECAY = (0.036, 0.034, 0.032, 0.028, 0.026, 0.025)
_PAPER_GAIN = (13.64, 13.75, 13.69, 9.67, 8.74, 9.02)
_BIG, _SMALL = 3, 3  # joints of size 3 and of size 1


def ur5_truth(robot: RobotModel) -> GroundTruth:
    """The documented truth of the simulated UR5.

    Args:
        robot: The UR5, with its `dh` parameter frames.

    Raises:
        RobotError: Another number of joints, or no `dh` frames.
    """
    if robot.joints != 6 or "dh" not in robot.parameter_frames:
        raise RobotError("the simulated UR5 needs six joints and dh frames", where=robot.name)
    gain = np.where(np.isnan(robot.drives.gain), _PAPER_GAIN, robot.drives.gain)
    coulomb, viscous = np.array(_COULOMB), np.array(_VISCOUS)
    return GroundTruth(
        inertials=_inertials(robot.parameter_frames["dh"]),
        motor_inertia=np.array(_MOTOR_INERTIA),
        friction=JointFriction(
            coulomb=coulomb,
            viscous=viscous,
            breakaway=0.15 * coulomb,
            stribeck_velocity=np.full(6, 0.06),
            load_factor=_each(0.02, 0.03),
            stiffness=_each(4.0e4, 5.0e3),
            damping=_each(20.0, 2.0),
            viscous_decay=np.array(_VISCOUS_DECAY),
            coulomb_drift=np.full(6, 0.002),
            reference_degC=24.0,
        ),
        thermal=JointThermal(
            resistance=np.array([0.52, 0.42, 0.68, 2.9, 3.3, 4.2]),
            capacity=np.array([1900.0, 2300.0, 1400.0, 340.0, 300.0, 240.0]),
            winding=_each(0.35, 0.9),
            warm_degC=np.full(6, 34.0),
            ambient_degC=24.0,
        ),
        sensors=JointSensors(
            position_noise=np.zeros(6),
            position_step=np.full(6, 5e-6),
            velocity_noise=np.full(6, 1e-3),
            velocity_step=np.zeros(6),
            current_noise=_each(0.02, 0.01),
            current_step=_each(0.00224, 0.00152),
            temperature_noise=np.full(6, 0.05),
            temperature_step=np.full(6, 0.01),
        ),
        gain=gain,
        label=LABEL,
    )


def _inertials(frames: Array) -> Array:
    rows: list[Array] = []
    for mass, com, shape, frame in zip(
        PUBLISHED_MASSES, PUBLISHED_COM, _CYLINDERS, frames, strict=True
    ):
        radius, length, axis = shape
        link = link_parameters(mass, np.array(com), cylinder(mass, radius, length, axis))
        rows.append(in_parent_frame(link, frame))
    return np.array(rows)


def _each(big: float, small: float) -> Array:
    return np.array([big] * _BIG + [small] * _SMALL)
