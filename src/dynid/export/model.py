"""What every exported file holds: bodies in their joint frames, and joint friction by its terms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError, JobError
from dynid.export.completion import Completion, complete
from dynid.identification.estimate import Estimate
from dynid.regressor.coupling import coupled_motors
from dynid.robot.counterbalance import Counterbalance
from dynid.robot.inertia import move
from dynid.robot.model import RobotModel

JOINT_SYMBOLS = ("Fc", "Fv", "Im", "Fo", "Fca", "Fva", "Fs", "Fr")
"""Terms of one joint: Coulomb, viscous, motor inertia, offset, asymmetries, Stribeck, cube root."""
MOTOR_SYMBOLS = ("Fcm", "Fvm", "Imm")
"""Terms of a motor that drives several joints: Coulomb, viscous, inertia."""

BEYOND = {"Fl": "friction that grows with load", "Fw": "torque ripple of gears"}
"""Terms that depend on more than their joint's velocity and acceleration, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportModel:
    """A robot with numbers for everything its inverse dynamics need.

    tau = M(q) ddq + c(q, dq) + g(q) + friction(dq), M with the motor inertias, g with the known
    torques of counterbalances.

    Raises:
        InputError: Arrays that do not fit the robot, or terms that no file can hold.
    """

    robot: RobotModel
    """Kinematics, mounting, limits; its own inertias are not used."""
    inertials: Array
    """(n, 10) parameters of each link about its joint frame, the paper's order."""
    terms: Mapping[str, Array]
    """Symbol to (n) coefficients, zero where a joint or motor does not have the term."""
    width: Array
    """(n) width of the Coulomb step tanh(dq / width) [rad/s or m/s]; 0 for the sign."""
    stribeck_velocity: float
    """[rad/s or m/s]"""
    shares: Array
    """(k, n) turns of each coupled motor per turn of the joints; k = 0 without coupling."""
    motors: tuple[int, ...] = ()
    """(k) which motors these are, from 0."""
    physical: bool = True
    """Whether every link is a body that can exist and no motor inertia is negative."""
    worst: str = ""
    """The links and motors that cannot exist, in words; empty if all can."""
    origin: str = ""
    """How the standard parameters were found, in words."""
    beyond: tuple[str, ...] = ()
    """What was identified and no file can hold, in words."""

    def __post_init__(self) -> None:
        n = self.robot.joints
        for name, shape in (
            ("inertials", (n, 10)),
            ("width", (n,)),
            ("shares", (len(self.motors), n)),
        ):
            value = frozen(getattr(self, name), shape=shape, name=name)
            object.__setattr__(self, name, value)
        unknown = sorted(set(self.terms) - {*JOINT_SYMBOLS, *MOTOR_SYMBOLS})
        if unknown:
            raise InputError(
                "friction terms that no file can hold",
                value=", ".join(unknown),
                limit=", ".join((*JOINT_SYMBOLS, *MOTOR_SYMBOLS)),
                next_step="Identify again with --terms fc,fv,im, or other terms of one joint.",
            )
        terms = {
            symbol: frozen(self.terms.get(symbol, np.zeros(n)), shape=(n,), name=symbol)
            for symbol in (*JOINT_SYMBOLS, *MOTOR_SYMBOLS)
        }
        object.__setattr__(self, "terms", MappingProxyType(terms))

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.robot.joints

    @property
    def springs(self) -> tuple[Counterbalance, ...]:
        """Counterbalances."""
        return self.robot.counterbalances


def export_model(estimate: Estimate) -> ExportModel:
    """The model of an estimate, completed to standard parameters; see `completed_model`."""
    return completed_model(estimate)[0]


def completed_model(estimate: Estimate, *, partial: bool = False) -> tuple[ExportModel, Completion]:
    """The model of an estimate, and the standard parameters that it was completed to.

    Args:
        estimate: The estimate. Physically consistent ones carry their standard parameters;
            others are completed by the bodies nearest to the prior with the same torques.
        partial: Leave out the terms that no file can hold, and say so in `beyond`.

    Raises:
        JobError: The model has terms that no file can hold, such as friction that grows with load.
    """
    model, robot = estimate.model, estimate.model.robot
    found = complete(estimate)
    n, values = robot.joints, found.values
    frames = robot.parameter_frames[model.frames]
    terms: dict[str, Array] = {}
    beyond: dict[str, None] = {}
    for column, value in zip(model.columns[10 * n :], values[10 * n :], strict=True):
        symbol = column.name.rstrip("0123456789")
        if partial and symbol not in (*JOINT_SYMBOLS, *MOTOR_SYMBOLS):
            beyond.setdefault(BEYOND.get(symbol, symbol))
            continue
        terms.setdefault(symbol, np.zeros(n))[column.joint] = value
    width = model.friction.width
    motors = coupled_motors(robot)
    ratios = robot.drives.motor_from_joint
    try:
        whole = ExportModel(
            robot=robot,
            inertials=np.array(
                [
                    move(own, frame)
                    for own, frame in zip(values[: 10 * n].reshape(n, 10), frames, strict=True)
                ]
            ),
            terms=terms,
            width=np.broadcast_to(np.asarray(width, dtype=np.float64), (n,)),
            stribeck_velocity=model.friction.stribeck_velocity,
            shares=np.array([ratios[m] / ratios[m, m] for m in motors]).reshape(-1, n),
            motors=motors,
            physical=found.physical,
            worst=found.worst,
            origin=found.origin,
            beyond=tuple(beyond),
        )
    except InputError as error:
        raise JobError(
            error.what, value=error.value, limit=error.limit, next_step=error.next_step
        ) from error
    return whole, found
