"""`dynid identify`: from recordings to an estimate, validated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynid.core.errors import InputError
from dynid.core.linalg import upper_triangle
from dynid.core.notices import Notice
from dynid.core.provenance import provenance
from dynid.identification.accumulate import joint_factors
from dynid.identification.diagnostics import diagnose
from dynid.identification.estimate import Estimate, MotionRange
from dynid.identification.least_squares import (
    PRIOR_GAIN,
    Estimator,
    OrdinaryLeastSquares,
    WeightedLeastSquares,
    autocorrelation,
)
from dynid.identification.problem import IdentificationProblem
from dynid.identification.robust import HuberRegression
from dynid.identification.selection import Progress, select
from dynid.identification.statistics import (
    essential_parameters,
    hac_covariance,
    naive_covariance,
)
from dynid.recording.record import ExperimentRecord
from dynid.reduction.base import reduce_model
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.terms import FrictionTerms
from dynid.robot.model import RobotModel
from dynid.signals.periods import find_period, fold_periods
from dynid.signals.process import process, uniform_signals
from dynid.signals.samples import ProcessingSettings, Samples
from dynid.validation.prediction import ValidationResult, validate

PRESETS = ("best", "paper")
ESTIMATORS = ("ols", "wls", "irls")
WEIGHTINGS = ("joint", "size")
LONG_RECORD = 20_000
"""Samples above which rows are averaged whatever the preset: time and memory stay bounded."""
OVER_FITTED = 1.6
"""Median ratio of validation to training RMS error above which a result is over-fitted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifySettings:
    """What the user asked for; None means: as the preset says.

    Raises:
        InputError: An unknown preset, estimator or weighting.
    """

    preset: str = "best"
    estimator: str | None = None
    terms: FrictionTerms | None = None
    cutoff_hz: float | None = None
    """Low-pass cut-off [Hz]."""
    start_s: float | None = None
    stop_s: float | None = None
    weighting: str = "joint"
    """`joint`: one noise a joint; `size`: joints with equal torque limit share one."""
    frames: str = ""

    def __post_init__(self) -> None:
        for value, allowed, where in (
            (self.preset, PRESETS, "--preset"),
            (self.estimator or "ols", ESTIMATORS, "--estimator"),
            (self.weighting, WEIGHTINGS, "--weighting"),
        ):
            if value not in allowed:
                raise InputError("unknown", where=where, value=value, limit=", ".join(allowed))

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "preset": self.preset,
            "estimator": self.estimator,
            "terms": None if self.terms is None else self.terms.to_json(),
            "cutoff_hz": self.cutoff_hz,
            "start_s": self.start_s,
            "stop_s": self.stop_s,
            "weighting": self.weighting,
            "frames": self.frames,
        }


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
        }


