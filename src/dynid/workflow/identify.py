"""`dynid identify`: from recordings to an estimate, validated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

from dynid.core import Finding, InputError, Progress, Workers, provenance, told
from dynid.diagnosis import diagnose
from dynid.identification import Estimate, fit_estimate
from dynid.recording import LONG, AnyRecording, ExperimentRecord, fingerprint
from dynid.robot import RobotModel, load_robot
from dynid.signals import ProcessingSettings
from dynid.validation import ValidationResult, reproduce, validate
from dynid.workflow.accuracy import Accuracy, accuracy
from dynid.workflow.choosing import LONG_RECORD, IdentifySettings, prepare, require_cutoff
from dynid.workflow.long_recordings import Looked, fit_long
from dynid.workflow.recordings import AnyRecordLike, RecordLike, opened, opened_any

OVER_FITTED = 1.6
"""Median ratio of validation to training RMS error above which a result is over-fitted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Identification:
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
            "standard_parameters": len(estimate.model.columns),
            "base_parameters": len(estimate.values),
            "condition_number": estimate.condition_number,
            "scaled_condition_number": estimate.scaled_condition_number,
            "motion_condition_number": estimate.motion_condition_number,
            "samples": estimate.samples,
            "estimator": estimate.estimator,
            "preset": estimate.preset,
            "choices": list(estimate.choices),
            "settings": estimate.settings.to_json(),
            "friction": estimate.model.friction.to_json(),
            "frames": estimate.model.frames,
            "parameters": estimate.parameter_table(),
            "training": self.training.to_json(),
            "validation": None if self.validation is None else self.validation.to_json(),
            "warnings": told(self.warnings),
            "findings": [finding.to_json() for finding in self.warnings],
            "accuracy": None if self.accuracy is None else self.accuracy.to_json(),
            **({} if estimate.standard is None else {"standard": estimate.standard_table()}),
            **(
                {} if estimate.assessment is None else {"assessment": estimate.assessment.to_json()}
            ),
        }


def identify(
    records: AnyRecordLike | Sequence[AnyRecordLike],
    robot: RobotModel | str | Path,
    settings: IdentifySettings | None = None,
    *,
    validation: RecordLike | None = None,
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
        InputError: Recordings that do not fit the robot, an empty window, unknown settings.
        JobError: A singular problem.
    """
    if not isinstance(robot, RobotModel):
        robot = load_robot(robot)
    several = opened_any(records, robot)
    other = None if validation is None else opened(validation, robot)[0]
    # Matrices of sixty columns: a second BLAS thread spins more than it helps.
    with threadpool_limits(limits=1, user_api="blas"):
        return _identify(
            several,
            robot,
            settings or IdentifySettings(),
            progress,
            (other, validation_start_s, validation_stop_s),
            None if partial is None else Path(partial),
            beside,
        )


def _identify(
    records: Sequence[AnyRecording],
    robot: RobotModel,
    settings: IdentifySettings,
    progress: Progress | None,
    other: tuple[ExperimentRecord | None, float | None, float | None],
    partial: Path | None,
    beside: Workers | None,
) -> Identification:
    if not records:
        raise InputError("needs at least one record")
    # The same result whatever the order of the files.
    records = sorted(records, key=fingerprint)
    held = [record for record in records if isinstance(record, ExperimentRecord)]
    if len(held) < len(records) or sum(record.samples for record in held) > LONG:
        fitted = fit_long(
            records, robot, settings, partial=partial, beside=beside, progress=progress
        )
    else:
        fitted = fit_records(held, robot, settings, progress)
    estimate, training = fitted.estimate, fitted.training
    result = None
    warnings = [
        *gains_nothing(estimate),
        *estimate.warnings,
        *diagnose(fitted.records, robot, fitted.window),
    ]
    for record in (*records, *fitted.records):
        warnings += [notice for notice in record.problems if notice not in warnings]
    validation, validation_start_s, validation_stop_s = other
    if validation is not None:
        result = validate(
            estimate, validation, start_s=validation_start_s, stop_s=validation_stop_s
        )
        warnings += result.warnings
        if not any(finding.kind == "payload" for finding in result.warnings):
            warnings += over_fitted(training, result)
    return Identification(
        estimate=replace(estimate, warnings=tuple(warnings)),
        training=training,
        validation=result,
        warnings=tuple(warnings),
        accuracy=accuracy(estimate, records),
    )


def fit_records(
    records: Sequence[ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings,
    progress: Progress | None = None,
) -> Looked:
    """Choose, process and fit.

    Args:
        records: The recordings.
        robot: The robot.
        settings: What to do.
        progress: Told what is being done and how far it is (0 to 1).
    """
    require_cutoff(min(record.rate_hz for record in records), settings.cutoff_hz)
    processing = ProcessingSettings(
        cutoff_hz=settings.cutoff_hz,
        start_s=settings.start_s,
        stop_s=settings.stop_s,
        decimate=settings.preset == "best" or max(r.samples for r in records) > LONG_RECORD,
    )
    found = prepare(records, robot, settings, processing, progress)
    estimate = fit_estimate(
        found.model,
        found.samples,
        found.estimator,
        records=records,
        settings=found.processing,
        preset=settings.preset,
        choices=found.words,
        made=provenance(
            inputs={
                r.metadata.origin or f"record {k + 1}": fingerprint(r)
                for k, r in enumerate(records)
            },
            settings=settings.to_json(),
        ),
        lengths=found.lengths,
        prior_weight=found.prior_weight,
        near_weights=found.near_weights,
    )
    training = reproduce(estimate, records[0], start_s=settings.start_s, stop_s=settings.stop_s)
    return Looked(
        estimate=estimate, training=training, records=tuple(records), window=estimate.settings
    )


def gains_nothing(estimate: Estimate) -> tuple[Finding, ...]:
    """Whether published inertias with fitted friction predict left-out parts as well."""
    told_by = estimate.assessment
    if told_by is None or told_by.pays is not False:
        return ()
    errors = {model.name: float(np.linalg.norm(model.rms)) for model in told_by.models}
    fitted, identified = errors["published_friction"], errors["identified"]
    return (
        Finding(
            "identification_gains_nothing",
            value=100.0 * (identified / max(fitted, 1e-12) - 1.0),
            unit="%",
            text=f"on parts left out, identified inertias err by {identified:.3g} N.m, published "
            f"ones with fitted friction and motor inertia by {fitted:.3g} N.m: identifying the "
            "inertias gains nothing",
            next_step="Record a motion with more excitation, or use the published inertias",
        ),
    )


def over_fitted(training: ValidationResult, validation: ValidationResult) -> tuple[Finding, ...]:
    """Whether the model does much worse on another record than on its own, where joints move.

    At rest friction takes what it likes: more standstill is no sign of a worse model.
    """
    ratio = validation.moving.rmse / training.moving.rmse
    if not np.isfinite(ratio).any():
        return ()
    worst, typical = float(np.nanmax(ratio)), float(np.nanmedian(ratio))
    if typical <= OVER_FITTED and worst <= 2 * OVER_FITTED:
        return ()
    return (
        Finding(
            "over_fitted",
            severity="info",
            value=typical,
            unit="1",
            text=f"errors on the validation record (moving joints) are {typical:.1f} times those "
            f"of the training record (worst joint {worst:.1f})",
        ),
    )
