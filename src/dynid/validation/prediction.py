"""Predict the torques of another record and measure the error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynid.core.arrays import Array, Mask, read_only
from dynid.core.notices import Notice
from dynid.identification.estimate import Estimate
from dynid.identification.least_squares import autocorrelation
from dynid.identification.problem import motion_state
from dynid.recording.identity import identity
from dynid.recording.record import ExperimentRecord
from dynid.signals.filters import default_cutoff
from dynid.signals.process import uniform_signals
from dynid.signals.samples import ProcessingSettings, Samples
from dynid.signals.stamps import samples_at_stamps
from dynid.signals.torque_filter import was_smoothed
from dynid.validation.carried import another_payload
from dynid.validation.metrics import MOVING_SPEED, Metrics, metrics

EXTRAPOLATION = 1.15
"""A record may exceed the identification's speeds, accelerations and ranges of motion by this
factor before it is said."""
OVERLAP_S = 0.1
SAME_RECORD = "part of the record that was identified from"
REST_SHARE = 0.2
"""More joint samples at rest than this are worth a warning."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationResult:
    """Prediction against measurement on one record."""

    t: Array
    """(N) time from the start of the window [s]."""
    dq: Array
    """(N, n) velocities [rad/s or m/s]."""
    measured: Array
    """(N, n) measured joint torques, not filtered [N.m or N]."""
    predicted: Array
    """(N, n) predicted joint torques [N.m or N]."""
    metrics: Metrics
    moving: Metrics
    """Only samples where the joint moves."""
    at_rest: Metrics
    """Only samples where the joint stands."""
    residual_autocorrelation: Array
    """(n) of the error at one sample."""
    warnings: tuple[Notice, ...]

    def to_json(self) -> dict[str, Any]:
        """METRICS, the same under `moving` and `at_rest`, and the warnings."""
        return {
            **self.metrics.to_json(),
            "moving": self.moving.to_json(),
            "at_rest": self.at_rest.to_json(),
            "residual_autocorrelation": [float(x) for x in self.residual_autocorrelation],
            "warnings": [notice.to_json() for notice in self.warnings],
        }


def validate(
    estimate: Estimate,
    record: ExperimentRecord,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
) -> ValidationResult:
    """Compare predicted and measured torques, processed as the identification record was.

    Torques are compared as they were recorded, at the record's own stamps. The cut-off is raised
    where this record's motion asks for more: one that suits slow sines would smear the starts and
    stops of way points. A window that was identified from, and a record of another robot, are
    said in the warnings.

    Args:
        estimate: The estimate; its settings are used, its delays as they are.
        record: The record to predict.
        start_s: Start of the window, from the record's start [s].
        stop_s: End of the window [s].

    Raises:
        InputError: The record does not fit the robot, or the window is empty.
    """
    robot = estimate.model.robot
    settings = _settings(estimate, record, start_s, stop_s)
    signals = uniform_signals(record, robot, settings)
    own = max(settings.cutoff_hz or 0.0, default_cutoff(signals.q, signals.rate_hz))
    settings = replace(settings, cutoff_hz=own)
    samples = samples_at_stamps(record, robot, settings)
    result = validate_samples(estimate, samples)
    found = (
        *another_payload(estimate, samples, result.measured - result.predicted),
        *_seen_before(estimate, record, start_s, stop_s),
        *_another_robot(estimate, record),
        *result.warnings,
    )
    return replace(result, warnings=found)


def reproduce(
    estimate: Estimate,
    record: ExperimentRecord,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
) -> ValidationResult:
    """As `validate`, for the record that was identified from: the training errors."""
    return validate_samples(estimate, samples_of(estimate, record, start_s=start_s, stop_s=stop_s))


def samples_of(
    estimate: Estimate,
    record: ExperimentRecord,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
) -> Samples:
    """A record's samples at its own stamps, processed as an estimate's were, nothing averaged."""
    settings = _settings(estimate, record, start_s, stop_s)
    return samples_at_stamps(record, estimate.model.robot, settings)


