"""The truth of a simulated arm: every number that identification has to find.

The parameters of links are computed by a few lines of its own: the simulated arm must not borrow
the model that it is there to test.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, check_word, freeze, frozen, read_only
from dynid.robot import RobotModel
from dynid.simulation.joints import (
    ControllerModel,
    JointFriction,
    JointSensors,
    JointThermal,
    Servo,
)

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
    friction: JointFriction
    """Friction."""
    thermal: JointThermal
    """Warming up."""
    sensors: JointSensors
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
    controller: ControllerModel
    """What the controller believes of the arm."""
    servo: Servo = field(default_factory=Servo)
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


def point_masses(inertials: Array, coulomb: Array, viscous: Array) -> ControllerModel:
    """A controller model with the masses and centres of links (n, 10), and no tensors.

    It compensates dry friction (n) [N.m] and viscous friction (n) [N.m.s/rad].
    """
    bodies = [link_body(row) for row in inertials]
    return ControllerModel(
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
