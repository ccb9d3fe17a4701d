"""Several recordings of one robot at once: shared inertias; payloads and drive gains.

Friction is each record's own. Drive gains come from the controller's own targets, or from runs with
and without a payload that was weighed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynid import identification
from dynid.core import Array, InputError, Progress, frozen, one_thread, told
from dynid.recording import (
    ExperimentRecord,
    RecordLike,
    checked_records,
    identity,
    open_record,
    open_several,
)
from dynid.reduction import reduce_model
from dynid.regressor import FrictionTerms, InverseDynamicModel, LoadFriction
from dynid.robot import RobotLike, RobotModel, frame_map, from_body, load_robot, with_carried
from dynid.settings import IdentifySettings
from dynid.signals import ProcessingSettings, Samples, process
from dynid.validation import record_findings
from dynid.workflow import choosing


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedIdentification:
    """Estimates of several records with the same inertias in all of them."""

    estimates: tuple[identification.Estimate, ...]
    """One a record: the shared inertias and the record's own friction. Each validates, compares
    and exports as any other."""
    problem: identification.SharedProblem
    """The recordings as one problem."""
    fit: identification.SharedFit
    """Its least squares solution."""

    @property
    def shared(self) -> tuple[str, ...]:
        """Names of the base parameters that the records share."""
        base = self.problem.problems[0].base
        return tuple(base.names[k] for k in self.problem.common)

    @property
    def own(self) -> tuple[str, ...]:
        """Names of the base parameters that each record has of its own."""
        base = self.problem.problems[0].base
        return tuple(base.names[k] for k in self.problem.own)

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "robot": self.estimates[0].model.robot.name,
            "shared": list(self.shared),
            "own": list(self.own),
            "records": [
                {
                    "samples": estimate.samples,
                    "noise": estimate.noise.tolist(),
                    "parameters": estimate.parameter_table(),
                    **told(estimate.warnings),
                }
                for estimate in self.estimates
            ],
        }


def identify_shared(
    records: RecordLike | Sequence[RecordLike],
    robot: RobotLike,
    settings: IdentifySettings | None = None,
    *,
    progress: Progress | None = None,
) -> SharedIdentification:
    """Identify several recordings at once, the inertias shared and the friction not.

    Each joint of each record has a noise of its own.

    Args:
        records: Recordings of the robot or their files: cold, warm, of other days.
        robot: The robot, or its name or file.
        settings: What to do, weighted least squares only; the window applies to each record.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: No recordings, some that do not fit the robot, or another estimator.
        JobError: A singular problem.
    """
    settings = settings or IdentifySettings()
    robot = with_carried(load_robot(robot, mount=settings.mount, collision=False))
    several = checked_records(open_several(records, robot))
    if not several:
        raise InputError("needs at least one record")
    for record in several:
        choosing.require_torques([record], robot)
    if settings.estimator not in (None, "wls") or settings.weighting != "joint":
        raise InputError(
            "several records at once are fitted by weighted least squares, joint by joint",
            value=(settings.estimator, settings.weighting),
            limit="wls, joint",
        )
    processing = choosing.asked_processing(several, settings)
    friction, words = settings.terms or FrictionTerms(), ()
    with one_thread():
        if settings.preset == "best":
            choice, words = choosing.choose(several, robot, settings, processing, progress)
            # Periods are averaged record by record or not at all: here every sample counts.
            processing, friction = replace(choice.settings, period_s=None), choice.friction
        model = InverseDynamicModel(robot=robot, frames=settings.frames, friction=friction)
        samples = [process(record, robot, processing) for record in several]
        problem = identification.SharedProblem(
            problems=tuple(problem_of(model, one) for one in samples)
        )
        fit = identification.fit_shared(problem)
        source = identification.EstimateSource(
            records=several,
            settings=processing,
            preset=settings.preset,
            choices=words,
            made=choosing.made_from(several, settings),
        )
        estimates = tuple(
            replace(one, warnings=(*one.warnings, *record_findings(robot, record)))
            for one, record in zip(
                identification.shared_estimates(problem, fit, source), several, strict=True
            )
        )
    return SharedIdentification(estimates=estimates, problem=problem, fit=fit)


def problem_of(
    model: InverseDynamicModel, samples: Samples
) -> identification.IdentificationProblem:
    """One record's part of a shared problem: its load friction as its own samples show it."""
    found = identification.with_load(
        model, samples, identification.WeightedLeastSquares(prior_gain=identification.PRIOR_GAIN)
    )
    return identification.IdentificationProblem(base=reduce_model(found), samples=samples)


SMOOTHING_VELOCITY = 0.01
"""Width of the Coulomb step, unless other friction is asked for [rad/s or m/s]."""


