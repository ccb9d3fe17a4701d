"""`dynid identify`, `validate` and `compare` from files, and the verdict on a result."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.core import InputError, Progress, check_word, workers
from dynid.diagnosis import USELESS_PREDICTION, Verdict, judge
from dynid.export import simulator_obstacle
from dynid.identification import open_estimate, write_estimate
from dynid.recording import (
    LONG,
    AnyRecording,
    ExperimentRecord,
    StoredRecording,
    checked_records,
    local_files,
    open_any,
    open_record,
)
from dynid.settings import IdentifySettings
from dynid.signals import ProcessingSettings, rows_of, survey, window
from dynid.validation import MOVING_SPEED, ValidationResult, refit_friction, samples_of, validate
from dynid.workflow.identify import Identification, identify
from dynid.workflow.recordings import robot_of

POOR_DEVIATION = 50.0
"""[%] of a parameter's value above which its deviation makes it uncertain."""


def identify_files(
    recordings: Sequence[str | Path],
    output: str | Path | None = None,
    *,
    robot: str | Path | None = None,
    settings: IdentifySettings | None = None,
    validation: str | Path | None = None,
    validation_start_s: float | None = None,
    validation_stop_s: float | None = None,
    gains: Sequence[float] | None = None,
    jobs: int = 1,
    dask: str | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify from recordings, validate if asked to, write the estimate if told where.

    As `identify`, from paths or URLs of an object store; None stands for the robot that they say.
    With a window alone, the validation is of the one recording that was given. `gains` (n)
    [N.m/A] override those of the recordings and of the robot; `jobs` or the workers of a Dask
    scheduler sum long recordings.

    Raises:
        InputError: Files that cannot be read or do not belong together, unknown settings.
        JobError: A singular problem.
    """
    others = [] if validation is None else [validation]
    with local_files([*recordings, *others]) as paths:
        files = paths[: len(recordings)]
        model = robot_of(files, robot)
        found = open_any(files, model, gains)
        if gains is not None:
            # Remembered with the estimate, for recordings of the robot that are without.
            model = replace(model, drives=replace(model.drives, gain=np.array(gains)))
        held = [record for record in found if isinstance(record, ExperimentRecord)]
        # Of those that stay in their files, a part is checked when it is looked at.
        stored = [record for record in found if isinstance(record, StoredRecording)]
        records: list[AnyRecording] = [*checked_records(held), *stored]
        other: ExperimentRecord | None = None
        if validation is not None:
            other = open_record(paths[-1], model, gains)
        elif validation_start_s is not None or validation_stop_s is not None:
            if len(records) > 1:
                raise InputError(
                    "a validation window needs a recording",
                    value=f"{len(records)} recordings",
                    next_step="Name it with --validate RECORD.",
                )
            other = _window_of(records[0], validation_start_s, validation_stop_s)
            if not isinstance(records[0], ExperimentRecord):
                validation_start_s = validation_stop_s = None
        if other is not None:
            # A wrong window must not cost the time of an identification first.
            window(other.t, validation_start_s, validation_stop_s)
        with workers(jobs, dask) as beside:
            result = identify(
                records,
                model,
                settings,
                validation=other,
                validation_start_s=validation_start_s,
                validation_stop_s=validation_stop_s,
                partial=None if output is None else f"{output}.partial",
                beside=beside,
                progress=progress,
            )
        if output is not None:
            write_estimate(result.estimate, output)
        return result


def _window_of(
    record: AnyRecording, start_s: float | None, stop_s: float | None
) -> ExperimentRecord:
    """A recording whose window can be validated: of a stored one, the window alone."""
    if isinstance(record, ExperimentRecord):
        return record
    grid = survey(record, ProcessingSettings(start_s=start_s, stop_s=stop_s))
    if grid.last_row - grid.first_row > LONG:
        raise InputError(
            "the window is too long to be predicted at once",
            where="--validate-from, --validate-to",
            value=f"{grid.last_row - grid.first_row} rows",
            limit=f"{LONG} rows",
        )
    return rows_of(record, grid.first_row, grid.last_row)


def validate_files(
    estimate: str | Path,
    recording: str | Path,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
    at_degC: float | None = None,
    gains: Sequence[float] | None = None,
    refit: str | None = None,
    output: str | Path | None = None,
) -> ValidationResult:
    """Predict the torques of a recording, or of a window of it [s], and measure the error.

    All joints are at a temperature [degC] where the file holds temperature laws. `gains` (n)
    [N.m/A] override those of the recording and of the robot. With `refit`, which is `friction`,
    friction is taken from this recording first, and the refitted estimate written if told where.

    Raises:
        InputError: Files that cannot be read, or do not belong together.
    """
    check_word(refit or "friction", ("friction",), "--refit")
    if output is not None and refit is None:
        raise InputError("nothing to write without --refit", where="--output", value=str(output))
    known = open_estimate(estimate, at_degC)
    record = open_record(recording, known.model.robot, gains)
    if refit is not None:
        samples = samples_of(known, record, start_s=start_s, stop_s=stop_s)
        known = refit_friction(known, samples)
        if output is not None:
            write_estimate(known, output)
    return validate(known, record, start_s=start_s, stop_s=stop_s)


def verdict(result: Identification) -> Verdict:
    """Judge an identification by the error to expect, the faults found and the motion.

    Left-out parts of its own record count where no other recording was predicted.
    """
    estimate, kinds = result.estimate, {f.kind for f in result.warnings}
    fit = result.training.moving.relative_error_overall_percent
    confirmed = result.validation is not None and "same_record" not in kinds
    judged = result.validation if confirmed and result.validation is not None else result.training
    expected, noise = None, noise_percent(judged)
    if confirmed:
        expected = judged.moving.relative_error_overall_percent
    elif estimate.assessment is not None:
        left_out = estimate.assessment
        expected = left_out.expected_error_percent
        size = float(np.linalg.norm(left_out.torque))
        noise = 100 * float(np.linalg.norm(left_out.noise_floor)) / max(size, 1e-12)
    elif not fit <= USELESS_PREDICTION:
        expected = fit if np.isfinite(fit) else USELESS_PREDICTION + fit
    with np.errstate(invalid="ignore"):
        uncertain = float(np.mean(~(estimate.relative_std_percent < POOR_DEVIATION)))
    return judge(
        result.warnings,
        expected_percent=expected,
        noise_percent=noise,
        confirmed=confirmed,
        uncertain_share=uncertain,
        pays=None if estimate.assessment is None else estimate.assessment.pays,
        obstacle=simulator_obstacle(estimate),
    )


def noise_percent(result: ValidationResult) -> float:
    """Noise of the torques of moving joints as a share of them [%]: what no model predicts.

    From differences of the error from sample to sample, so that a slow error is no noise.
    """
    moving = np.abs(result.dq[1:]) > MOVING_SPEED
    steps = np.square(np.diff(result.measured - result.predicted, axis=0))[moving]
    torque = np.square(result.measured[1:])[moving].sum()
    return float(100 * np.sqrt(steps.sum() / 2 / torque)) if torque > 0 else 0.0
