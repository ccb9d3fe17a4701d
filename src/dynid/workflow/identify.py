"""`dynid identify`: from recordings to an estimate, validated; and how good it is.

The torque error found is that on parts left out, or on recordings left out, without what no model
of the motion explains. It has a part that falls with time, which the covariance of the parameters
tells, and the error of the model, which stays.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid import export, figures, recording, signals, trajectory
from dynid.core import Array, Finding, InputError, Progress, Value, Workers, one_thread, plain, told
from dynid.diagnosis import SLOWER, USELESS_PREDICTION, Verdict, diagnose, judge
from dynid.identification import Assessment, Estimate, fit_estimate
from dynid.robot import RobotLike, RobotModel, joints_by_kind, load_robot, with_carried
from dynid.settings import IdentifySettings
from dynid.validation import ValidationResult, deciding_errors, record_findings, reproduce, validate
from dynid.workflow import choosing, long_recordings, recordings

PROMISED = "predicted_torque_error_percent"
"""Key of a recording's metadata: what its design promises for the periods recorded."""
CONFIDENCE = 1.645
"""Of the bound of the error found, one-sided 95 %, as a normal quantile."""
UNSURE = 35 / 9 - 2
"""Variance of a mean square less that of second differences, of white noise, times N / sigma^4."""
LONGER = 10.0
"""A run so many times longer is the most that is thought of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """Expected and found torque error of one model, as shares of the RMS torque [%].

    Of an arm that turns and slides, of the kind of joints that errs more.
    """

    expected_percent: float
    """What the designs of its recordings promise together; NaN where none does."""
    found_percent: float
    """On what was left out; at the speeds of the motions that the model is for, if asked."""
    bound_percent: float
    """What it stays below with 95 % probability: noise hides errors in short recordings, and they
    differ from stretch to stretch."""
    noise_percent: float
    """The part that falls with time, on the motions that the model is for; NaN if not asked."""
    left_out: str
    """`regions` of the only recording, or `recordings`."""

    @property
    def after_longer_percent(self) -> float:
        """What a run `LONGER` times as long would leave."""
        return math.sqrt(self.model_percent**2 + self.noise_percent**2 / LONGER)

    @property
    def model_percent(self) -> float:
        """What no time takes away."""
        return math.sqrt(max(self.found_percent**2 - self.noise_percent**2, 0.0))

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return plain(
            {
                "expected_percent": self.expected_percent,
                "found_percent": self.found_percent,
                "found_bound_percent": self.bound_percent,
                "noise_percent": self.noise_percent,
                "left_out": self.left_out,
            }
        )

    def describe(self) -> str:
        """One sentence."""
        where = f"on left-out {self.left_out}"
        if not math.isnan(self.noise_percent):
            where += " at the speeds of the motions that the model is for"
        found = f"{self.found_percent:.2g} % {where}"
        found += f" (there below {self.bound_percent:.2g} % with 95 % probability)"
        if math.isnan(self.noise_percent):
            found += ", slower motions may err more"
        if math.isnan(self.expected_percent):
            return f"Torque error beyond noise: {found}"
        return f"Torque error beyond noise: {found}; by the design: {self.expected_percent:.2g} %"


def accuracy(
    estimate: Estimate,
    records: Sequence[recording.AnyRecording],
    dq: Array,
    motions: Sequence[trajectory.JointMotion] = (),
) -> Accuracy | None:
    """Expected beside found, by an estimate from all of the records; None where not assessed.

    Args:
        estimate: The estimate.
        records: What it was identified from.
        dq: (N, n) velocities there [rad/s or m/s].
        motions: What the model is for; without any the recorded motion counts, and the noise's
            part is left out.
    """
    told = estimate.assessment
    if told is None:
        return None
    promises = [_promised(r) for r in records]
    square, power = np.square(told.anywhere), np.square(told.torque)
    doubt, variance = told.squares_at(dq)[1], np.full(len(power), np.nan)
    if motions:
        square, doubt, power, variance = np.mean([_on(estimate, told, m) for m in motions], axis=0)
    parts = [(math.nan,) * 3]
    for joints in joints_by_kind(estimate.model.robot.prismatic).values():
        if not power[joints].any():
            continue
        noise = told.noise_floor[joints]
        left = max(float(square[joints].sum() - np.square(noise).sum()), 0.0)
        white = math.sqrt(UNSURE * float(np.power(noise, 4).sum()) / estimate.samples)
        most = left + CONFIDENCE * max(white, float(doubt[joints].sum()))
        parts.append((left, most, float(variance[joints].sum())) / power[joints].sum())
    found, most, noise = 100 * np.sqrt(np.fmax.reduce(parts))
    return Accuracy(
        # Variances of independent recordings add as their inverses.
        expected_percent=float(np.sum(np.power(promises, -2.0)) ** -0.5) if promises else math.nan,
        found_percent=float(found),
        bound_percent=float(most),
        noise_percent=float(noise),
        left_out="regions" if len(records) == 1 else "recordings",
    )


def _on(estimate: Estimate, told: Assessment, motion: trajectory.JointMotion) -> Array:
    """(4, n) of a motion: square error at its speeds, its standard error, square torque, noise."""
    states = motion.q, motion.dq, motion.ddq
    stack = estimate.model.stack(*states)[list(estimate.independent)]
    spread = np.tensordot(estimate.covariance, stack, axes=1)
    variance = np.maximum((stack * spread).sum(axis=(0, 2)) / len(motion.q), 0.0)
    torque = np.square(estimate.predict(*states)).mean(axis=0)
    return np.stack([*told.squares_at(motion.dq), torque, variance])


def _promised(record: recording.AnyRecording) -> float:
    """What its design promises for as much of it as was recorded [%]; NaN where nothing is."""
    held = record.metadata.extra
    if not {PROMISED, "period_s", "periods"} <= held.keys():
        return float(held.get(PROMISED, "nan"))
    percent, period, periods = (float(held[name]) for name in (PROMISED, "period_s", "periods"))
    stamps = (record.t,) if isinstance(record, recording.ExperimentRecord) else record.stamps()
    ends = [float(part[k]) for part in stamps for k in (0, -1)]
    steps = max(record.samples - 1, 1)
    lasted = (ends[-1] - ends[0]) * record.samples / steps
    # The noise of a run that was stopped is averaged over less.
    return percent * math.sqrt(max(period * periods / max(lasted, 1e-9), 1.0))


OVER_FITTED = 1.6
"""Median ratio of validation to training RMS error above which a result is over-fitted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Identification(Value):
    """An estimate with its training and validation errors."""

    estimate: Estimate
    """Base parameters with their covariance."""
    training: ValidationResult
    """Errors on the recordings that were identified from."""
    validation: ValidationResult | None
    """Errors on another recording; None without one."""
    warnings: tuple[Finding, ...]
    """All findings, those of the recordings included."""
    accuracy: Accuracy | None = None
    """Torque error that the designs promised beside the one found."""

    def to_json(self) -> dict[str, Any]:
        """The keys of the design."""
        estimate = self.estimate
        return {
            "robot": estimate.model.robot.name,
            **estimate.summary(),
            "training": self.training.to_json(),
            "validation": self.validation and self.validation.to_json(),
            **told(self.warnings),
            "accuracy": self.accuracy and self.accuracy.to_json(),
        }