def identify_payload(
    unloaded: RecordLike | Sequence[RecordLike],
    loaded: RecordLike | Sequence[RecordLike],
    robot: RobotLike,
    *,
    friction: FrictionTerms | None = None,
    cutoff_hz: float | None = None,
) -> identification.Payload:
    """The payload that the loaded runs carry and the unloaded ones do not.

    Best with one motion for both: what the model gets wrong then cancels. Friction is each
    record's own, as gears warm up between runs.

    Args:
        unloaded: Recordings without the payload, or their files.
        loaded: Recordings with it.
        robot: The robot, or its name or file, as it is without the payload.
        friction: Friction terms; the default is Coulomb, viscous, motor inertia, and friction
            that grows with the load.
        cutoff_hz: Low-pass cut-off of the motion [Hz]; None: from the first record's spectrum.

    Raises:
        InputError: No records, one record as both, or records that do not fit the robot.
        JobError: Motions that do not show the parameters of the arm.
    """
    model = load_robot(robot, collision=False)
    without, carrying = _several(model, unloaded, loaded)
    for record in (*without, *carrying):
        choosing.require_torques([record], model)
    seen = {identity(record) for record in without}
    if any(identity(record) in seen for record in carrying):
        raise InputError(
            "a recording with the payload is one without it",
            next_step="Record the same motion again with the payload.",
        )
    if friction is None:
        joints = tuple(range(model.joints))
        nothing = LoadFriction(joints=joints, parameters=(0.0,) * 10 * model.joints)
        friction = FrictionTerms(width=SMOOTHING_VELOCITY, load=nothing)
    with one_thread():
        plain = InverseDynamicModel(robot=model, friction=friction)
        problem = _problem(without, carrying, plain, cutoff_hz)
        found = identification.payload_of(
            problem, identification.fit_shared(problem, one_noise=True)
        )
    told_by = record_findings(model, *without, *carrying)
    return replace(found, warnings=(*found.warnings, *told_by))


def _problem(
    without: list[ExperimentRecord],
    carrying: list[ExperimentRecord],
    model: InverseDynamicModel,
    cutoff_hz: float | None,
) -> identification.SharedProblem:
    settings = ProcessingSettings(cutoff_hz=cutoff_hz, decimate=True)
    problems: list[identification.IdentificationProblem] = []
    for record in (*without, *carrying):
        choosing.require_cutoff(record.rate_hz, cutoff_hz, record.duration_s)
        samples = process(record, model.robot, settings)
        # One filter for all: what it takes from the motion then cancels too.
        settings = replace(settings, cutoff_hz=samples.cutoff_hz)
        problems.append(problem_of(model, samples))
    flags = (False,) * len(without) + (True,) * len(carrying)
    return identification.SharedProblem(problems=tuple(problems), loaded=flags)


def _several(
    robot: RobotModel, *groups: RecordLike | Sequence[RecordLike]
) -> list[list[ExperimentRecord]]:
    """Recordings without and with the payload, at least one of each."""
    found = [checked_records(open_several(group, robot)) for group in groups]
    if not all(found):
        counts = tuple(map(len, found))
        raise InputError("needs recordings with and without the payload", value=counts)
    return found


TARGETS = ("target_current", "target_moment")
"""Signals that drive gains are found in."""


def identify_gains(record: RecordLike, robot: RobotLike) -> identification.DriveGains:
    """Drive gains from a recording of target currents and target moments.

    Target velocities are used where they were recorded: the controller's friction follows them,
    without the noise of measured ones.

    Args:
        record: The recording or its file.
        robot: The robot, or its name or file.

    Raises:
        InputError: A recording without targets or velocities, or of another number of joints.
        JobError: No joint's gain can be told.
    """
    model = load_robot(robot, collision=False)
    record = open_record(record, model)
    missing = [name for name in TARGETS if name not in record.signals]
    velocity = record.signals.get("target_qd", record.signals.get("qd"))
    if missing or velocity is None:
        raise InputError(
            "drive gains need the controller's own targets",
            value=f"no {', '.join(missing or ['target_qd or qd'])}",
            next_step="Record with dynid run, or import with --columns ...,target_current=A:B.",
        )
    found = identification.drive_gains(
        record.signals["target_current"],
        record.signals["target_moment"],
        velocity,
        rate_hz=record.rate_hz,
        names=model.joint_names,
    )
    return replace(found, warnings=(*found.warnings, *record_findings(model, record)))


def identify_gains_from_payload(
    unloaded: RecordLike | Sequence[RecordLike],
    loaded: RecordLike | Sequence[RecordLike],
    robot: RobotLike,
    *,
    mass: float,
    centre: ArrayLike | None = None,
    inertia: ArrayLike | None = None,
    friction: FrictionTerms | None = None,
    cutoff_hz: float | None = None,
) -> identification.GainsFromPayload:
    """Drive gains from currents with and without a known payload.

    Best with one motion for both, fast and wide: joint 1 shows its gain by inertia alone.

    Args:
        unloaded: Recordings with currents, without the payload, or their files.
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
    model = load_robot(robot, collision=False)
    if model.counterbalances:
        # Their torque is known in N.m, and would have to be scaled with the unknown gains.
        raise InputError("drive gains of a robot with counterbalances", value=model.name)
    without, carrying = ([_as_currents(r) for r in rs] for rs in _several(model, unloaded, loaded))
    known = known_payload(mass, centre, inertia)
    friction = friction or FrictionTerms(width=SMOOTHING_VELOCITY)
    plain = InverseDynamicModel(robot=model, friction=friction)
    with one_thread():
        problem = _problem(without, carrying, plain, cutoff_hz)
        link = np.asarray(np.linalg.inv(model.parameter_frames[plain.frames][-1]), dtype=np.float64)
        own = model.drives.gain if (model.drives.gain > 0).all() else None
        turn = frame_map(link @ model.flange)
        found = identification.gains_from_payload(problem, turn, known, own)
    told_by = record_findings(model, *without, *carrying)
    return replace(found, warnings=(*found.warnings, *told_by))


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
