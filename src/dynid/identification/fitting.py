"""From samples to an estimate: fit, statistics, conditioning, findings."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynid import recording, reduction, regressor
from dynid.core import Array, Finding, Indices, Provenance
from dynid.identification import bayesian, instrumental, least_squares, physical, statistics
from dynid.identification import problem as linear
from dynid.identification.estimate import Estimate, StandardParameters
from dynid.identification.selection import assessment, regions, unseen
from dynid.identification.sums import PassPlan, RowSums, no_sums
from dynid.signals import ProcessingSettings, Samples, UniformSignals, uniform_signals

SMALL_RANGE = {False: 0.1, True: 0.02}
"""A joint that moves less hardly shows its inertia [rad; m where it slides]."""
SLOW = {False: 0.05, True: 0.01}
"""A joint that never moves faster shows no viscous friction [rad/s; m/s]."""
ONE_WAY = 0.05
"""Share of the moving samples in the rarer direction; below it, friction and gravity mix."""
UNCERTAIN_SHARE = 0.75
"""Share of parameters with more than 100 % standard deviation that makes a record poor."""
_EXCITE = "record an optimised excitation trajectory before the result is used for other motions"
CORRELATED = 0.3
"""Autocorrelation of the residuals at one sample that is worth saying."""
POSES = 200
CERTAIN = 3.0
"""Standard deviations below zero from which a value is negative beyond doubt."""


def diagnose(estimate: Estimate, samples: Samples) -> tuple[Finding, ...]:
    """Warnings about an estimate and the samples that it was fitted to."""
    return (
        *ill_conditioned(estimate, samples),
        *low_excitation(estimate, samples),
        *not_physical(estimate, samples),
        *non_white(estimate),
    )


def ill_conditioned(estimate: Estimate, samples: Samples) -> Iterator[Finding]:
    """Whether directions of the parameters are nearly invisible in the data."""
    number = estimate.motion_condition_number
    one_way = one_way_joints(samples)
    text: list[str] = []
    if number > linear.ILL_CONDITIONED:
        text.append(
            f"the condition number of the motion is {number:.3g}: errors of torque can grow by "
            f"this factor elsewhere (good motions stay below {linear.ILL_CONDITIONED:.0f})"
        )
    if 2 * len(one_way) > samples.joints:
        text.append(
            f"{len(one_way)} of {samples.joints} joints never turn back, so that friction cannot "
            "be told from gravity and only noise keeps the condition number at "
            f"{estimate.condition_number:.1e}"
        )
    if text:
        what = "; ".join(text) + ". Some combinations of parameters are poorly excited"
        yield Finding("ill_conditioned", what, severity="error", value=number, next_step=_EXCITE)


def one_way_joints(samples: Samples) -> tuple[int, ...]:
    """Joints that move in one direction only."""
    found: list[int] = []
    for j, speed in enumerate(samples.dq.T):
        moving = speed[np.abs(speed) > max(0.1 * np.abs(speed).max(), 1e-9)]
        if len(moving) and min((moving > 0).mean(), (moving < 0).mean()) < ONE_WAY:
            found.append(j)
    return tuple(found)


def low_excitation(estimate: Estimate, samples: Samples) -> Iterator[Finding]:
    """Joints that move little, slowly or one way only; too many uncertain parameters."""
    one_way = one_way_joints(samples)
    found: list[str] = []
    for j, name in enumerate(estimate.model.robot.joint_names):
        fastest, reach = float(np.abs(samples.dq[:, j]).max()), float(np.ptp(samples.q[:, j]))
        slides = estimate.model.robot.prismatic[j]
        unit = "m" if slides else "rad"
        if reach < SMALL_RANGE[slides]:
            found.append(f"{name} moves only {reach:.3f} {unit}")
        elif fastest < SLOW[slides]:
            found.append(f"{name} never exceeds {fastest:.3f} {unit}/s")
        elif j in one_way:
            found.append(f"{name} moves in one direction only")
    with np.errstate(invalid="ignore"):
        uncertain = int((estimate.relative_std_percent > 100).sum())
    if uncertain > UNCERTAIN_SHARE * len(estimate.values):
        found.append(f"{uncertain} of {len(estimate.values)} parameters have a std above 100 %")
    if found:
        what = "the motion excites too little: " + "; ".join(found[:8])
        yield Finding("low_excitation", what, severity="error", next_step=_EXCITE)


def not_physical(estimate: Estimate, samples: Samples) -> Iterator[Finding]:
    """Friction or motor inertia below zero beyond doubt, or an indefinite mass matrix."""
    found = [
        f"{name} = {value:.3g} +- {std:.2g} {unit}"
        for name, value, std, unit in zip(
            estimate.names, estimate.values, estimate.std, estimate.units, strict=True
        )
        if bayesian.symbol_of(name) in ("Fc", "Fv", "Im") and value < -CERTAIN * std
    ]
    advice = (
        "do not simulate or invert this model; --estimator sdp fits physically consistent bodies"
    )
    if found:
        text = f"significantly negative: {', '.join(found)}"
        yield Finding("negative_friction", text, next_step=advice)
    steps = [k for k, name in enumerate(estimate.names) if bayesian.symbol_of(name) == "Fc"]
    negative = [k for k in steps if estimate.values[k] < -CERTAIN * estimate.std[k]]
    if 2 * len(negative) > len(steps):
        joints = tuple(int(estimate.names[k][2:]) - 1 for k in negative)
        text = "the sign of the torques is probably reversed"
        yield Finding("reversed", text, joints=joints, value=-1.0)
    smallest, std = smallest_mass_eigenvalue(estimate, samples)
    if smallest < -CERTAIN * std:
        size = f"{smallest:.2g} +- {std:.1g}"
        text = f"the mass matrix is not positive at some poses (eigenvalue {size})"
        yield Finding("indefinite_mass", text, value=smallest, std=std, next_step=advice)


def smallest_mass_eigenvalue(estimate: Estimate, samples: Samples) -> tuple[float, float]:
    """The smallest eigenvalue of the mass matrix over poses of the record, and its deviation."""
    model = estimate.model
    q = samples.q[np.linspace(0, samples.count - 1, min(POSES, samples.count)).astype(int)]
    mass = model.mass_matrix(q, estimate.standard_parameters())
    sizes, axes = np.linalg.eigh((mass + mass.transpose(0, 2, 1)) / 2)
    worst = int(np.argmin(sizes[:, 0]))
    # The eigenvalue v' M v is linear in the parameters.
    pose, axis = q[worst : worst + 1], axes[worst, :, :1].T
    still = np.zeros_like(pose)
    moved = model.stack(pose, still, axis) - model.stack(pose, still, still)
    row = (moved[list(estimate.independent), :, 0]) @ axis[0]
    return float(sizes[worst, 0]), float(np.sqrt(max(row @ estimate.covariance @ row, 0.0)))


def non_white(estimate: Estimate) -> Iterator[Finding]:
    """Whether the residuals are correlated in time."""
    rho: Array = estimate.residual_autocorrelation
    if rho.max(initial=0.0) > CORRELATED:
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = float(np.nanmedian(estimate.std / estimate.naive_std))
        yield Finding(
            "non_white_residuals",
            f"residuals are correlated in time (up to {rho.max():.2f} from sample to sample): "
            f"the standard deviations given allow for it; naive ones would be {ratio:.1f} times "
            "smaller",
        )


_MAKERS: dict[str, Callable[[float | None], least_squares.Estimator]] = {
    "ols": lambda _: least_squares.OrdinaryLeastSquares(),
    "wls": lambda gain: least_squares.WeightedLeastSquares(prior_gain=gain),
    "irls": lambda gain: least_squares.HuberRegression(prior_gain=gain),
    "tls": lambda _: least_squares.TotalLeastSquares(),
    "iv": lambda gain: instrumental.InstrumentalVariables(prior_gain=gain),
    "ml": lambda gain: instrumental.MaximumLikelihood(prior_gain=gain),
    "didim": lambda gain: instrumental.OutputError(prior_gain=gain),
    "sdp": lambda gain: physical.PhysicallyConsistent(prior_gain=gain),
    "bayes": lambda _: bayesian.BayesianRegression(),
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

    records: Sequence[recording.ExperimentRecord]
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

    model: regressor.InverseDynamicModel
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

    def problem(self, part: linear.IdentificationProblem) -> linear.SummedProblem:
        """The problem of all rows, of which a part is at hand."""
        return linear.SummedProblem(
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
    def cells(self) -> assessment.LeftOutCells:
        """What is left out."""
        blocks, keys = self.sums.blocks()
        return assessment.LeftOutCells(blocks=blocks, keys=keys, parts=self.parts)

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


def plan_pass(part: PreparedFit, rows: int, recordings: Sequence[tuple[int, bool]] = ()) -> AllRows:
    """Fit a part of the rows of recordings, and plan the sums over all of them; none is added yet.

    Args:
        part: What all rows will be fitted with.
        rows: How many there will be a joint.
        recordings: Of each recording in the part, if all are several: which of these it is of, and
            whether it is of its later half.
    """
    samples, base = part.samples, reduction.reduce_model(part.model)
    problem = linear.IdentificationProblem(base=base, samples=samples)
    fit = part.estimator.checked_fit(problem)
    residual = problem.residual(fit.values)
    floor = None
    if least_squares.autocorrelation(residual, 1).max() > statistics.MODEL_CORRELATION:
        floor = statistics.ar_root(fit, problem, residual) * np.sqrt(problem.blocks)
    used = samples.rows
    every = slice(used.start, used.start + problem.blocks * samples.block, samples.block)
    known, halved = None, tuple[int, ...]()
    if recordings:
        (moves,) = regions.moving_rows([samples.dq[every]], problem.rate_hz)
        halved = regions.alone(_by_piece([one for one, _ in recordings], part)[every], moves)
    else:
        known = regions.find_regions([samples.q[every]], part.model.robot.prismatic)
    columns = fit.information / np.linalg.norm(fit.information, axis=0)
    plan = PassPlan(
        base=base,
        values=fit.values,
        weights=fit.weights,
        lag=statistics.correlation_lag(residual, problem.rate_hz, rows),
        regions=known,
        halved=halved,
        stretches=regions.BLOCKS,
        factors=bool(np.linalg.cond(columns) > COARSEST),
    )
    if known is not None:
        parts = known.labels(samples.q[every], 0)
    else:
        parts = _by_piece([plan.left_out_with(*one) for one in recordings], part)[every]
    return AllRows(plan=plan, parts=parts, floor=floor, sums=no_sums(samples.joints, base.rank))


def _by_piece(labels: Sequence[int], part: PreparedFit) -> Indices:
    """(N) of each sample the label of the recording that it is of."""
    return np.repeat(np.array(labels, dtype=np.intp), part.lengths)


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
    samples, source = prepared.samples, prepared.source
    base = reduction.reduce_model(prepared.model)
    part = linear.IdentificationProblem(base=base, samples=samples)
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
        standard, covariance = _standard(fit.standard, covariance, linear.base_mapping(base))
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
        assessment=assessment.assess(
            part, fit, near_weights=prepared.near_weights, lengths=prepared.lengths, cells=cells
        ),
    )


def judged(
    problem: linear.IdentificationProblem,
    fit: least_squares.Fit,
    source: EstimateSource,
    **known: Any,
) -> Estimate:
    """The estimate of a fit, with its conditioning and its findings.

    Of the other fields of `Estimate` some are `known`.
    """
    base, model, root = problem.base, problem.base.model, linear.observation_root(problem)
    settings = source.settings
    signals = [uniform_signals(record, model.robot, settings) for record in source.records]
    known.setdefault("motion", _motion_range(problem.samples))
    estimate = Estimate(
        model=model,
        independent=base.independent,
        expressions=base.expressions,
        values=fit.values,
        noise=fit.noise,
        condition_number=linear.condition_number(root),
        scaled_condition_number=linear.scaled_condition_number(root, linear.base_mapping(base)),
        motion_condition_number=_conditioning(problem, fit, signals, settings),
        samples=problem.blocks,
        settings=replace(settings, cutoff_hz=problem.samples.cutoff_hz),
        essential=statistics.essential_parameters(fit),
        preset=source.preset,
        choices=source.choices,
        provenance=source.made,
        **known,
    )
    return replace(estimate, warnings=diagnose(estimate, problem.samples))


def _conditioning(
    problem: linear.IdentificationProblem,
    fit: least_squares.Fit,
    recordings: Sequence[UniformSignals],
    settings: ProcessingSettings,
) -> float:
    """`motion_condition_number` with the published inertias, as strongly as the fit takes them."""
    model = problem.base.model
    base = reduction.reduce_model(
        regressor.InverseDynamicModel(robot=model.robot, frames=model.frames)
    )
    prior = bayesian.published_prior(base) if fit.prior_strength else None
    rows = None
    if prior is not None and prior.published:
        torque = least_squares.torque_scale(linear.joint_factors(problem), problem)
        noise = np.sqrt(np.mean(np.square(fit.noise / torque)))
        rows = noise * np.sqrt(fit.prior_strength) * prior.root
    return linear.motion_condition_number(base, recordings, settings, rows)


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


def _motion_range(samples: Samples, sums: RowSums | None = None) -> unseen.MotionRange:
    """What samples cover, or all rows that they are a part of."""
    return unseen.MotionRange(
        lower=samples.q.min(axis=0) if sums is None else sums.lower,
        upper=samples.q.max(axis=0) if sums is None else sums.upper,
        speed=np.abs(samples.dq).max(axis=0) if sums is None else sums.speed,
        acceleration=np.percentile(np.abs(samples.ddq), 99.5, axis=0),
    )
