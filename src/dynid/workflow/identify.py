"""`dynid identify`: from recordings to an estimate, validated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

from dynid.core.errors import InputError
from dynid.core.notices import Notice
from dynid.core.progress import Progress
from dynid.core.provenance import provenance
from dynid.identification.estimate import Estimate
from dynid.identification.fitting import fit_estimate
from dynid.identification.loading import with_load
from dynid.identification.ripple import with_ripple
from dynid.recording.identity import identity
from dynid.recording.record import ExperimentRecord
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.terms import FrictionTerms
from dynid.robot.load import load_robot
from dynid.robot.model import RobotModel
from dynid.signals.filters import NYQUIST_SHARE
from dynid.signals.process import process
from dynid.signals.samples import ProcessingSettings, joined
from dynid.validation.carried import CARRIED
from dynid.validation.findings import wrong_inputs
from dynid.validation.prediction import ValidationResult, reproduce, validate
from dynid.workflow.choosing import choose
from dynid.workflow.identify_settings import IdentifySettings, chosen_estimator

LONG_RECORD = 20_000
"""Samples above which rows are averaged whatever the preset: time and memory stay bounded."""
OVER_FITTED = 1.6
"""Median ratio of validation to training RMS error above which a result is over-fitted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Identification:
    """An estimate with its training and validation errors."""

    estimate: Estimate
    training: ValidationResult
    validation: ValidationResult | None
    warnings: tuple[Notice, ...]

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
            "warnings": [notice.to_json() for notice in self.warnings],
            **({} if estimate.standard is None else {"standard": estimate.standard_table()}),
        }


def identify(
    records: ExperimentRecord | Sequence[ExperimentRecord],
    robot: RobotModel | str | Path,
    settings: IdentifySettings | None = None,
    *,
    validation: ExperimentRecord | None = None,
    validation_start_s: float | None = None,
    validation_stop_s: float | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify base parameters from one or more recordings.

    Args:
        records: Recordings of the robot, or one; the window applies to each.
        robot: The robot, or its name or file.
        settings: What to do; the default is `--preset best`.
        validation: Another recording to predict, or the same one with another window.
        validation_start_s: Start of its window [s].
        validation_stop_s: End of its window [s].
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: Recordings that do not fit the robot, an empty window, unknown settings.
        JobError: A singular problem.
    """
    several = [records] if isinstance(records, ExperimentRecord) else list(records)
    for record in (*several, *(() if validation is None else (validation,))):
        if not isinstance(record, ExperimentRecord):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(
                "not a recording", value=record, next_step="Read it with dynid.read_recording."
            )
    if not isinstance(robot, RobotModel):
        robot = load_robot(robot)
    # Matrices of sixty columns: a second BLAS thread spins more than it helps.
    with threadpool_limits(limits=1, user_api="blas"):
        return _identify(
            several,
            robot,
            settings or IdentifySettings(),
            progress,
            (validation, validation_start_s, validation_stop_s),
        )


def _identify(
    records: Sequence[ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings,
    progress: Progress | None,
    other: tuple[ExperimentRecord | None, float | None, float | None],
) -> Identification:
    if not records:
        raise InputError("needs at least one record")
    _check_cutoff(records, settings.cutoff_hz)
    processing = ProcessingSettings(
        cutoff_hz=settings.cutoff_hz,
        start_s=settings.start_s,
        stop_s=settings.stop_s,
        decimate=settings.preset == "best" or max(r.samples for r in records) > LONG_RECORD,
    )
    friction, prior_gain, words = settings.terms or FrictionTerms(), None, ()
    ill_conditioned = False
    if settings.preset == "best":
        choice = choose(
            records,
            robot,
            settings.frames,
            processing,
            terms=settings.terms,
            # Maximum likelihood has a noise of its own for each sample: no filter fits there.
            smoothed=settings.estimator != "ml",
            # These follow the arm in a simulation, whose friction has no past.
            presliding=settings.estimator not in ("ml", "iv", "didim"),
            progress=progress,
        )
        processing, friction = choice.processing, choice.friction
        prior_gain, words = choice.prior_gain, choice.words
        ill_conditioned = choice.ill_conditioned
    parts = [process(record, robot, processing) for record in records]
    samples = parts[0] if len(parts) == 1 else joined(parts)
    model = InverseDynamicModel(robot=robot, frames=settings.frames, friction=friction)
    model = with_load(model, samples, prior_gain)
    if settings.preset == "best" and settings.terms is None and not ill_conditioned:
        model = with_ripple(model, samples, prior_gain)
        words = (*words, *(ripple.describe() for ripple in model.friction.ripples))
    estimate = fit_estimate(
        model,
        samples,
        chosen_estimator(settings, robot, prior_gain, ill_conditioned=ill_conditioned),
        record=records[0],
        settings=processing,
        preset=settings.preset,
        choices=words,
        made=provenance(
            inputs={
                r.metadata.origin or f"record {k + 1}": identity(r) for k, r in enumerate(records)
            },
            settings=settings.to_json(),
        ),
    )
    training = reproduce(estimate, records[0], start_s=settings.start_s, stop_s=settings.stop_s)
    result = None
    warnings = [
        *estimate.warnings,
        *wrong_inputs(
            estimate,
            samples,
            records[0],
            training,
            start_s=settings.start_s,
            stop_s=settings.stop_s,
        ),
    ]
    for record in records:
        warnings += [notice for notice in record.problems if notice not in warnings]
    validation, validation_start_s, validation_stop_s = other
    if validation is not None:
        result = validate(
            estimate, validation, start_s=validation_start_s, stop_s=validation_stop_s
        )
        warnings += result.warnings
        if not any(CARRIED in notice.message for notice in result.warnings):
            warnings += over_fitted(training, result)
    return Identification(
        estimate=replace(estimate, warnings=tuple(warnings)),
        training=training,
        validation=result,
        warnings=tuple(warnings),
    )


def _check_cutoff(records: Sequence[ExperimentRecord], cutoff_hz: float | None) -> None:
    """A cut-off that the record cannot carry is refused, not replaced."""
    highest = min(NYQUIST_SHARE * record.rate_hz / 2 for record in records)
    if cutoff_hz is not None and cutoff_hz > highest * (1 + 1e-6):
        raise InputError(
            "the cut-off is too high for the record's rate",
            where="--cutoff",
            value=f"{cutoff_hz:g} Hz",
            limit=f"up to {highest:g} Hz",
        )


def over_fitted(training: ValidationResult, validation: ValidationResult) -> tuple[Notice, ...]:
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
        Notice(
            "over_fitted",
            f"errors on the validation record (moving joints) are {typical:.1f} times those of the "
            f"training record (worst joint {worst:.1f}): the model has learnt this record, not the "
            "robot",
        ),
    )
