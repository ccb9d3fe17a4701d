"""`dynid payload`: what a robot carries, from runs with and without it.

`dynid gains`: drive gains from the controller's own targets.

Drive gains from runs with and without a payload that was weighed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

from dynid.core import Array, Finding, InputError, frozen
from dynid.identification import (
    LARGEST_STD,
    PRIOR_GAIN,
    WIDTH,
    DriveGains,
    IdentificationProblem,
    Payload,
    SharedProblem,
    WeighedGains,
    WeightedLeastSquares,
    drive_gains,
    fit_shared,
    payload_of,
    weighed_gains,
    with_load,
)
from dynid.recording import ExperimentRecord, identity
from dynid.reduction import reduce_model
from dynid.regressor import FrictionTerms, InverseDynamicModel, LoadFriction
from dynid.robot import RobotModel, frame_map, from_body, load_robot
from dynid.signals import ProcessingSettings, process

SMOOTHING_VELOCITY = 0.01
"""Width of the Coulomb step, unless other friction is asked for [rad/s or m/s]."""


def identify_payload(
    unloaded: ExperimentRecord | Sequence[ExperimentRecord],
    loaded: ExperimentRecord | Sequence[ExperimentRecord],
    robot: RobotModel | str | Path,
    *,
    friction: FrictionTerms | None = None,
    cutoff_hz: float | None = None,
) -> Payload:
    """The payload that the loaded runs carry and the unloaded ones do not.

    Best with one motion for both: what the model gets wrong then cancels. Friction is each
    record's own, as gears warm up between runs.

    Args:
        unloaded: Recordings without the payload.
        loaded: Recordings with it.
        robot: The robot, or its name or file, as it is without the payload.
        friction: Friction terms; the default is Coulomb, viscous, motor inertia, and friction
            that grows with the load.
        cutoff_hz: Low-pass cut-off of the motion [Hz]; None: from the first record's spectrum.

    Raises:
        InputError: No records, one record as both, or records that do not fit the robot.
        JobError: Motions that do not show all ten parameters.
    """
    without, carrying = _several(unloaded), _several(loaded)
    if not without or not carrying:
        raise InputError(
            "needs recordings with and without the payload", value=(len(without), len(carrying))
        )
    seen = {identity(record) for record in without}
    if any(identity(record) in seen for record in carrying):
        raise InputError(
            "a recording with the payload is one without it",
            next_step="Record the same motion again with the payload.",
        )
    model = robot if isinstance(robot, RobotModel) else load_robot(robot)
    if friction is None:
        joints = tuple(range(model.joints))
        nothing = LoadFriction(joints=joints, parameters=(0.0,) * 10 * model.joints)
        friction = FrictionTerms(width=SMOOTHING_VELOCITY, load=nothing)
    with threadpool_limits(limits=1, user_api="blas"):
        problem = _problem(without, carrying, model, friction, cutoff_hz)
        return payload_of(problem, fit_shared(problem, one_noise=True))


def _problem(
    without: list[ExperimentRecord],
    carrying: list[ExperimentRecord],
    robot: RobotModel,
    friction: FrictionTerms,
    cutoff_hz: float | None,
) -> SharedProblem:
    settings = ProcessingSettings(cutoff_hz=cutoff_hz, decimate=True)
    problems: list[IdentificationProblem] = []
    plain = InverseDynamicModel(robot=robot, friction=friction)
    for record in (*without, *carrying):
        samples = process(record, robot, settings)
        # One filter for all: what it takes from the motion then cancels too.
        settings = replace(settings, cutoff_hz=samples.cutoff_hz)
        model = with_load(plain, samples, WeightedLeastSquares(prior_gain=PRIOR_GAIN))
        problems.append(IdentificationProblem(base=reduce_model(model), samples=samples))
    return SharedProblem(
        problems=tuple(problems),
        loaded=(False,) * len(without) + (True,) * len(carrying),
    )


def _several(records: ExperimentRecord | Sequence[ExperimentRecord]) -> list[ExperimentRecord]:
    return [records] if isinstance(records, ExperimentRecord) else list(records)


_NEEDED = ("target_current", "target_moment")


def identify_gains(
    record: ExperimentRecord, robot: RobotModel | str, *, width: float = WIDTH
) -> DriveGains:
    """Drive gains from a recording of target currents and target moments.

    Target velocities are used where they were recorded: the controller's friction follows them,
    without the noise of measured ones.

    Args:
        record: The recording.
        robot: The robot, or its name or file.
        width: Speed over which the controller's dry friction changes sign [rad/s].

    Raises:
        InputError: A recording without targets or velocities, or of another number of joints.
        JobError: No joint's gain can be told.
    """
    model = robot if isinstance(robot, RobotModel) else load_robot(robot)
    if record.joints != model.joints:
        raise InputError(
            "the recording is of another robot", value=record.joints, limit=model.joints
        )
    missing = [name for name in _NEEDED if name not in record.signals]
    velocity = record.signals.get("target_qd", record.signals.get("qd"))
    if velocity is None:
        missing.append("target_qd or qd")
    if missing or velocity is None:
        raise InputError(
            "drive gains need the controller's own targets",
            value=f"no {', '.join(missing)}",
            next_step="Record with dynid run, or import with --columns ...,target_current=A:B.",
        )
    return drive_gains(
        record.signals["target_current"],
        record.signals["target_moment"],
        velocity,
        rate_hz=record.rate_hz,
        names=model.joint_names,
        width=width,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class GainsFromPayload:
    """Drive gains, and what could not be told."""

    gain: Array
    """(n) joint torque per motor current [N.m/A], NaN where the runs do not show it."""
    std: Array
    """(n) standard deviations [N.m/A], given for all."""
    found: WeighedGains
    """The fit behind them."""
    warnings: tuple[Finding, ...]


def identify_gains_from_payload(
    unloaded: ExperimentRecord | Sequence[ExperimentRecord],
    loaded: ExperimentRecord | Sequence[ExperimentRecord],
    robot: RobotModel | str | Path,
    *,
    mass: float,
    centre: ArrayLike | None = None,
    inertia: ArrayLike | None = None,
    friction: FrictionTerms | None = None,
    cutoff_hz: float | None = None,
) -> GainsFromPayload:
    """Drive gains from currents with and without a known payload.

    Best with one motion for both, fast and wide: joint 1 shows its gain by inertia alone.

    Args:
        unloaded: Recordings with currents, without the payload.
        loaded: Recordings with it.
        robot: The robot, or its name or file; its own drive gains are no
            more than a start.
        mass: Mass of the payload [kg].
        centre: (3) its centre of mass in the flange frame [m], if known.
        inertia: (3, 3) tensor about that centre, along the flange's axes [kg.m^2], if known.
        friction: Friction terms; the default is Coulomb, viscous and motor inertia.
        cutoff_hz: Low-pass cut-off of the motion [Hz]; None: from the first record's spectrum.

    Raises:
        InputError: Records without currents, a mass that is not positive, a tensor without a
            centre, or a robot with counterbalances.
        JobError: Motions or a payload that leave a gain open.
    """
    model = robot if isinstance(robot, RobotModel) else load_robot(robot)
    if model.counterbalances:
        # Their torque is known in N.m, and would have to be scaled with the unknown gains.
        raise InputError("drive gains of a robot with counterbalances", value=model.name)
    several = [[r] if isinstance(r, ExperimentRecord) else list(r) for r in (unloaded, loaded)]
    known = known_payload(mass, centre, inertia)
    plain = InverseDynamicModel(
        robot=model, friction=friction or FrictionTerms(width=SMOOTHING_VELOCITY)
    )
    base = reduce_model(plain)
    settings = ProcessingSettings(cutoff_hz=cutoff_hz, decimate=True)
    with threadpool_limits(limits=1, user_api="blas"):
        problems: list[IdentificationProblem] = []
        for record in (*several[0], *several[1]):
            samples = process(_as_currents(record), model, settings)
            settings = replace(settings, cutoff_hz=samples.cutoff_hz)
            problems.append(IdentificationProblem(base=base, samples=samples))
        flags = (False,) * len(several[0]) + (True,) * len(several[1])
        link = np.asarray(np.linalg.inv(model.parameter_frames[plain.frames][-1]), dtype=np.float64)
        own = model.drives.gain
        found = weighed_gains(
            SharedProblem(problems=tuple(problems), loaded=flags),
            frame_map(link @ model.flange),
            known,
            own if (own > 0).all() else None,
        )
    lost = found.std > LARGEST_STD * found.gain
    return GainsFromPayload(
        gain=np.where(lost, np.nan, found.gain),
        std=found.std,
        found=found,
        warnings=tuple(
            Finding(
                "low_excitation",
                f"no drive gain for {model.joint_names[j]}: its standard deviation would be "
                f"{100 * found.std[j] / found.gain[j]:.0f} %",
            )
            for j in np.flatnonzero(lost)
        ),
    )


def known_payload(mass: float, centre: ArrayLike | None, inertia: ArrayLike | None) -> Array:
    """(10) inertial parameters about the flange, NaN where unknown.

    Raises:
        InputError: A mass that is not positive, or a tensor without a centre.
    """
    if not (np.isfinite(mass) and mass > 0):
        raise InputError("the payload's mass must be positive", value=mass)
    known = np.full(10, np.nan)
    known[0] = mass
    if centre is None:
        if inertia is not None:
            raise InputError("a tensor about the centre of mass needs the centre of mass")
        return known
    known[1:4] = mass * frozen(centre, shape=(3,), name="centre of mass")
    return known if inertia is None else from_body(mass, centre, inertia)


def _as_currents(record: ExperimentRecord) -> ExperimentRecord:
    """The record with its currents read as torques: gains of one."""
    if "current" not in record.signals:
        raise InputError("drive gains need recorded currents", value=", ".join(record.signals))
    signals = {name: values for name, values in record.signals.items() if name != "effort"}
    ones = (1.0,) * record.joints
    return replace(record, signals=signals, metadata=replace(record.metadata, drive_gains=ones))