def identify(
    records: Sequence[ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings | None = None,
    *,
    validation: ExperimentRecord | None = None,
    validation_start_s: float | None = None,
    validation_stop_s: float | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify base parameters from one or more recordings.

    Args:
        records: Recordings of the robot; the window applies to each.
        robot: The robot.
        settings: What to do; the default is `--preset best`.
        validation: Another recording to predict, or the same one with another window.
        validation_start_s: Start of its window [s].
        validation_stop_s: End of its window [s].
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: Recordings that do not fit the robot, an empty window, unknown settings.
        JobError: A singular problem.
    """
    settings = settings or IdentifySettings()
    if not records:
        raise InputError("needs at least one record")
    processing = ProcessingSettings(
        cutoff_hz=settings.cutoff_hz,
        start_s=settings.start_s,
        stop_s=settings.stop_s,
        decimate=settings.preset == "best" or max(r.samples for r in records) > LONG_RECORD,
    )
    friction = settings.terms or FrictionTerms()
    choices: tuple[str, ...] = ()
    prior_gain = None
    if settings.preset == "best":
        processing, friction, prior_gain, choices = _choose(
            records, robot, settings, processing, progress
        )
    parts = [process(record, robot, processing) for record in records]
    samples = parts[0] if len(parts) == 1 else _joined(parts)
    model = InverseDynamicModel(robot=robot, frames=settings.frames, friction=friction)
    estimate = _estimate(
        model,
        samples,
        settings,
        replace(processing, cutoff_hz=samples.cutoff_hz),
        prior_gain,
        choices,
        records,
    )
    training = validate(estimate, records[0], start_s=settings.start_s, stop_s=settings.stop_s)
    result = None
    warnings = list(estimate.warnings)
    if validation is not None:
        result = validate(
            estimate, validation, start_s=validation_start_s, stop_s=validation_stop_s
        )
        warnings += [*result.warnings, *over_fitted(training, result)]
    return Identification(
        estimate=replace(estimate, warnings=tuple(warnings)),
        training=training,
        validation=result,
        warnings=tuple(warnings),
    )


def over_fitted(training: ValidationResult, validation: ValidationResult) -> tuple[Notice, ...]:
    """Whether the model does much worse on another record than on its own."""
    ratio = validation.metrics.rmse / training.metrics.rmse
    worst, typical = float(np.nanmax(ratio)), float(np.nanmedian(ratio))
    if typical <= OVER_FITTED and worst <= 2 * OVER_FITTED:
        return ()
    return (
        Notice(
            "over_fitted",
            f"errors on the validation record are {typical:.1f} times those of the training "
            f"record (worst joint {worst:.1f}): the model has learnt this record, not the robot",
        ),
    )


def _choose(
    records: Sequence[ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings,
    processing: ProcessingSettings,
    progress: Progress | None,
) -> tuple[ProcessingSettings, FrictionTerms, float, tuple[str, ...]]:
    longest = max(records, key=lambda record: record.duration_s)
    signals = uniform_signals(longest, robot, processing)
    period = find_period(signals.q, signals.rate_hz)
    if period is not None and len(records) == 1:
        processing = replace(processing, period_s=period)
        repetitions = int(len(signals.t) / signals.rate_hz / period + 1e-6)
        signals = fold_periods(signals, period)
        folded = (f"average of {repetitions} periods of {period:g} s",)
    else:
        folded = ()
    chosen = select(
        robot, settings.frames, signals, processing, terms=settings.terms, progress=progress
    )
    delays = chosen.settings.delays_s
    width = chosen.friction.width
    widths = width if isinstance(width, tuple) else (width,)
    return (
        chosen.settings,
        chosen.friction,
        chosen.prior_gain,
        (
            *folded,
            f"cut-off {chosen.settings.cutoff_hz:g} Hz",
            f"velocities from {chosen.settings.velocity} values"
            if chosen.settings.velocity == "measured"
            else "velocities differentiated from positions",
            "torque delays "
            + ("none" if delays is None else " ".join(f"{1000 * d:g}" for d in delays) + " ms"),
            f"friction terms {chosen.friction.describe()}",
            "Coulomb widths " + " ".join(f"{w:g}" for w in widths) + " rad/s",
            *(
                (f"prior gain {chosen.prior_gain:g}, stronger for an ill-conditioned record",)
                if chosen.prior_gain < PRIOR_GAIN
                else ()
            ),
            "held-out RMS " + " ".join(f"{x:.3g}" for x in chosen.noise) + " N.m",
        ),
    )


def _estimate(
    model: InverseDynamicModel,
    samples: Samples,
    settings: IdentifySettings,
    processing: ProcessingSettings,
    prior_gain: float | None,
    choices: tuple[str, ...],
    records: Sequence[ExperimentRecord],
) -> Estimate:
    base = reduce_model(model)
    problem = IdentificationProblem(base=base, samples=samples)
    estimator = _estimator(settings, model.robot, prior_gain)
    fit = estimator.fit(problem)
    root = upper_triangle(joint_factors(problem)[:, :, : base.rank].reshape(-1, base.rank))
    estimate = Estimate(
        model=model,
        independent=base.independent,
        expressions=base.expressions,
        values=fit.values,
        covariance=hac_covariance(fit, problem),
        naive_std=np.sqrt(np.diag(naive_covariance(fit))),
        noise=fit.noise,
        condition_number=float(np.linalg.cond(root)),
        scaled_condition_number=float(np.linalg.cond(root / np.linalg.norm(root, axis=0))),
        samples=problem.blocks,
        estimator=estimator.name,
        preset=settings.preset,
        settings=processing,
        essential=essential_parameters(fit),
        motion=MotionRange(
            lower=samples.q.min(axis=0),
            upper=samples.q.max(axis=0),
            speed=np.abs(samples.dq).max(axis=0),
            acceleration=np.percentile(np.abs(samples.ddq), 99.5, axis=0),
        ),
        choices=choices,
        provenance=provenance(
            inputs={r.metadata.origin: r.metadata.input_hash for r in records},
            settings=settings.to_json(),
        ),
        residual_autocorrelation=autocorrelation(problem.residual(fit.values), 1),
    )
    notices = [*base.warnings, *diagnose(estimate, samples)]
    for record in records:
        notices += [notice for notice in record.problems if notice not in notices]
    return replace(estimate, warnings=tuple(notices))


def _estimator(settings: IdentifySettings, robot: RobotModel, prior: float | None) -> Estimator:
    word = settings.estimator or ("ols" if settings.preset == "paper" else "wls")
    if word == "ols":
        return OrdinaryLeastSquares()
    if word == "irls":
        return HuberRegression(prior_gain=prior)
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
    return WeightedLeastSquares(groups=groups, prior_gain=prior)


def _joined(parts: Sequence[Samples]) -> Samples:
    """Samples of several records, one after the other."""
    starts = np.cumsum([0.0, *(part.t[-1] + 1.0 for part in parts[:-1])])
    return Samples(
        t=np.concatenate([part.t + s for part, s in zip(parts, starts, strict=True)]),
        q=np.concatenate([part.q for part in parts]),
        dq=np.concatenate([part.dq for part in parts]),
        ddq=np.concatenate([part.ddq for part in parts]),
        tau=np.concatenate([part.tau for part in parts]),
        block=max(part.block for part in parts),
        rate_hz=parts[0].rate_hz,
        cutoff_hz=parts[0].cutoff_hz,
    )
