"""What every exported file holds: bodies in their joint frames, and joint friction by its terms.

For files with a place for Coulomb and viscous friction alone: where other terms were identified
too, those two would be too small, or negative; what grows with load or falls with speed is missing
from them. Then the two that come nearest to all friction over the recorded range stand in for it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from dynid.core import Array, InputError, Value, freeze, frozen, scipy_part
from dynid.export.completion import Completion, complete
from dynid.identification import Estimate
from dynid.regressor import InverseDynamicModel, TorqueRipple, coupled_motors, motor_turns
from dynid.robot import RobotModel, move

JOINT_SYMBOLS = ("Fc", "Fv", "Im", "Fo", "Fca", "Fva", "Fs", "Fr")
"""Terms of one joint: Coulomb, viscous, motor inertia, offset, asymmetries, Stribeck, cube root."""
MOTOR_SYMBOLS = ("Fcm", "Fvm", "Imm")
"""Terms of a motor that drives several joints: Coulomb, viscous, inertia."""
SHAPED_SYMBOLS = ("Fl", "Fw")
"""Terms of one joint whose shape was identified too: friction by load, torque ripple."""
SYMBOLS = (*JOINT_SYMBOLS, *MOTOR_SYMBOLS, *SHAPED_SYMBOLS)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportModel(Value):
    """A robot with numbers for everything its inverse dynamics need.

    tau = M(q) ddq + c(q, dq) + g(q) + friction, M with the motor inertias, g with the known
    torques of counterbalances. Friction depends on dq; that of load on q and ddq too, and ripple
    on q.

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
    stribeck_velocity: Array
    """(n) [rad/s or m/s]"""
    shares: Array
    """(k, n) turns of each coupled motor per turn of the joints; k = 0 without coupling."""
    motors: tuple[int, ...] = ()
    """(k) which motors these are, from 0."""
    load: Array | None = None
    """(n, 10) parameters about the joint frames of the bodies whose torque, less that of the
    counterbalances, is the load that `Fl` multiplies; bodies that need not be able to exist."""
    ripples: tuple[TorqueRipple, ...] = ()
    """The torques that `Fw` multiplies, each joint once."""
    presliding: Array | None = None
    """(n) displacements over which friction builds up after a reversal [rad or m]; 0 for joints
    without. Coulomb, Stribeck and load friction and that of coupled motors have it."""
    physical: bool = True
    """Whether every link is physically consistent and no motor inertia is negative."""
    worst: str = ""
    """The links and motors that are not physically consistent, in words; empty if all are."""
    origin: str = ""
    """How the standard parameters were found, in words."""

    def __post_init__(self) -> None:
        n = self.robot.joints
        freeze(self, inertials=(n, 10), width=(n,), shares=(len(self.motors), n))
        if self.load is not None:
            freeze(self, load=(n, 10))
        if self.presliding is not None:
            freeze(self, presliding=(n,))
        unknown = sorted(set(self.terms) - set(SYMBOLS))
        if unknown:
            raise InputError(
                "friction terms that no format supports",
                value=", ".join(unknown),
                limit=", ".join(SYMBOLS),
                next_step="Identify again with --terms fc,fv,im, or other terms of one joint.",
            )
        terms = {
            symbol: frozen(self.terms.get(symbol, np.zeros(n)), shape=(n,), name=symbol)
            for symbol in SYMBOLS
        }
        object.__setattr__(self, "terms", MappingProxyType(terms))

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.robot.joints

    @property
    def speed_alone(self) -> bool:
        """Whether friction depends on nothing but speed: no friction by load, no ripple."""
        return not any(self.terms[symbol].any() for symbol in SHAPED_SYMBOLS)


