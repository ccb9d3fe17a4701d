"""Simulated arms: the UR5, any robot with known inertias, their thermal states and their truth.

The parameters of links are computed by a few lines of its own: the simulated arm must not borrow
the model that it is there to test.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, RobotError, check_word, freeze, frozen, read_only
from dynid.robot import RobotModel, load_robot
from dynid.simulation import joints

_TENSOR = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""Entries Jxx, Jyy, Jzz, Jyz, Jxz, Jxy."""


def link_parameters(mass: float, com: Array, tensor: Array) -> Array:
    """(10) m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy about the frame origin.

    Args:
        mass: Mass [kg].
        com: (3) centre of mass in the frame [m].
        tensor: (3, 3) inertia about the centre of mass, along the frame's axes [kg.m^2].
    """
    about_origin = tensor + mass * _steiner(com)
    return np.concatenate(
        [[mass], mass * com, [about_origin[row, column] for row, column in _TENSOR]]
    )


def link_body(parameters: Array) -> tuple[float, Array, Array]:
    """Mass [kg], centre of mass (3) [m] and tensor about it (3, 3) [kg.m^2] of parameters (10)."""
    mass = float(parameters[0])
    com = parameters[1:4] / mass
    tensor = np.empty((3, 3))
    for (row, column), value in zip(_TENSOR, parameters[4:], strict=True):
        tensor[row, column] = tensor[column, row] = value
    return mass, com, tensor - mass * _steiner(com)


def in_parent_frame(parameters: Array, placement: Array) -> Array:
    """The ten parameters (10) of the same body, about the parent frame.

    The inner frame stands at `placement` (4, 4) in the parent frame [m].
    """
    mass, com, tensor = link_body(parameters)
    rotation, origin = placement[:3, :3], placement[:3, 3]
    return link_parameters(mass, rotation @ com + origin, rotation @ tensor @ rotation.T)


def cylinder(mass: float, radius: float, length: float, axis: int) -> Array:
    """(3, 3) the tensor of a solid cylinder about its middle [kg.m^2], in kg and m.

    The axis, 0, 1 or 2, is the frame axis along the cylinder.
    """
    diagonal = np.full(3, mass * (3 * radius**2 + length**2) / 12)
    diagonal[axis] = mass * radius**2 / 2
    return np.diag(diagonal)


