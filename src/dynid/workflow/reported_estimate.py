"""An estimate as the report shows it: beside its record, and beside what confirms it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.identification.estimate import Estimate
from dynid.recording.identity import identity
from dynid.recording.record import ExperimentRecord
from dynid.reduction.base import reduce_model
from dynid.report.contents import ReportedEstimate
from dynid.signals.process import process
from dynid.validation.prediction import ValidationResult, reproduce, validate
from dynid.workflow.identify import Identification, over_fitted
from dynid.workflow.verdict import verdict

SHORTEST_REST_S = 2.0
"""A shorter stretch of a record, left out by `--from` or `--to`, confirms nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Partner:
    """A motion that an estimate was not identified from."""

    name: str
    record: ExperimentRecord
    start_s: float | None = None
    stop_s: float | None = None


def reported_estimate(
    name: str, estimate: Estimate, records: Mapping[str, ExperimentRecord]
) -> ReportedEstimate:
    """Predict an estimate's own record and another motion, and judge it by them.

    Args:
        name: What the report calls it.
        estimate: The estimate; it knows its record by its hash.
        records: All recordings at hand, by name.

    Raises:
        InputError: A record that cannot be predicted.
    """
    inputs = set(estimate.provenance.inputs.values())
    own = {key: record for key, record in records.items() if identity(record) in inputs}
    training = validation = None
    warnings = estimate.warnings
    item = ReportedEstimate(
        name=name,
        estimate=estimate,
        level="care",
        headline="Use this result with care: its recording is not at hand.",
        warnings=warnings,
        base=reduce_model(estimate.model),
    )
    for key, record in own.items():
        settings = estimate.settings
        training = reproduce(estimate, record, start_s=settings.start_s, stop_s=settings.stop_s)
        item = _with_spectrum(replace(item, training=training, training_name=key), record)
        break
    partner = _partner(estimate, own, records)
    if partner is not None:
        validation = validate(
            estimate, partner.record, start_s=partner.start_s, stop_s=partner.stop_s
        )
        item = replace(
            item,
            validation=validation,
            validation_name=partner.name,
            temperature=_temperature(partner, validation),
        )
        warnings = (*warnings, *validation.warnings)
    if training is not None and validation is not None:
        warnings = (*warnings, *over_fitted(training, validation))
    warnings = tuple(dict.fromkeys(warnings))
    item = replace(item, warnings=warnings)
    judged = training or validation
    if judged is None:
        return item
    found = verdict(
        Identification(estimate=estimate, training=judged, validation=validation, warnings=warnings)
    )
    return replace(item, level=found.level, headline=found.headline)


def _partner(
    estimate: Estimate,
    own: Mapping[str, ExperimentRecord],
    records: Mapping[str, ExperimentRecord],
) -> _Partner | None:
    """The likeliest other record: as warm, named so, else the first; or the rest of its own."""
    robot = estimate.model.robot
    others = [
        key
        for key, record in records.items()
        if key not in own
        and record.joints == robot.joints
        and _may_be(record.metadata.robot, robot.name)
    ]
    thermal = {record.metadata.extra.get("thermal") for record in own.values()}
    for key in sorted(
        others,
        key=lambda key: (
            records[key].metadata.extra.get("thermal") not in thermal,
            "valid" not in key,
            key,
        ),
    ):
        return _Partner(name=key, record=records[key])
    for key, record in own.items():
        return _rest(estimate, key, record)
    return None


def _rest(estimate: Estimate, name: str, record: ExperimentRecord) -> _Partner | None:
    """The longer stretch of its record that an estimate was not identified from, if any."""
    start, stop = estimate.settings.start_s, estimate.settings.stop_s
    before = start or 0.0
    after = 0.0 if stop is None else float(record.t[-1] - record.t[0]) - stop
    if max(before, after) < SHORTEST_REST_S:
        return None
    if before > after:
        return _Partner(name=f"{name} up to {before:g} s", record=record, stop_s=start)
    return _Partner(name=f"{name} from {stop:g} s on", record=record, start_s=stop)


def _may_be(recorded: str | None, name: str) -> bool:
    """Whether a recording can be of the robot: a path says less than a built-in name."""
    return recorded is None or recorded == name or not recorded.isalnum()


def _with_spectrum(item: ReportedEstimate, record: ExperimentRecord) -> ReportedEstimate:
    estimate = item.estimate
    settings = replace(estimate.settings, decimate=False)
    samples = process(record, estimate.model.robot, settings)
    return replace(item, positions=samples.q, rate_hz=samples.rate_hz, cutoff_hz=samples.cutoff_hz)


def _temperature(partner: _Partner, result: ValidationResult) -> Array | None:
    record = partner.record
    known = record.signals.get("temperature")
    if known is None:
        return None
    # Times of a prediction count from the start of its window.
    stamps: Array = record.t - record.t[0] - (partner.start_s or 0.0)
    values: Array = known.mean(axis=1)
    return np.asarray(np.interp(result.t, stamps, values), dtype=np.float64)