def identify(
    records: recording.AnyRecordLike | Sequence[recording.AnyRecordLike],
    robot: RobotLike,
    settings: IdentifySettings | None = None,
    *,
    validation: recording.RecordLike | None = None,
    validation_start_s: float | None = None,
    validation_stop_s: float | None = None,
    partial: str | Path | None = None,
    beside: Workers | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify base parameters from one or more recordings.

    Recordings of hours are summed in one pass over their files, in constant memory; what has to
    be chosen is chosen on a part of them.

    Args:
        records: Recordings of the robot or their files, or one; the window applies to each.
        robot: The robot, or its name or file.
        settings: What to do; the default is `--preset best`.
        validation: Another recording to predict, or the same one with another window.
        validation_start_s: Start of its window [s].
        validation_stop_s: End of its window [s].
        partial: File that keeps the sums of a long pass: an interrupted one goes on from there.
            It is removed at the end.
        beside: Who takes part in a long pass (`dynid.core.workers`); None for this process alone.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: Recordings that do not fit the robot, a torque that never changes, an empty
            window, unknown settings.
        JobError: A singular problem.
    """
    settings = settings or IdentifySettings()
    robot = with_carried(load_robot(robot, mount=settings.mount, collision=False))
    several = recording.open_any(recording.as_list(records), robot)
    robot = robot if settings.mount else recordings.as_mounted(robot, several)
    # Of those that stay in their files, a part is checked when it is looked at.
    stored = [one for one in several if isinstance(one, recording.StoredRecording)]
    held = [one for one in several if isinstance(one, recording.ExperimentRecord)]
    # The same result whatever the order of the files.
    held = sorted(recording.checked_records(held), key=recording.fingerprint)
    several = sorted([*held, *stored], key=recording.fingerprint)
    other = None if validation is None else recording.open_record(validation, robot)
    if not several:
        raise InputError("needs at least one record")
    with one_thread():
        if stored or sum(record.samples for record in held) > recording.LONG:
            keep = None if partial is None else Path(partial)
            fitted = long_recordings.fit_long(
                several, robot, settings, partial=keep, beside=beside, progress=progress
            )
        else:
            fitted = fit_records(held, robot, settings, progress)
        estimate, training, result = fitted.estimate, fitted.training, None
        faults = diagnose(fitted.records, robot, fitted.window)
        warnings = [*gains_nothing(estimate), *estimate.warnings, *faults]
        named = {(fault.kind, fault.joints) for fault in faults if fault.joints}
        for record in (*several, *fitted.records):
            warnings += [
                notice
                for notice in record_findings(robot, record)
                if notice not in warnings and (notice.kind, notice.joints) not in named
            ]
        if other is not None:
            result = validate(estimate, other, start_s=validation_start_s, stop_s=validation_stop_s)
            # Where another part of this recording was identified from, it was told already.
            warnings += [finding for finding in result.warnings if finding not in warnings]
            warnings += over_fitted(training, result)
        return Identification(
            estimate=replace(estimate, warnings=tuple(warnings)),
            training=training,
            validation=result,
            warnings=tuple(warnings),
            accuracy=accuracy(estimate, several, training.dq),
        )


def fit_records(
    records: Sequence[recording.ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings,
    progress: Progress | None = None,
) -> long_recordings.Looked:
    """Choose, process and fit recordings that are held in memory."""
    rate = min(record.rate_hz for record in records)
    parts = [r.t[signals.window(r.t, settings.start_s, settings.stop_s)] for r in records]
    choosing.require_cutoff(rate, settings.cutoff_hz, min(float(np.ptp(part)) for part in parts))
    for record in records:
        choosing.require_torques([record], robot)
    processing, made = (
        choosing.asked_processing(records, settings),
        choosing.made_from(records, settings),
    )
    estimate = fit_estimate(choosing.prepare(records, robot, settings, processing, made, progress))
    return long_recordings.Looked(
        estimate=estimate,
        training=reproduce(estimate, records[0]),
        records=tuple(records),
        window=estimate.settings,
    )


def gains_nothing(estimate: Estimate) -> Iterator[Finding]:
    """Whether published inertias with fitted friction predict left-out parts as well."""
    told_by = estimate.assessment
    if told_by is None or told_by.pays is not False:
        return
    errors = {name: float(np.linalg.norm(rms)) for name, rms in told_by.models.items()}
    fitted, identified = errors["published_friction"], errors["identified"]
    unit = figures.joint_unit("N.m", estimate.model.robot.prismatic)
    yield Finding(
        "identification_gains_nothing",
        value=100.0 * (identified / max(fitted, 1e-12) - 1.0),
        unit="%",
        text=f"on parts left out, identified inertias err by {identified:.3g}, published ones "
        f"with fitted friction and motor inertia by {fitted:.3g} {unit}: identifying the "
        "inertias gains nothing",
        next_step="Record a motion with more excitation, or use the published inertias",
    )


def _another_load(validation: ValidationResult) -> bool:
    return any(finding.kind == "payload" for finding in validation.warnings)


def over_fitted(training: ValidationResult, validation: ValidationResult) -> Iterator[Finding]:
    """Whether the model does much worse on another record than on its own, where joints move.

    At rest friction takes what it likes: neither more standstill nor a load says that.
    """
    ratio = validation.moving.rmse / training.moving.rmse
    if _another_load(validation) or not np.isfinite(ratio).any():
        return
    worst, typical = float(np.nanmax(ratio)), float(np.nanmedian(ratio))
    if typical > OVER_FITTED or worst > 2 * OVER_FITTED:
        yield Finding(
            "over_fitted",
            severity="info",
            value=typical,
            unit="1",
            text=f"errors on the validation record (moving joints) are {typical:.1f} times those "
            f"of the training record (worst joint {worst:.1f})",
        )


POOR_DEVIATION = 50.0
"""[%] of a parameter's value above which its deviation makes it uncertain."""


def verdict(result: Identification) -> Verdict:
    """Judge an identification by the error to expect, the faults found and the motion.

    Left-out parts of its own record count where no other recording, or one with another load, was
    predicted.
    """
    estimate, kinds = result.estimate, {f.kind for f in result.warnings}
    other = result.validation
    confirmed = other is not None and "same_record" not in kinds and not _another_load(other)
    judged = other if confirmed and other is not None else result.training
    slides = estimate.model.robot.prismatic
    errors = deciding_errors(judged.measured, judged.predicted, judged.moves, slides)
    expected, whole, noise, slow, covered = None, None, errors.noise, None, None
    if confirmed:
        expected, whole = errors.moving, errors.whole
        if judged.covered is not None:
            least = int(np.argmin(judged.covered))
            covered = estimate.model.robot.joint_names[least], float(judged.covered[least])
    elif estimate.assessment is not None:
        expected, noise = estimate.assessment.deciding_percent(slides)
        slow = estimate.assessment.model_percent(result.training.dq / SLOWER, slides)
    elif not errors.moving <= USELESS_PREDICTION:
        found = errors.moving
        expected = found if np.isfinite(found) else USELESS_PREDICTION + found
    with np.errstate(invalid="ignore"):
        uncertain = float(np.mean(~(estimate.relative_std_percent < POOR_DEVIATION)))
    return judge(
        result.warnings,
        expected_percent=expected,
        noise_percent=noise,
        resolution_percent=errors.resolution,
        confirmed=confirmed,
        uncertain_share=uncertain,
        pays=None if estimate.assessment is None else estimate.assessment.pays,
        obstacle=export.simulator_obstacle(estimate),
        whole_percent=whole,
        slow_percent=slow,
        covered=covered,
    )
