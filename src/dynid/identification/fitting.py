"""From samples to an estimate: fit, statistics, conditioning, findings.

The estimators by their words.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dynid.core import Array, InputError, Provenance
from dynid.identification.bayesian import BayesianRegression
from dynid.identification.diagnostics import diagnose
from dynid.identification.estimate import Estimate, MotionRange, StandardParameters
from dynid.identification.instrumental import InstrumentalVariables, OutputError
from dynid.identification.least_squares import (
    Estimator,
    Fit,
    HuberRegression,
    OrdinaryLeastSquares,
    RecursiveLeastSquares,
    TotalLeastSquares,
    WeightedLeastSquares,
    autocorrelation,
)
from dynid.identification.likelihood import MaximumLikelihood
from dynid.identification.physical import PhysicallyConsistent
from dynid.identification.problem import (
    IdentificationProblem,
    base_mapping,
    condition_number,
    motion_condition_number,
    observation_root,
    scaled_condition_number,
)
from dynid.identification.selection import assess
from dynid.identification.statistics import (
    essential_parameters,
    hac_covariance,
    moved_by_prior,
    naive_covariance,
)
from dynid.recording import ExperimentRecord
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.signals import ProcessingSettings, Samples, uniform_signals

ESTIMATORS = ("ols", "wls", "irls", "tls", "iv", "ml", "didim", "sdp", "bayes", "rls")
"""The words of `--estimator`."""


def estimator_of(word: str, prior_gain: float | None = None) -> Estimator:
    """The estimator of a word.

    Args:
        word: One of `ESTIMATORS`.
        prior_gain: See `WeightedLeastSquares`; for those that have it.

    Raises:
        InputError: An unknown word.
    """
    makers: dict[str, Callable[[], Estimator]] = {
        "ols": OrdinaryLeastSquares,
        "wls": lambda: WeightedLeastSquares(prior_gain=prior_gain),
        "irls": lambda: HuberRegression(prior_gain=prior_gain),
        "tls": TotalLeastSquares,
        "iv": lambda: InstrumentalVariables(prior_gain=prior_gain),
        "ml": lambda: MaximumLikelihood(prior_gain=prior_gain),
        "didim": lambda: OutputError(prior_gain=prior_gain),
        "sdp": lambda: PhysicallyConsistent(prior_gain=prior_gain),
        "bayes": BayesianRegression,
        "rls": RecursiveLeastSquares,
    }
    if word not in makers:
        raise InputError("unknown", where="--estimator", value=word, limit=", ".join(ESTIMATORS))
    return makers[word]()


PRIOR_SPEAKS = 0.25
"""Prior's share from which a standard parameter counts as the prior's word."""


def fit_estimate(
    model: InverseDynamicModel,
    samples: Samples,
    estimator: Estimator,
    *,
    records: Sequence[ExperimentRecord],
    settings: ProcessingSettings,
    preset: str,
    choices: tuple[str, ...],
    made: Provenance,
    lengths: Sequence[int] = (),
    prior_weight: float = 0.0,
    near_weights: Sequence[float] = (),
) -> Estimate:
    """Fit samples and say how far the result can be trusted.

    Args:
        model: The model; its base parameters are found here.
        samples: Samples of one or more records.
        estimator: How to fit.
        records: The records, whose motions are judged for conditioning.
        settings: How the records were processed.
        preset: Name of the preset, for the file.
        choices: What was chosen, in words.
        made: Provenance of the result.
        lengths: Samples of each record, if there are several.
        prior_weight: Weight of published inertias, see `TowardPublished`.
        near_weights: Weights that score as well.

    Raises:
        InputError: Fewer torque samples than parameters.
        JobError: A singular problem.
    """
    base = reduce_model(model)
    problem = IdentificationProblem(base=base, samples=samples)
    fit = estimator.fit(problem)
    root = observation_root(problem)
    covariance = hac_covariance(fit, problem)
    if fit.standard is not None:
        # What bounds and prior moved is no noise, but as unsure: half of it may be wrong.
        moved = moved_by_prior(fit, problem)
        covariance = covariance + np.outer(moved, moved)
    estimate = Estimate(
        model=model,
        independent=base.independent,
        expressions=base.expressions,
        values=fit.values,
        covariance=covariance,
        naive_std=np.sqrt(np.diag(naive_covariance(fit))),
        noise=fit.noise,
        condition_number=condition_number(root),
        scaled_condition_number=scaled_condition_number(root, base_mapping(base)),
        motion_condition_number=motion_condition_number(
            model.robot,
            model.frames,
            [uniform_signals(record, model.robot, settings) for record in records],
            settings,
        ),
        samples=problem.blocks,
        estimator=estimator.name,
        preset=preset,
        settings=replace(settings, cutoff_hz=samples.cutoff_hz),
        essential=essential_parameters(fit),
        motion=motion_range(samples),
        choices=(*choices, *fit.choices),
        provenance=made,
        residual_autocorrelation=autocorrelation(problem.residual(fit.values), 1),
        standard=_standard(fit, covariance),
        assessment=assess(
            problem,
            fit,
            prior_weight=prior_weight,
            near_weights=near_weights,
            lengths=lengths,
        ),
    )
    return replace(estimate, warnings=diagnose(estimate, samples))


def _standard(fit: Fit, covariance: Array) -> StandardParameters | None:
    if fit.standard is None:
        return None
    found = fit.standard
    variance = np.einsum("pr,rs,ps->p", found.gain, covariance, found.gain)
    return StandardParameters(
        values=found.values,
        std=np.sqrt(np.maximum(variance, 0.0)),
        prior_share=found.prior_share,
        prior=found.prior,
        origins=tuple("prior" if share > PRIOR_SPEAKS else "data" for share in found.prior_share),
    )


def motion_range(samples: Samples) -> MotionRange:
    """What samples cover."""
    return MotionRange(
        lower=samples.q.min(axis=0),
        upper=samples.q.max(axis=0),
        speed=np.abs(samples.dq).max(axis=0),
        acceleration=np.percentile(np.abs(samples.ddq), 99.5, axis=0),
    )
