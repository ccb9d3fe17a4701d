"""From samples to an estimate: fit, statistics, conditioning, findings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynid.core import Array, Indices, Provenance
from dynid.identification import least_squares, statistics
from dynid.identification.bayesian import BayesianRegression
from dynid.identification.diagnostics import diagnose
from dynid.identification.estimate import Estimate, StandardParameters
from dynid.identification.instrumental import InstrumentalVariables, OutputError
from dynid.identification.likelihood import MaximumLikelihood
from dynid.identification.physical import PhysicallyConsistent
from dynid.identification.problem import (
    IdentificationProblem,
    SummedProblem,
    base_mapping,
    condition_number,
    motion_condition_number,
    observation_root,
    scaled_condition_number,
)
from dynid.identification.selection.assessment import LeftOutCells, assess
from dynid.identification.selection.regions import BLOCKS, find_regions
from dynid.identification.selection.unseen import MotionRange
from dynid.identification.sums import PassPlan, RowSums, no_sums
from dynid.recording import ExperimentRecord
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.signals import ProcessingSettings, Samples, uniform_signals

_MAKERS: dict[str, Callable[[float | None], least_squares.Estimator]] = {
    "ols": lambda _: least_squares.OrdinaryLeastSquares(),
    "wls": lambda gain: least_squares.WeightedLeastSquares(prior_gain=gain),
    "irls": lambda gain: least_squares.HuberRegression(prior_gain=gain),
    "tls": lambda _: least_squares.TotalLeastSquares(),
    "iv": lambda gain: InstrumentalVariables(prior_gain=gain),
    "ml": lambda gain: MaximumLikelihood(prior_gain=gain),
    "didim": lambda gain: OutputError(prior_gain=gain),
    "sdp": lambda gain: PhysicallyConsistent(prior_gain=gain),
    "bayes": lambda _: BayesianRegression(),
    "rls": lambda _: least_squares.RecursiveLeastSquares(),
}
ESTIMATORS = tuple(_MAKERS)
"""The words of `--estimator`."""


def estimator_of(word: str, prior_gain: float | None = None) -> least_squares.Estimator:
    """The estimator of a word of `ESTIMATORS`; see `WeightedLeastSquares` for the gain."""
    return _MAKERS[word](prior_gain)


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimateSource:
    """What an estimate is made of."""

    records: Sequence[ExperimentRecord]
    """Recordings whose motions are judged for conditioning."""
    settings: ProcessingSettings
    """How they were processed."""
    preset: str
    """Name of the preset, for the file."""
    choices: tuple[str, ...]
    """What was chosen, in words."""
    made: Provenance
    """Provenance of the result."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparedFit:
    """Samples, and what they are to be fitted with."""

    model: InverseDynamicModel
    """Its base parameters are found by the fit."""
    samples: Samples
    """Samples of one or more records."""
    lengths: tuple[int, ...]
    """Samples of each recording."""
    estimator: least_squares.Estimator
    source: EstimateSource
    near_weights: tuple[float, ...]
    """Of the published inertias, as chosen by what is left out; empty with the preset `paper`."""


