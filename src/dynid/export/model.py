"""What every exported file holds: bodies in their joint frames, and joint friction by its terms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.export.completion import Completion, complete
from dynid.identification.estimate import Estimate
from dynid.regressor.coupling import coupled_motors
from dynid.regressor.ripple import TorqueRipple
from dynid.robot.counterbalance import Counterbalance
from dynid.robot.inertia import move
from dynid.robot.model import RobotModel

JOINT_SYMBOLS = ("Fc", "Fv", "Im", "Fo", "Fca", "Fva", "Fs", "Fr")
"""Terms of one joint: Coulomb, viscous, motor inertia, offset, asymmetries, Stribeck, cube root."""
MOTOR_SYMBOLS = ("Fcm", "Fvm", "Imm")
"""Terms of a motor that drives several joints: Coulomb, viscous, inertia."""
SHAPED_SYMBOLS = ("Fl", "Fw")
"""Terms of one joint whose shape was identified too: friction by load, torque ripple."""
SYMBOLS = (*JOINT_SYMBOLS, *MOTOR_SYMBOLS, *SHAPED_SYMBOLS)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportModel:
    """A robot with numbers for everything its inverse dynamics need.

    tau = M(q) ddq + c(q, dq) + g(q) + friction, M with the motor inertias, g with the known
    torques of counterbalances. Friction depends on dq; that of load on q and ddq too, and ripple
    on q.

    Raises:
        InputError: Arrays that do not fit the robot, terms that no file can hold, or friction by
            load or ripple without its shape.
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
    load: Array | None = None
    """(n, 10) parameters about the joint frames of the bodies whose torque, less that of the
    counterbalances, is the load that `Fl` multiplies; bodies that need not be able to exist."""
    ripples: tuple[TorqueRipple, ...] = ()
    """The torques that `Fw` multiplies, each joint once."""
    physical: bool = True
    """Whether every link is a body that can exist and no motor inertia is negative."""
    worst: str = ""
    """The links and motors that cannot exist, in words; empty if all can."""
    origin: str = ""
    """How the standard parameters were found, in words."""

    def __post_init__(self) -> None:
        n = self.robot.joints
        for name, shape in (
            ("inertials", (n, 10)),
            ("width", (n,)),
            ("shares", (len(self.motors), n)),
        ):
            value = frozen(getattr(self, name), shape=shape, name=name)
            object.__setattr__(self, name, value)
        if self.load is not None:
            object.__setattr__(self, "load", frozen(self.load, shape=(n, 10), name="load"))
        unknown = sorted(set(self.terms) - set(SYMBOLS))
        if unknown:
            raise InputError(
                "friction terms that no file can hold",
                value=", ".join(unknown),
                limit=", ".join(SYMBOLS),
                next_step="Identify again with --terms fc,fv,im, or other terms of one joint.",
            )
        terms = {
            symbol: frozen(self.terms.get(symbol, np.zeros(n)), shape=(n,), name=symbol)
            for symbol in SYMBOLS
        }
        object.__setattr__(self, "terms", MappingProxyType(terms))
        self._check_shapes()

    def _check_shapes(self) -> None:
        if self.load is None and self.terms["Fl"].any():
            raise InputError("friction that grows with load needs the load's bodies", where="Fl")
        named = [ripple.joint for ripple in self.ripples]
        moved = [gear.joint for ripple in self.ripples for gear in ripple.gears]
        bare = set(np.flatnonzero(self.terms["Fw"]).tolist()) - set(named)
        if bare or len(set(named)) < len(named) or max([*named, *moved], default=0) >= self.joints:
            raise InputError(
                "torque ripple needs its waves, each joint once", where="Fw", value=named
            )

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.robot.joints

    @property
    def speed_alone(self) -> bool:
        """Whether friction depends on nothing but speed: no friction by load, no ripple."""
        return not any(self.terms[symbol].any() for symbol in SHAPED_SYMBOLS)

    @property
    def springs(self) -> tuple[Counterbalance, ...]:
        """Counterbalances."""
        return self.robot.counterbalances


def export_model(estimate: Estimate) -> ExportModel:
    """The model of an estimate, completed to standard parameters; see `completed_model`."""
    return completed_model(estimate)[0]


def completed_model(estimate: Estimate) -> tuple[ExportModel, Completion]:
    """The model of an estimate, and the standard parameters that it was completed to.

    Args:
        estimate: The estimate. Physically consistent ones carry their standard parameters;
            others are completed by the bodies nearest to the prior with the same torques.
    """
    model, robot = estimate.model, estimate.model.robot
    found = complete(estimate)
    n, values = robot.joints, found.values
    frames = robot.parameter_frames[model.frames]
    terms: dict[str, Array] = {}
    for column, value in zip(model.columns[10 * n :], values[10 * n :], strict=True):
        symbol = column.name.rstrip("0123456789")
        terms.setdefault(symbol, np.zeros(n))[column.joint] = value
    friction = model.friction
    width = friction.width
    motors = coupled_motors(robot)
    ratios = robot.drives.motor_from_joint
    whole = ExportModel(
        robot=robot,
        inertials=_about_joints(values[: 10 * n], frames),
        terms=terms,
        width=np.broadcast_to(np.asarray(width, dtype=np.float64), (n,)),
        stribeck_velocity=friction.stribeck_velocity,
        shares=np.array([ratios[m] / ratios[m, m] for m in motors]).reshape(-1, n),
        motors=motors,
        load=None
        if friction.load is None
        else _about_joints(np.array(friction.load.parameters), frames),
        ripples=friction.ripples,
        physical=found.physical,
        worst=found.worst,
        origin=found.origin,
    )
    return whole, found


def _about_joints(parameters: Array, frames: Array) -> Array:
    """(n, 10) from parameters (10 n) about the parameter frames, which are in the joint frames."""
    rows = parameters.reshape(-1, 10)
    return np.array([move(own, frame) for own, frame in zip(rows, frames, strict=True)])
