"""Several recordings of one robot at once: inertias, friction over temperature, payloads, gains.

Friction is each record's own. Drive gains come from the controller's own targets, or from runs with
and without a payload that was weighed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynid import identification, recording, reduction, validation
from dynid.core import Array, Finding, InputError, Progress, frozen, one_thread, table, told
from dynid.regressor import FrictionTerms, InverseDynamicModel, LoadFriction
from dynid.robot import RobotLike, RobotModel, frame_map, from_body, load_robot, with_carried
from dynid.settings import IdentifySettings
from dynid.signals import ProcessingSettings, Samples, process, window
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
    records: recording.RecordLike | Sequence[recording.RecordLike],
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
    several = recording.checked_records(recording.open_several(records, robot))
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
            replace(one, warnings=(*one.warnings, *validation.record_findings(robot, record)))
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
    return identification.IdentificationProblem(base=reduction.reduce_model(found), samples=samples)


@dataclass(frozen=True, slots=True, kw_only=True)
class TemperatureIdentification(identification.TemperatureModel):
    """Shared inertias, and friction as a function of joint temperature."""

    shared: SharedIdentification
    """The inertias, and the friction of each record."""

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        names = self.shared.problem.problems[0].base.model.robot.joint_names
        laws: list[dict[str, Any]] = []
        for name, law in zip(names, self.laws, strict=True):
            std, fall_std = np.sqrt(np.diag(law.covariance)).reshape(2, -1)
            laws.append(
                {
                    "joint": name,
                    "law": law.law,
                    "reference_degC": law.reference_degC,
                    "range_degC": list(law.range_degC),
                    "parameters": table(
                        name=law.symbols,
                        value=law.reference,
                        std=std,
                        fall_per_K=law.slope,
                        fall_std=fall_std,
                    ),
                }
            )
        return {
            "temperature_degC": self.temperature_degC.tolist(),
            "laws": laws,
            **told(self.warnings),
        }


def identify_temperature(
    records: recording.RecordLike | Sequence[recording.RecordLike],
    robot: RobotLike,
    settings: IdentifySettings | None = None,
    *,
    law: str = "auto",
    progress: Progress | None = None,
) -> TemperatureIdentification:
    """Friction as a function of temperature, from recordings with joint temperatures.

    Each record counts at its mean temperatures: record warm-ups in short pieces.

    Args:
        records: Recordings at two or more temperatures, or their files; three let the data choose
            the law.
        robot: The robot, or its name or file.
        settings: As for `identify_shared`.
        law: Of viscous friction: `exponential`, `linear`, or `auto` for what fits better.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: Fewer than two records, no temperatures in them, an unknown law, or what
            `identify_shared` refuses.
        JobError: A singular problem.
    """
    robot = load_robot(robot, collision=False)
    several = recording.open_several(records, robot)
    without = [k + 1 for k, record in enumerate(several) if "temperature" not in record.signals]
    if without:
        raise InputError(
            "recordings without joint temperatures",
            value=f"records {without}",
            next_step="Record with dynid run, or import with --columns ...,temperature=A:B.",
        )
    several = recording.checked_records(several)
    if len(several) < 2:
        raise InputError("a temperature law needs two records or more", value=len(several))
    settings = settings or IdentifySettings()
    parts = [window(record.t, settings.start_s, settings.stop_s) for record in several]
    warm = [record.signals["temperature"] for record in several]
    mean = np.array([one[part].mean(axis=0) for one, part in zip(warm, parts, strict=True)])
    shared = identify_shared(several, robot, settings, progress=progress)
    problem, solved = shared.problem, shared.fit
    names, own = shared.own, solved.solution.own
    base, laws = problem.problems[0].base, list[identification.JointTemperatureLaw]()
    for joint, degC in zip(identification.friction_places(base), mean.T, strict=True):
        places = identification.friction_order(base, len(own), joint)
        covariance = solved.covariance[np.ix_(places, places)]
        symbols = [names[c].rstrip("0123456789") for c in joint]
        laws.append(identification.fit_law(own[:, joint], covariance, degC, symbols, law=law))
    return TemperatureIdentification(
        shared=shared,
        # Load friction has the inertias that each recording shows: those of the coldest.
        estimate=shared.estimates[int(np.argmin(mean.sum(axis=1)))],
        laws=tuple(laws),
        temperature_degC=mean,
        covariance=solved.covariance,
        naive=solved.naive,
        warnings=(*_flat(laws), *validation.record_findings(robot, *several)),
    )


def _flat(laws: Sequence[identification.JointTemperatureLaw]) -> Iterator[Finding]:
    flat = [str(j + 1) for j, law in enumerate(laws) if law.law == "constant"]
    if flat:
        yield Finding(
            "low_excitation",
            f"the temperatures of joints {', '.join(flat)} differ by less than "
            f"{identification.LEAST_SPREAD_K:g} K between the records: their friction is taken "
            "as constant",
        )


SMOOTHING_VELOCITY = 0.01
"""Width of the Coulomb step, unless other friction is asked for [rad/s or m/s]."""


def identify_payload(
    unloaded: recording.RecordLike | Sequence[recording.RecordLike],
    loaded: recording.RecordLike | Sequence[recording.RecordLike],
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
    seen = {recording.identity(record) for record in without}
    if any(recording.identity(record) in seen for record in carrying):
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
    told_by = validation.record_findings(model, *without, *carrying)
    return replace(found, warnings=(*found.warnings, *told_by))


def _problem(
    without: list[recording.ExperimentRecord],
    carrying: list[recording.ExperimentRecord],
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
    robot: RobotModel, *groups: recording.RecordLike | Sequence[recording.RecordLike]
) -> list[list[recording.ExperimentRecord]]:
    """Recordings without and with the payload, at least one of each."""
    found = [recording.checked_records(recording.open_several(group, robot)) for group in groups]
    if not all(found):
        counts = tuple(map(len, found))
        raise InputError("needs recordings with and without the payload", value=counts)
    return found


TARGETS = ("target_current", "target_moment")
"""Signals that drive gains are found in."""


def identify_gains(record: recording.RecordLike, robot: RobotLike) -> identification.DriveGains:
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
    record = recording.open_record(record, model)
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
    return replace(found, warnings=(*found.warnings, *validation.record_findings(model, record)))


def identify_gains_from_payload(
    unloaded: recording.RecordLike | Sequence[recording.RecordLike],
    loaded: recording.RecordLike | Sequence[recording.RecordLike],
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
    told_by = validation.record_findings(model, *without, *carrying)
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


def _as_currents(record: recording.ExperimentRecord) -> recording.ExperimentRecord:
    """The record with its currents read as torques: gains of one."""
    if "current" not in record.signals:
        raise InputError("drive gains need recorded currents", value=", ".join(record.signals))
    signals = {name: values for name, values in record.signals.items() if name != "effort"}
    ones = (1.0,) * record.joints
    return replace(record, signals=signals, metadata=replace(record.metadata, drive_gains=ones))