COARSEST = 1e3
"""Condition number, columns scaled, up to which products do instead of factors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AllRows:
    """All rows of recordings, summed in one pass that a fit to a part of them has planned."""

    plan: PassPlan
    parts: Indices
    """(N) what each row of the part is left out with."""
    floor: Array | None
    """(r, r) root of the covariance by a model of the noise, times the rows; None without one."""
    sums: RowSums

    def problem(self, part: IdentificationProblem) -> SummedProblem:
        """The problem of all rows, of which a part is at hand."""
        return SummedProblem(
            base=part.base,
            samples=part.samples,
            factors=self.sums.joint_factors(),
            rows=self.sums.rows,
        )

    @property
    def autocorrelation(self) -> Array:
        """(n) of the residuals at one row."""
        total, squares, products = self.sums.moments / self.sums.rows
        energy = np.maximum(squares - total**2, 1e-300)
        return np.asarray((products - total**2) / energy, dtype=np.float64)

    @property
    def cells(self) -> LeftOutCells:
        """What is left out."""
        blocks, keys = self.sums.blocks()
        return LeftOutCells(blocks=blocks, keys=keys, parts=self.parts)

    def covariance(self, fit: least_squares.Fit) -> Array:
        """(r, r) covariance of a fit to all rows.

        The scores are those of the part's fit, so its weights stand in the bread as well.
        """
        plan, rank = self.plan, len(fit.values)
        products = np.array([f.T @ f for f in self.sums.joint_factors()])[:, :rank, :rank]
        own = np.tensordot(np.square(fit.weights), products, axes=1)
        prior = fit.information.T @ fit.information - own
        matrix = np.tensordot(np.square(plan.weights), products, axes=1) + prior
        scale = np.sqrt(np.diag(matrix))
        bread = np.linalg.inv(matrix / np.outer(scale, scale)) / np.outer(scale, scale)
        bread = fit.information @ bread
        floor = None if self.floor is None else self.floor / np.sqrt(self.sums.rows)
        return statistics.sandwich(fit, bread, self.sums.long_run, self.sums.rows, plan.lag, floor)


def plan_pass(part: PreparedFit, rows: int, recordings: Indices | None = None) -> AllRows:
    """Fit a part of the rows of recordings, and plan the sums over all of them; none is added yet.

    Args:
        part: What all rows will be fitted with.
        rows: How many there will be a joint.
        recordings: (N) the recording of each sample of the part, if there are several.
    """
    samples, base = part.samples, reduce_model(part.model)
    problem = IdentificationProblem(base=base, samples=samples)
    fit = part.estimator.checked_fit(problem)
    residual = problem.residual(fit.values)
    floor = None
    if least_squares.autocorrelation(residual, 1).max() > statistics.MODEL_CORRELATION:
        floor = statistics.ar_root(fit, problem, residual) * np.sqrt(problem.blocks)
    used = samples.rows
    every = slice(used.start, used.start + problem.blocks * samples.block, samples.block)
    if recordings is None:
        regions = find_regions([samples.q[every]], part.model.robot.prismatic)
        parts = regions.labels(samples.q[every], 0)
    else:
        regions, parts = None, recordings[every]
    columns = fit.information / np.linalg.norm(fit.information, axis=0)
    plan = PassPlan(
        base=base,
        values=fit.values,
        weights=fit.weights,
        lag=statistics.correlation_lag(residual, problem.rate_hz, rows),
        regions=regions,
        stretches=BLOCKS,
        factors=bool(np.linalg.cond(columns) > COARSEST),
    )
    return AllRows(plan=plan, parts=parts, floor=floor, sums=no_sums(samples.joints, base.rank))


PRIOR_SPEAKS = 0.25
"""Prior's share from which a standard parameter counts as the prior's word."""


def fit_estimate(prepared: PreparedFit, everything: AllRows | None = None) -> Estimate:
    """Fit samples by an estimator, and say how far the result can be trusted.

    Args:
        prepared: The samples, and what they are fitted with.
        everything: All rows of recordings of which the samples are a part: what is fitted.

    Raises:
        InputError: Fewer torque samples than parameters.
        JobError: A singular problem.
    """
    samples, source, base = prepared.samples, prepared.source, reduce_model(prepared.model)
    part = IdentificationProblem(base=base, samples=samples)
    problem, cells, sums = part, None, None
    if everything is not None:
        problem, cells, sums = everything.problem(part), everything.cells, everything.sums
    fit = prepared.estimator.checked_fit(problem)
    if everything is None:
        covariance = statistics.hac_covariance(fit, problem)
        rho = least_squares.autocorrelation(problem.residual(fit.values), 1)
    else:
        covariance, rho = everything.covariance(fit), everything.autocorrelation
    standard = None
    if fit.standard is not None:
        standard, covariance = _standard(fit.standard, covariance, base_mapping(base))
    return judged(
        problem,
        fit,
        replace(source, choices=(*source.choices, *fit.choices)),
        covariance=covariance,
        estimator=prepared.estimator.name,
        naive_std=np.sqrt(np.diag(statistics.naive_covariance(fit))),
        motion=_motion_range(samples, sums),
        residual_autocorrelation=rho,
        standard=standard,
        assessment=assess(
            part, fit, near_weights=prepared.near_weights, lengths=prepared.lengths, cells=cells
        ),
    )


def judged(
    problem: IdentificationProblem,
    fit: least_squares.Fit,
    source: EstimateSource,
    **known: Any,
) -> Estimate:
    """The estimate of a fit, with its conditioning and its findings.

    Of the other fields of `Estimate` some are `known`.
    """
    base, model, root = problem.base, problem.base.model, observation_root(problem)
    settings = source.settings
    signals = [uniform_signals(record, model.robot, settings) for record in source.records]
    known.setdefault("motion", _motion_range(problem.samples))
    estimate = Estimate(
        model=model,
        independent=base.independent,
        expressions=base.expressions,
        values=fit.values,
        noise=fit.noise,
        condition_number=condition_number(root),
        scaled_condition_number=scaled_condition_number(root, base_mapping(base)),
        motion_condition_number=motion_condition_number(
            model.robot, model.frames, signals, settings
        ),
        samples=problem.blocks,
        settings=replace(settings, cutoff_hz=problem.samples.cutoff_hz),
        essential=statistics.essential_parameters(fit),
        preset=source.preset,
        choices=source.choices,
        provenance=source.made,
        **known,
    )
    return replace(estimate, warnings=diagnose(estimate, problem.samples))


def _standard(
    found: least_squares.StandardFit, covariance: Array, mapping: Array
) -> tuple[StandardParameters, Array]:
    """Standard parameters, and the covariance (r, r) of their base parameters.

    Noise and errors of the prior both reach them through the fit's response.
    """
    # Not Cholesky's: of a motion that hardly tells parameters apart, rounding leaves some below 0.
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    spread = np.concatenate([found.gain @ root, found.pulled], axis=1)
    standard = StandardParameters(
        values=found.values,
        std=np.linalg.norm(spread, axis=1),
        prior_share=found.prior_share,
        prior=found.prior,
        origins=tuple("prior" if share > PRIOR_SPEAKS else "data" for share in found.prior_share),
    )
    return standard, (mapping @ spread) @ (mapping @ spread).T


def _motion_range(samples: Samples, sums: RowSums | None = None) -> MotionRange:
    """What samples cover, or all rows that they are a part of."""
    return MotionRange(
        lower=samples.q.min(axis=0) if sums is None else sums.lower,
        upper=samples.q.max(axis=0) if sums is None else sums.upper,
        speed=np.abs(samples.dq).max(axis=0) if sums is None else sums.speed,
        acceleration=np.percentile(np.abs(samples.ddq), 99.5, axis=0),
    )
