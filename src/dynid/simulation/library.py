"""Simulated arms: the UR5, any robot with known inertias, and ideal ones for tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.robot.model import RobotModel
from dynid.simulation.friction import JointFriction, ideal_friction
from dynid.simulation.inertia import link_parameters
from dynid.simulation.sensors import JointSensors, perfect_sensors
from dynid.simulation.servo import Servo
from dynid.simulation.thermal import JointThermal, constant_temperature
from dynid.simulation.truth import GroundTruth, SimulatedArm, point_masses
from dynid.simulation.ur5 import ur5_truth

_TORQUE_STAND_IN = 50.0
_WATER = 1000.0
_COULOMB_SHARE, _VISCOUS_SHARE = 0.8, 0.9


def simulated_arm(robot: RobotModel, *, servo: Servo | None = None) -> SimulatedArm:
    """The simulated arm of a robot: realistic, with a truth that can be looked up.

    The UR5 has its documented truth (`ur5_truth`). Any other robot needs masses and centres of
    mass; what else is unknown is made up (`stand_in_truth`).

    Args:
        robot: The robot, mounted as it stands.
        servo: The servo; the default follows `servoj` with lookahead 0.03 s and gain 500.

    Raises:
        InputError: A robot other than the UR5 with unknown masses, or coupled joints.
    """
    # A URDF that calls itself ur5 brings its own inertias, and no DH frames.
    documented = robot.name == "ur5" and robot.joints == 6 and "dh" in robot.parameter_frames
    truth = ur5_truth(robot) if documented else stand_in_truth(robot)
    # A controller compensates most of the friction, not all: UR's own default shares.
    controller = point_masses(
        truth.inertials,
        _COULOMB_SHARE * truth.friction.coulomb,
        _VISCOUS_SHARE * truth.friction.viscous,
    )
    return SimulatedArm(robot=robot, truth=truth, controller=controller, servo=servo or Servo())


def stand_in_truth(robot: RobotModel) -> GroundTruth:
    """A made-up truth around the robot's own masses and inertias.

    With the torque limit tau of a joint (50 N.m where unknown): Fc = 0.06 tau, Fv = 0.06 tau
    s/rad, Im = 0.006 tau s^2, the proportions of the simulated UR5. A link without a published
    tensor is a ball of the density of water. Joints without a drive gain take 1 N.m/A, so their
    current reads as torque.

    Raises:
        InputError: An unknown mass or centre of mass.
    """
    torque = np.where(np.isnan(robot.limits.torque), _TORQUE_STAND_IN, robot.limits.torque)
    gain = np.where(np.isnan(robot.drives.gain), 1.0, robot.drives.gain)
    coulomb, n = 0.06 * torque, robot.joints
    rated_current = torque / np.abs(gain)
    return GroundTruth(
        inertials=_completed(robot),
        motor_inertia=0.006 * torque,
        friction=JointFriction(
            coulomb=coulomb,
            viscous=coulomb,
            breakaway=0.15 * coulomb,
            stribeck_velocity=np.full(n, 0.06),
            load_factor=np.full(n, 0.02),
            stiffness=4000.0 * coulomb,
            damping=2.0 * coulomb,
            viscous_decay=np.full(n, 0.03),
            coulomb_drift=np.full(n, 0.002),
        ),
        thermal=JointThermal(
            resistance=75.0 / torque,
            capacity=12.0 * torque,
            winding=0.28 * torque / rated_current**2,
            warm_degC=np.full(n, 34.0),
        ),
        sensors=JointSensors(
            position_noise=np.zeros(n),
            position_step=np.full(n, 5e-6),
            velocity_noise=np.full(n, 1e-3),
            velocity_step=np.zeros(n),
            current_noise=0.002 * rated_current,
            current_step=0.0002 * rated_current,
            temperature_noise=np.full(n, 0.05),
            temperature_step=np.full(n, 0.01),
        ),
        gain=gain,
        label="published inertias of the robot; all else is made up in proportion to torque limits",
    )


def _completed(robot: RobotModel) -> Array:
    """(n, 10) the inertial parameters, a ball where the tensor is unknown."""
    rows = robot.inertias.copy()
    for i, row in enumerate(rows):
        if not np.isfinite(row[:4]).all() or row[0] <= 0:
            raise InputError(
                f"link {i + 1} has no known mass, so the arm cannot be simulated",
                where=robot.name,
                next_step="Give mass and centre of mass of every link in the robot file.",
            )
        if not np.isfinite(row).all():
            mass = float(row[0])
            radius = (3.0 * mass / (4.0 * np.pi * _WATER)) ** (1.0 / 3.0)
            rows[i] = link_parameters(mass, row[1:4] / mass, 0.4 * mass * radius**2 * np.eye(3))
    return rows


def ideal_arm(
    robot: RobotModel,
    parameters: ArrayLike,
    *,
    friction_width: float = 1e-3,
    gain: ArrayLike | None = None,
    sensors: JointSensors | None = None,
    servo: Servo | None = None,
) -> SimulatedArm:
    """An arm that obeys the identified model exactly, so that its parameters can be recovered.

    Friction is Fc tanh(dq / width) + Fv dq, temperatures stay, and sensors are perfect unless
    others are given (`chosen_sensors`).

    Args:
        robot: The robot, mounted as it stands.
        parameters: (n, 13) the ten inertial parameters about the joint frames, Fc, Fv, Im
            [SI units].
        friction_width: Speed over which the dry friction changes sign [rad/s].
        gain: (n) joint torque per motor current [N.m/A]; the robot's, or one, if not given.
        sensors: Noise and resolution.
        servo: The servo.

    Raises:
        InputError: Shapes that disagree, masses, friction or motor inertias that cannot be.
    """
    n = robot.joints
    rows = frozen(parameters, shape=(n, 13), name="standard parameters")
    own_gain = np.where(np.isnan(robot.drives.gain), 1.0, robot.drives.gain)
    truth = GroundTruth(
        inertials=rows[:, :10],
        motor_inertia=rows[:, 12],
        friction=ideal_friction(rows[:, 10], rows[:, 11], friction_width),
        thermal=constant_temperature(n),
        sensors=sensors or perfect_sensors(n),
        gain=own_gain if gain is None else frozen(gain, shape=(n,), name="gain"),
        label="ideal: exactly the model that is identified",
    )
    controller = point_masses(
        truth.inertials, _COULOMB_SHARE * rows[:, 10], _VISCOUS_SHARE * rows[:, 11]
    )
    return SimulatedArm(robot=robot, truth=truth, controller=controller, servo=servo or Servo())