def _steiner(com: Array) -> Array:
    return (com @ com) * np.eye(3) - np.outer(com, com)


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundTruth:
    """What the simulated arm is made of.

    Raises:
        InputError: Shapes that disagree, a mass that is not positive, a negative motor inertia
            or a gain of zero.
    """

    inertials: Array
    """(n, 10) m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy about the joint frame
    [kg, kg.m, kg.m^2]."""
    motor_inertia: Array
    """(n) Im, rotor inertia times gear ratio squared [kg.m^2]."""
    friction: joints.JointFriction
    """Friction."""
    thermal: joints.JointThermal
    """Warming up."""
    sensors: joints.JointSensors
    """Noise and resolution."""
    gain: Array
    """(n) joint torque per motor current [N.m/A]."""
    label: str
    """Whose numbers these are, in words."""

    def __post_init__(self) -> None:
        n = np.size(self.motor_inertia)
        freeze(self, inertials=(n, 10), motor_inertia=(n,), gain=(n,))
        masses = self.inertials[:, 0]
        if (masses <= 0).any() or (self.motor_inertia < 0).any() or (self.gain == 0).any():
            raise InputError(
                "masses must be positive, motor inertias not negative and gains not zero",
                value=(masses.tolist(), self.motor_inertia.tolist(), self.gain.tolist()),
            )
        parts = (self.friction.coulomb, self.thermal.resistance, self.sensors.position_noise)
        if any(len(part) != n for part in parts):
            raise InputError(
                "parts of the truth are for another number of joints",
                value=[len(part) for part in parts],
                limit=n,
            )

    @property
    def standard_parameters(self) -> Array:
        """(n, 13) the ten `inertials`, then Fc, Fv at the reference temperature, and Im.

        With a friction law richer than Fc and Fv, these two are the Coulomb torque without load
        and the viscous slope: what is identified from data differs by what they leave out.
        """
        return self.standard_parameters_at(self.friction.reference_degC)

    def standard_parameters_at(self, temperature_degC: float | Array) -> Array:
        """(n, 13) as `standard_parameters`, with Fc and Fv at one temperature or (n) [degC]."""
        n = len(self.motor_inertia)
        temperature = np.broadcast_to(np.asarray(temperature_degC, dtype=np.float64), (n,))
        return read_only(
            np.column_stack(
                [
                    self.inertials,
                    self.friction.coulomb_at(temperature),
                    self.friction.viscous_at(temperature),
                    self.motor_inertia,
                ]
            )
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedArm:
    """A robot, its truth, and the servo that moves it.

    Raises:
        InputError: Parts for another number of joints, or a coupled transmission.
    """

    robot: RobotModel
    """Kinematics, mounting and limits."""
    truth: GroundTruth
    """Everything else."""
    controller: joints.ControllerModel
    """What the controller believes of the arm."""
    servo: joints.Servo = field(default_factory=joints.Servo)
    """How set points become torques."""

    def __post_init__(self) -> None:
        n = self.robot.joints
        sizes = (len(self.truth.motor_inertia), len(self.controller.masses))
        if sizes != (n, n):
            raise InputError(
                "truth and controller model", where=self.robot.name, value=sizes, limit=n
            )
        coupling = self.robot.drives.coupling
        if coupling is not None and np.any(coupling != np.diag(np.diag(coupling))):
            raise InputError(
                "the simulated arm has one motor a joint; this robot's joints are coupled",
                where=self.robot.name,
            )

    @property
    def made_up_gains(self) -> tuple[float, ...] | None:
        """(n) drive gains that only its recordings can tell [N.m/A]; None where the robot does."""
        unknown = np.isnan(self.robot.drives.gain).any()
        return tuple(self.truth.gain.tolist()) if unknown else None

    def standard_parameters_in(self, frames: str) -> Array:
        """(n, 13) `truth.standard_parameters` about frames of `robot.parameter_frames`.

        Raises:
            InputError: The robot has no such frames.
        """
        check_word(frames, self.robot.parameter_frames, "frames")
        parameters = self.truth.standard_parameters.copy()
        joints_in_frames = np.linalg.inv(self.robot.parameter_frames[frames])
        for i in range(self.robot.joints):
            parameters[i, :10] = in_parent_frame(parameters[i, :10], joints_in_frames[i])
        return read_only(parameters)


def point_masses(inertials: Array, coulomb: Array, viscous: Array) -> joints.ControllerModel:
    """A controller model with the masses and centres of links (n, 10), and no tensors.

    It compensates dry friction (n) [N.m] and viscous friction (n) [N.m.s/rad].
    """
    bodies = [link_body(row) for row in inertials]
    return joints.ControllerModel(
        masses=np.array([mass for mass, _, _ in bodies]),
        com=np.array([com for _, com, _ in bodies]),
        coulomb=coulomb,
        viscous=viscous,
    )


def with_payload(
    arm: SimulatedArm, mass: float, centre: ArrayLike, tensor: ArrayLike
) -> SimulatedArm:
    """The arm with a body fixed to its flange; its controller does not know of it.

    Args:
        arm: The arm.
        mass: Mass [kg], positive.
        centre: (3) centre of mass in the flange frame [m].
        tensor: (3, 3) inertia about the centre of mass, along the flange's axes [kg.m^2].

    Raises:
        InputError: A mass that is not positive, or shapes that are wrong.
    """
    if not mass > 0:
        raise InputError("a payload needs a positive mass", value=mass)
    body = link_parameters(
        mass,
        frozen(centre, shape=(3,), name="centre of mass"),
        frozen(tensor, shape=(3, 3), name="inertia tensor"),
    )
    inertials = np.array(arm.truth.inertials)
    inertials[-1] += in_parent_frame(body, arm.robot.flange)
    return replace(arm, truth=replace(arm.truth, inertials=inertials))


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
        thermal=joints.JointThermal(
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
) -> joints.JointFriction:
    n = len(coulomb)
    return joints.JointFriction(
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


def _sensors(noise: Array, step: Array) -> joints.JointSensors:
    """Of currents [A], beside sensors that all arms have."""
    n = len(noise)
    return joints.JointSensors(
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
    """(6) of the joints of size 3, then of those of size 1."""
    return np.repeat([big, small], 3)


_TORQUE_STAND_IN = 50.0
_WATER = 1000.0
_COULOMB_SHARE, _VISCOUS_SHARE = 0.8, 0.9


SERIAL = 1
"""The individual that runs and demonstrations use."""
MASS_SPREAD, CENTRE_SPREAD_M, TENSOR_SPREAD = 0.1, 0.01, 0.3
"""Largest differences of real links from published inertias (share, m, share)."""


def simulated_arm(
    robot: RobotModel, *, servo: joints.Servo | None = None, serial: int | None = None
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
    return SimulatedArm(
        robot=robot, truth=truth, controller=controller, servo=servo or joints.Servo()
    )


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
        thermal=joints.JointThermal(
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
