"""Estimates of several records at once: one a record, with the shared inertias in each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.core.provenance import Provenance
from dynid.identification.conditioning import (
    base_mapping,
    condition_number,
    motion_condition_number,
    observation_root,
    scaled_condition_number,
)
from dynid.identification.diagnostics import diagnose
from dynid.identification.estimate import Estimate
from dynid.identification.fitting import motion_range
from dynid.identification.least_squares import Fit, autocorrelation
from dynid.identification.shared import SharedProblem
from dynid.identification.shared_fit import SharedFit
from dynid.identification.statistics import essential_parameters
from dynid.recording.record import ExperimentRecord
from dynid.signals.process import uniform_signals
from dynid.signals.samples import ProcessingSettings

ESTIMATOR = "wls, shared"


def base_order(problem: SharedProblem, fit: SharedFit, record: int) -> list[int]:
    """(r) where the base parameters of a record stand in the covariance."""
    places = fit.places(record)
    order = [0] * problem.problems[0].base.rank
    for column, base in enumerate((*problem.own, *problem.common)):
        order[base] = places[column]
    return order


def shared_estimates(
    problem: SharedProblem,
    fit: SharedFit,
    *,
    records: Sequence[ExperimentRecord],
    settings: Sequence[ProcessingSettings],
    preset: str,
    choices: tuple[str, ...],
    made: Provenance,
) -> tuple[Estimate, ...]:
    """One estimate a record, all with the same inertias.

    Args:
        problem: The records' samples.
        fit: Their fit.
        records: The records, whose motions are judged for conditioning.
        settings: How each was processed.
        preset: Name of the preset, for the file.
        choices: What was chosen, in words.
        made: Provenance of the result.
    """
    return tuple(
        _estimate(problem, fit, k, record, used, preset, choices, made)
        for k, (record, used) in enumerate(zip(records, settings, strict=True))
    )


def _estimate(
    problem: SharedProblem,
    fit: SharedFit,
    record: int,
    recorded: ExperimentRecord,
    settings: ProcessingSettings,
    preset: str,
    choices: tuple[str, ...],
    made: Provenance,
) -> Estimate:
    item = problem.problems[record]
    order = base_order(problem, fit, record)
    flat = np.concatenate([fit.solution.own.ravel(), fit.solution.shared])
    values, naive = flat[order], fit.naive[np.ix_(order, order)]
    noise = fit.noise[record]
    scale = np.sqrt(np.diag(naive))
    precision = np.linalg.inv(naive / np.outer(scale, scale)) / np.outer(scale, scale)
    plain = Fit(
        values=values,
        noise=noise,
        weights=1.0 / noise,
        information=np.asarray(
            np.linalg.cholesky((precision + precision.T) / 2).T, dtype=np.float64
        ),
    )
    root = observation_root(item)
    model = item.base.model
    estimate = Estimate(
        model=model,
        independent=item.base.independent,
        expressions=item.base.expressions,
        values=values,
        covariance=fit.covariance[np.ix_(order, order)],
        naive_std=scale,
        noise=noise,
        condition_number=condition_number(root),
        scaled_condition_number=scaled_condition_number(root, base_mapping(item.base)),
        motion_condition_number=motion_condition_number(
            model.robot, model.frames, uniform_signals(recorded, model.robot, settings), settings
        ),
        samples=item.blocks,
        estimator=ESTIMATOR,
        preset=preset,
        settings=replace(settings, cutoff_hz=item.samples.cutoff_hz),
        essential=essential_parameters(plain),
        motion=motion_range(item.samples),
        choices=(*choices, f"inertias shared by {len(problem.problems)} records"),
        provenance=made,
        residual_autocorrelation=autocorrelation(item.residual(values), 1),
    )
    return replace(estimate, warnings=diagnose(estimate, item.samples))