def _settings(
    estimate: Estimate, record: ExperimentRecord, start_s: float | None, stop_s: float | None
) -> ProcessingSettings:
    settings = replace(
        estimate.settings, start_s=start_s, stop_s=stop_s, decimate=False, period_s=None
    )
    if "qd" not in record.signals:
        settings = replace(settings, velocity="position")
    robot = estimate.model.robot
    if settings.torque_filter and not was_smoothed(uniform_signals(record, robot, settings)):
        # This record shows what the other had lost.
        settings = replace(settings, torque_filter=None)
    return settings


def _seen_before(
    estimate: Estimate, record: ExperimentRecord, start_s: float | None, stop_s: float | None
) -> tuple[Notice, ...]:
    if identity(record) not in estimate.provenance.inputs.values():
        return ()
    used = estimate.settings
    first = max(start_s or 0.0, used.start_s or 0.0)
    last = min(
        record.duration_s if stop_s is None else stop_s,
        record.duration_s if used.stop_s is None else used.stop_s,
    )
    if last - first < OVERLAP_S:
        return ()
    return (
        Notice(
            "over_fitted",
            f"{first:.1f} to {last:.1f} s of the validation window are {SAME_RECORD}: the error "
            "says nothing about another motion",
        ),
    )


def _another_robot(estimate: Estimate, record: ExperimentRecord) -> tuple[Notice, ...]:
    names, known = record.metadata.robot, estimate.model.robot.name
    builtin = names is not None and names.isalnum()
    if names is None or not builtin or names == known:
        return ()
    return (Notice("extrapolated", f"the record says robot {names}, the estimate is of {known}"),)


def validate_samples(estimate: Estimate, samples: Samples) -> ValidationResult:
    """Compare predicted and measured torques of samples; see `validate`."""
    state = motion_state(estimate.model, samples)
    model = estimate.predict(samples.q, samples.dq, samples.ddq, state)
    rows = samples.rows
    predicted = read_only(samples.as_recorded(model.T).T[rows])
    measured, dq = samples.tau[rows], samples.dq[rows]
    moving = np.abs(dq) > MOVING_SPEED
    return ValidationResult(
        t=samples.t[rows],
        dq=dq,
        measured=measured,
        predicted=predicted,
        metrics=metrics(measured, predicted),
        moving=metrics(measured, predicted, moving),
        at_rest=metrics(measured, predicted, ~moving),
        residual_autocorrelation=autocorrelation((measured - predicted).T, 1),
        warnings=(*_extrapolated(estimate, samples), *_at_rest(estimate, moving)),
    )


def _extrapolated(estimate: Estimate, samples: Samples) -> tuple[Notice, ...]:
    known = estimate.motion
    names = estimate.model.robot.joint_names
    found: list[str] = []
    for values, limit, what in (
        (samples.dq, known.speed, "speed"),
        (samples.ddq, known.acceleration, "acceleration"),
    ):
        reached = np.percentile(np.abs(values), 99.5, axis=0)
        for j in np.flatnonzero(reached > EXTRAPOLATION * limit):
            found.append(f"{names[j]} {what} {reached[j]:.2g} against {limit[j]:.2g}")
    margin = (EXTRAPOLATION - 1) * (known.upper - known.lower)
    low, high = np.percentile(samples.q, [0.25, 99.75], axis=0)
    for j in np.flatnonzero((low < known.lower - margin) | (high > known.upper + margin)):
        found.append(
            f"{names[j]} position {low[j]:.2g} to {high[j]:.2g} against "
            f"{known.lower[j]:.2g} to {known.upper[j]:.2g}"
        )
    if not found:
        return ()
    return (
        Notice(
            "extrapolated",
            "this record goes beyond the identification's: " + "; ".join(found[:4]),
        ),
    )


def _at_rest(estimate: Estimate, moving: Mask) -> tuple[Notice, ...]:
    share = 1 - moving.mean(axis=0)
    worst = int(np.argmax(share))
    if share.mean() <= REST_SHARE:
        return ()
    return (
        Notice(
            "at_rest",
            f"{100 * share.mean():.0f} % of the joint samples are at rest (most: "
            f"{estimate.model.robot.joint_names[worst]}, {100 * share[worst]:.0f} %): friction "
            "hides the torque there, judge by the moving samples",
        ),
    )
