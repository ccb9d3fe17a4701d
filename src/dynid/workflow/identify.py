"""`dynid identify`: from recordings to an estimate, validated.

What `dynid identify` can be asked for, and the estimator that answers.

`--preset best`: let the record choose how it is processed and modelled.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

from dynid.core import Finding, InputError, Progress, provenance, told
from dynid.diagnosis import diagnose
from dynid.identification import (
    ESTIMATORS,
    PRIOR_GAIN,
    PURPOSES,
    Estimate,
    Estimator,
    PhysicallyConsistent,
    Selection,
    TowardPublished,
    WeightedLeastSquares,
    estimator_of,
    fit_estimate,
    select,
    with_load,
    with_ripple,
)
from dynid.recording import ExperimentRecord, identity
from dynid.regressor import FrictionTerms, InverseDynamicModel
from dynid.robot import RobotModel, load_robot
from dynid.signals import (
    NYQUIST_SHARE,
    ProcessingSettings,
    Samples,
    find_period,
    fold_periods,
    joined,
    process,
    uniform_signals,
    was_smoothed,
)
from dynid.validation import ValidationResult, reproduce, validate
from dynid.workflow.recordings import RecordLike, opened

PRESETS = ("best", "paper")
WEIGHTINGS = ("joint", "size")


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifySettings:
    """What the user asked for; None means: as the preset says.

    Raises:
        InputError: An unknown preset, estimator or weighting.
    """

    preset: str = "best"
    estimator: str | Estimator | None = None
    """A word of `ESTIMATORS`, or an estimator of your own."""
    terms: FrictionTerms | None = None
    cutoff_hz: float | None = None
    """Low-pass cut-off [Hz]."""
    start_s: float | None = None
    stop_s: float | None = None
    weighting: str = "joint"
    """`joint`: one noise a joint; `size`: joints with equal torque limit share one."""
    frames: str = ""
    purpose: str = "anywhere"
    """What the model is for: `anywhere` chooses by regions left out, `this-motion` by stretches
    of time left out."""

    def __post_init__(self) -> None:
        word = None if isinstance(self.estimator, Estimator) else self.estimator
        for value, allowed, where in (
            (self.preset, PRESETS, "--preset"),
            (self.purpose, PURPOSES, "--for"),
            (word or "ols", ESTIMATORS, "--estimator"),
            (self.weighting, WEIGHTINGS, "--weighting"),
        ):
            if value not in allowed:
                raise InputError("unknown", where=where, value=value, limit=", ".join(allowed))

    @property
    def estimator_word(self) -> str | None:
        """The estimator's word, or the name of one's own; None: as the preset says."""
        return self.estimator.name if isinstance(self.estimator, Estimator) else self.estimator

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "preset": self.preset,
            "estimator": self.estimator_word,
            "terms": None if self.terms is None else self.terms.to_json(),
            "cutoff_hz": self.cutoff_hz,
            "start_s": self.start_s,
            "stop_s": self.stop_s,
            "weighting": self.weighting,
            "frames": self.frames,
            "for": self.purpose,
        }


REGIONS_FROM = 1e-2
"""Weight of the published inertias from which consistent bodies are fitted by regions too: the
motion leaves that much to the prior."""


def chosen_estimator(
    settings: IdentifySettings, robot: RobotModel, choice: Choice | None
) -> Estimator:
    """The estimator that settings ask for, or the one that was chosen.

    Args:
        settings: What the user asked for.
        robot: The robot.
        choice: What was chosen by what is left out; None with the preset `paper`.

    Raises:
        InputError: Weighting by joint size without torque limits.
    """
    if isinstance(settings.estimator, Estimator):
        return settings.estimator
    weight = 0.0 if choice is None else choice.prior_weight
    gain = None if choice is None else PRIOR_GAIN
    word = settings.estimator or ("ols" if choice is None else "wls")
    if word == "sdp" and weight >= REGIONS_FROM:
        return PhysicallyConsistent(prior_gain=gain, by_regions=True)
    if word != "wls":
        return estimator_of(word, gain)
    groups = None
    if settings.weighting == "size":
        torque = robot.limits.torque
        if not np.isfinite(torque).all():
            raise InputError(
                "joint sizes are told by torque limits, and this robot has none",
                where="--weighting size",
                value=robot.name,
            )
        groups = tuple(int(k) for k in np.unique(torque, return_inverse=True)[1])
    if settings.estimator is None and weight > 0:
        return TowardPublished(weight=weight, groups=groups)
    return WeightedLeastSquares(groups=groups, prior_gain=gain)


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """What was chosen, for programs and for people."""

    processing: ProcessingSettings
    friction: FrictionTerms
    prior_weight: float
    near_weights: tuple[float, ...]
    words: tuple[str, ...]


def choose(
    records: Sequence[ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings,
    processing: ProcessingSettings,
    progress: Progress | None = None,
) -> Choice:
    """Choose settings and friction on all records together; a lone periodic one is averaged.

    Args:
        records: The recordings, in any order.
        robot: The robot.
        settings: What the user asked for.
        processing: Settings given by the user: what is set there stays.
        progress: Told what is being tried and how far it is (0 to 1).

    Raises:
        InputError: See `select`.
    """
    recordings = [uniform_signals(record, robot, processing) for record in records]
    averaged: tuple[str, ...] = ()
    # Maximum likelihood has a noise of its own for each sample: no filter fits there. A filter
    # that one record has passed says nothing of the others.
    smoothed = settings.estimator != "ml" and all(map(was_smoothed, recordings))
    # For this motion its repetitions are what is left out: their average would hide how they
    # differ.
    if len(recordings) == 1 and settings.purpose == "anywhere":
        signals = recordings[0]
        period = find_period(signals.q, signals.rate_hz)
        if period is not None:
            processing = replace(processing, period_s=period)
            repetitions = int(len(signals.t) / signals.rate_hz / period + 1e-6)
            recordings = [fold_periods(signals, period)]
            averaged = (f"average of {repetitions} periods of {period:g} s",)
    chosen = select(
        robot,
        settings.frames,
        recordings,
        processing,
        terms=settings.terms,
        smoothed=smoothed,
        # These follow the arm in a simulation, whose friction has no past.
        presliding=settings.estimator not in ("ml", "iv", "didim"),
        purpose=settings.purpose,
        progress=progress,
    )
    return Choice(
        processing=chosen.settings,
        friction=chosen.friction,
        prior_weight=chosen.prior_weight,
        near_weights=chosen.near_weights,
        words=(*averaged, *_words(chosen)),
    )


def _words(chosen: Selection) -> tuple[str, ...]:
    settings, width = chosen.settings, chosen.friction.width
    widths = width if isinstance(width, tuple) else (width,)
    delays = "none" if settings.delays_s is None else _row(1000 * d for d in settings.delays_s)
    sources = {
        "measured": "velocities from measured values",
        "position": "velocities differentiated from positions",
    }
    words = [
        f"chosen for {chosen.purpose}",
        f"cut-off {settings.cutoff_hz:g} Hz",
        sources[settings.velocity],
        f"torque delays {delays}" + ("" if settings.delays_s is None else " ms"),
        f"friction terms {_terms(chosen.friction)}",
        f"Coulomb widths {_row(widths)} rad/s",
        f"held-out RMS {_row(chosen.noise)} N.m",
    ]
    over = chosen.friction.presliding
    if over:
        words.insert(-1, f"presliding over {_row(over)} rad")
    if settings.torque_filter is not None:
        words.insert(0, settings.torque_filter.describe())
    return tuple(words)


def _terms(friction: FrictionTerms) -> str:
    load = friction.load
    return friction.describe() + ("" if load is None else f",{load.describe()}")


def _row(values: Iterable[float]) -> str:
    return " ".join(f"{value:.3g}" for value in values)


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
    warnings: tuple[Finding, ...]

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
            **({} if estimate.standard is None else {"standard": estimate.standard_table()}),
            **(
                {} if estimate.assessment is None else {"assessment": estimate.assessment.to_json()}
            ),
        }


def identify(
    records: RecordLike | Sequence[RecordLike],
    robot: RobotModel | str | Path,
    settings: IdentifySettings | None = None,
    *,
    validation: RecordLike | None = None,
    validation_start_s: float | None = None,
    validation_stop_s: float | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify base parameters from one or more recordings.

    Args:
        records: Recordings of the robot or their files, or one; the window applies to each.
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
    if not isinstance(robot, RobotModel):
        robot = load_robot(robot)
    several = opened(records, robot)
    other = None if validation is None else opened(validation, robot)[0]
    # Matrices of sixty columns: a second BLAS thread spins more than it helps.
    with threadpool_limits(limits=1, user_api="blas"):
        return _identify(
            several,
            robot,
            settings or IdentifySettings(),
            progress,
            (other, validation_start_s, validation_stop_s),
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
    # The same result whatever the order of the files.
    records = sorted(records, key=identity)
    estimate, _ = fit_records(records, robot, settings, progress)
    training = reproduce(estimate, records[0], start_s=settings.start_s, stop_s=settings.stop_s)
    result = None
    warnings = [
        *gains_nothing(estimate),
        *estimate.warnings,
        *diagnose(records, robot, estimate.settings),
    ]
    for record in records:
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
    )


def fit_records(
    records: Sequence[ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings,
    progress: Progress | None = None,
) -> tuple[Estimate, Samples]:
    """Choose, process and fit.

    Args:
        records: The recordings.
        robot: The robot.
        settings: What to do.
        progress: Told what is being done and how far it is (0 to 1).

    Returns:
        The estimate and the samples that it was fitted to.
    """
    processing = ProcessingSettings(
        cutoff_hz=settings.cutoff_hz,
        start_s=settings.start_s,
        stop_s=settings.stop_s,
        decimate=settings.preset == "best" or max(r.samples for r in records) > LONG_RECORD,
    )
    choice = None
    if settings.preset == "best":
        choice = choose(records, robot, settings, processing, progress)
        processing = choice.processing
    parts = [process(record, robot, processing) for record in records]
    samples = parts[0] if len(parts) == 1 else joined(parts)
    friction = settings.terms or FrictionTerms() if choice is None else choice.friction
    estimator = chosen_estimator(settings, robot, choice)
    model = InverseDynamicModel(robot=robot, frames=settings.frames, friction=friction)
    model = with_load(model, samples, estimator)
    if choice is not None and settings.terms is None:
        model = with_ripple(model, samples, estimator)
    estimate = fit_estimate(
        model,
        samples,
        estimator,
        records=records,
        settings=processing,
        preset=settings.preset,
        choices=(
            *(() if choice is None else choice.words),
            *(ripple.describe() for ripple in model.friction.ripples),
        ),
        made=provenance(
            inputs={
                r.metadata.origin or f"record {k + 1}": identity(r) for k, r in enumerate(records)
            },
            settings=settings.to_json(),
        ),
        lengths=[part.count for part in parts],
        prior_weight=0.0 if choice is None else choice.prior_weight,
        near_weights=() if choice is None else choice.near_weights,
    )
    return estimate, samples


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