def completed_model(estimate: Estimate) -> tuple[ExportModel, Completion]:
    """The model of an estimate, and the standard parameters that it was completed to.

    Physically consistent estimates carry theirs; others are completed by the bodies nearest to the
    prior with the same torques.
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
    motors = coupled_motors(robot)
    whole = ExportModel(
        robot=robot,
        inertials=_about_joints(values[: 10 * n], frames),
        terms=terms,
        width=np.broadcast_to(np.asarray(friction.width, dtype=np.float64), (n,)),
        stribeck_velocity=np.broadcast_to(friction.stribeck_velocity, (n,)),
        shares=motor_turns(robot),
        motors=motors,
        load=None
        if friction.load is None
        else _about_joints(np.array(friction.load.parameters), frames),
        ripples=friction.ripples,
        presliding=np.array(friction.presliding) if any(friction.presliding) else None,
        physical=found.physical,
        worst=found.worst,
        origin=found.origin,
    )
    return whole, found


def _about_joints(parameters: Array, frames: Array) -> Array:
    """(n, 10) from parameters (10 n) about the parameter frames, which are in the joint frames."""
    rows = parameters.reshape(-1, 10)
    return np.array([move(own, frame) for own, frame in zip(rows, frames, strict=True)])


_STATES = 2000
_SEED = 0
_ALONE = ("Fc", "Fv", "Fo", "Im", "Imm")
"""Beside these, Coulomb and viscous friction are what was identified."""


_STEEP = 0.01
"""Share of the top speed within which a Coulomb step may as well be a sign."""
_MOVES = 0.5
"""Share of the width of its Coulomb step that a joint has to pass to show the shape."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NearestFriction(Value):
    """Coulomb and viscous friction of each joint, and what they leave of all friction."""

    coulomb: Array
    """(n) [N.m or N]"""
    viscous: Array
    """(n) [N.m.s/rad or N.s/m]"""
    missing: Array
    """(n) RMS of the friction that they leave, over the recorded range [N.m or N]."""
    stands_in: bool
    """Whether they are others than those identified."""
    wide_step: bool = False
    """Whether that is for the width of the Coulomb step alone."""

    def put_into(self, model: ExportModel) -> ExportModel:
        """The model with this Coulomb and viscous friction."""
        return replace(model, terms={**model.terms, "Fc": self.coulomb, "Fv": self.viscous})

    def torque(self, dq: Array) -> Array:
        """(N, n) at velocities (N, n), the Coulomb step a sign."""
        return self.coulomb * np.sign(dq) + self.viscous * dq


def nearest_friction(
    estimate: Estimate, completed: Completion, model: ExportModel
) -> NearestFriction:
    """What an identified model has, where that is all; else the least squares fit to all of it.

    The fit is over states drawn evenly from the recorded range of positions, velocities and
    accelerations, neither of the two below zero.
    """
    n, terms = model.joints, model.terms
    offset = terms["Fo"]
    # A joint that stood shows no step, however wide.
    speed = estimate.motion.speed
    wide = (terms["Fc"] != 0) & (model.width > _STEEP * speed) & (_MOVES * model.width < speed)
    others = any(values.any() for symbol, values in terms.items() if symbol not in _ALONE)
    if not others and not wide.any():
        return NearestFriction(
            coulomb=terms["Fc"], viscous=terms["Fv"], missing=np.abs(offset), stands_in=False
        )
    q, dq, ddq = recorded_range(estimate)
    # A constant is friction of neither kind, and must not be taken for some by chance.
    wanted = _friction(estimate.model, completed, q, dq, ddq) - offset
    both, missing = np.zeros((2, n)), np.zeros(n)
    for j in range(n):
        columns = np.column_stack([np.sign(dq[:, j]), dq[:, j]])
        if not others and not wide[j]:
            both[:, j], missing[j] = (terms["Fc"][j], terms["Fv"][j]), abs(offset[j])
            continue
        both[:, j] = scipy_part("optimize").nnls(columns, wanted[:, j])[0]
        left = wanted[:, j] - columns @ both[:, j]
        missing[j] = np.hypot(np.sqrt(np.mean(np.square(left))), offset[j])
    return NearestFriction(
        coulomb=both[0], viscous=both[1], missing=missing, stands_in=True, wide_step=not others
    )


def recorded_range(estimate: Estimate) -> tuple[Array, Array, Array]:
    """(N, n) states drawn evenly from the recorded range: q, dq, ddq, SI units."""
    seen = estimate.motion
    random = np.random.default_rng(_SEED)
    q, dq, ddq = random.uniform(-1.0, 1.0, (3, _STATES, estimate.model.robot.joints))
    middle, reach = (seen.upper + seen.lower) / 2.0, (seen.upper - seen.lower) / 2.0
    return middle + reach * q, seen.speed * dq, seen.acceleration * ddq


def _friction(
    model: InverseDynamicModel, completed: Completion, q: Array, dq: Array, ddq: Array
) -> Array:
    """(N, n) all friction of the identified model."""
    first = 10 * model.robot.joints
    values = np.array(completed.values)
    values[:first] = 0.0
    for k, column in enumerate(model.columns[first:], start=first):
        if not column.name.startswith("F"):
            values[k] = 0.0
    return model.inverse_dynamics(q, dq, ddq, values)
