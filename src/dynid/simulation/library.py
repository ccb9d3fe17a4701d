"""Simulated arms: the UR5, any robot with known inertias, and their thermal states."""

from dataclasses import replace

import numpy as np

from dynid.core import Array, InputError, RobotError, read_only
from dynid.robot import RobotModel, load_robot
from dynid.simulation.joints import JointFriction, JointSensors, JointThermal, Servo
from dynid.simulation.truth import (
    GroundTruth,
    SimulatedArm,
    cylinder,
    in_parent_frame,
    link_body,
    link_parameters,
    point_masses,
)

LABEL = "masses and centres of mass by UR; all else is the simulated arm's own, not UR's numbers"

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

    Raises:
        RobotError: Another number of joints, or no `dh` frames.
    """
    if robot.joints != 6 or "dh" not in robot.parameter_frames:
        raise RobotError("the simulated UR5 needs six joints and dh frames", where=robot.name)
    gain = np.where(np.isnan(robot.drives.gain), _PAPER_GAIN, robot.drives.gain)
    return GroundTruth(
        inertials=_inertials(robot.parameter_frames["dh"]),
        motor_inertia=np.array(_MOTOR_INERTIA),
        friction=_friction(
            np.array(_COULOMB),
            np.array(_VISCOUS),
            load_factor=_each(0.02, 0.03),
            stiffness=_each(4.0e4, 5.0e3),
            damping=_each(20.0, 2.0),
            viscous_decay=np.array(_VISCOUS_DECAY),
        ),
        thermal=JointThermal(
            resistance=np.array([0.52, 0.42, 0.68, 2.9, 3.3, 4.2]),
            capacity=np.array([1900.0, 2300.0, 1400.0, 340.0, 300.0, 240.0]),
            winding=_each(0.35, 0.9),
            warm_degC=np.full(6, 34.0),
            ambient_degC=24.0,
        ),
        sensors=_sensors(noise=_each(0.02, 0.01), step=_each(0.00224, 0.00152)),
        gain=gain,
        label=LABEL,
    )


def _inertials(frames: Array) -> Array:
    rows: list[Array] = []
    published = load_robot("ur5").inertias
    for own, frame, (radius, length, axis) in zip(published, frames, _CYLINDERS, strict=True):
        mass = float(own[0])
        com: Array = (own[1:4] / mass - frame[:3, 3]) @ frame[:3, :3]
        # As UR gives it: the last digits would turn the axes of cylinders that are built otherwise.
        link = link_parameters(mass, com.round(9), cylinder(mass, radius, length, axis))
        rows.append(in_parent_frame(link, frame))
    return np.array(rows)


def _friction(
    coulomb: Array,
    viscous: Array,
    *,
    load_factor: Array,
    stiffness: Array,
    damping: Array,
    viscous_decay: Array,
) -> JointFriction:
    n = len(coulomb)
    return JointFriction(
        coulomb=coulomb,
        viscous=viscous,
        breakaway=0.15 * coulomb,
        stribeck_velocity=np.full(n, 0.06),
        load_factor=load_factor,
        stiffness=stiffness,
        damping=damping,
        viscous_decay=viscous_decay,
        coulomb_drift=np.full(n, 0.002),
    )


def _sensors(noise: Array, step: Array) -> JointSensors:
    """Of currents [A], beside sensors that all arms have."""
    n = len(noise)
    return JointSensors(
        position_noise=np.zeros(n),
        position_step=np.full(n, 5e-6),
        velocity_noise=np.full(n, 1e-3),
        velocity_step=np.zeros(n),
        current_noise=noise,
        current_step=step,
        temperature_noise=np.full(n, 0.05),
        temperature_step=np.full(n, 0.01),
    )


def _each(big: float, small: float) -> Array:
    return np.array([big] * _BIG + [small] * _SMALL)


_TORQUE_STAND_IN = 50.0
_WATER = 1000.0
_COULOMB_SHARE, _VISCOUS_SHARE = 0.8, 0.9


SERIAL = 1
"""The individual that runs and demonstrations use."""
MASS_SPREAD, CENTRE_SPREAD_M, TENSOR_SPREAD = 0.1, 0.01, 0.3
"""Largest differences of real links from published inertias (share, m, share)."""


def simulated_arm(
    robot: RobotModel, *, servo: Servo | None = None, serial: int | None = None
) -> SimulatedArm:
    """The simulated arm of a robot: realistic, with a truth that can be looked up.

    The UR5 has its documented truth (`ur5_truth`). Any other robot needs masses and centres of
    mass; what else is unknown is made up (`stand_in_truth`).

    Args:
        robot: The robot, mounted as it stands.
        servo: The servo; the default follows `servoj` with lookahead 0.03 s and gain 500.
        serial: Number of the individual: its links differ from the published ones as real ones
            do (`as_built`). None for published inertias exactly.

    Raises:
        InputError: A robot other than the UR5 with unknown masses, or coupled joints.
    """
    truth = ur5_truth(robot) if _is_documented(robot) else stand_in_truth(robot)
    # A controller knows the published masses, and compensates most of the friction, not all: UR's
    # own default shares.
    controller = point_masses(
        truth.inertials,
        _COULOMB_SHARE * truth.friction.coulomb,
        _VISCOUS_SHARE * truth.friction.viscous,
    )
    if serial is not None:
        inertials = as_built(truth.inertials, serial)
        label = f"{truth.label}; links as built, serial number {serial}"
        truth = replace(truth, inertials=inertials, label=label)
    return SimulatedArm(robot=robot, truth=truth, controller=controller, servo=servo or Servo())


def _is_documented(robot: RobotModel) -> bool:
    """Whether it is the UR5: files of others are called so too, with links and frames of theirs."""
    if robot.name != "ur5" or robot.joints != 6 or robot.default_frames != "dh":
        return False
    documented = _inertials(robot.parameter_frames["dh"])[:, :4]
    own = np.where(np.isnan(robot.inertias[:, :4]), documented, robot.inertias[:, :4])
    return np.allclose(own, documented, rtol=0, atol=1e-6)


def as_built(inertials: Array, serial: int) -> Array:
    """(n, 10) links that differ from published ones as those of real arms do.

    Masses by up to 10 %, centres by up to 10 mm along each axis, second moments about the centre
    by up to 30 % along their principal axes, which keeps every body physically consistent. The
    serial number is the seed of the differences.
    """
    draw = np.random.default_rng(serial)
    rows: list[Array] = []
    for row in inertials:
        mass, centre, tensor = link_body(row)
        sizes, axes = np.linalg.eigh(np.trace(tensor) / 2 * np.eye(3) - tensor)
        sizes = np.maximum(sizes, 0.0) * (1 + draw.uniform(-TENSOR_SPREAD, TENSOR_SPREAD, 3))
        mass *= 1 + draw.uniform(-MASS_SPREAD, MASS_SPREAD)
        centre = centre + draw.uniform(-CENTRE_SPREAD_M, CENTRE_SPREAD_M, 3)
        tensor = axes * (sizes.sum() - sizes) @ axes.T
        rows.append(link_parameters(mass, centre, tensor))
    return read_only(np.array(rows))


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
        friction=_friction(
            coulomb,
            coulomb,
            load_factor=np.full(n, 0.02),
            stiffness=4000.0 * coulomb,
            damping=2.0 * coulomb,
            viscous_decay=np.full(n, 0.03),
        ),
        thermal=JointThermal(
            resistance=75.0 / torque,
            capacity=12.0 * torque,
            winding=0.28 * torque / rated_current**2,
            warm_degC=np.full(n, 34.0),
        ),
        sensors=_sensors(noise=0.002 * rated_current, step=0.0002 * rated_current),
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
