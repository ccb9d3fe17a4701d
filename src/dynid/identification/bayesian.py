"""Bayesian estimation: published inertias as a prior, completed where unpublished."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynid import reduction, regressor
from dynid.core import Array, Mask, inverse_upper, upper_triangle
from dynid.identification import least_squares, statistics
from dynid.identification.problem import IdentificationProblem, base_mapping, joint_factors
from dynid.robot import RobotModel, from_pseudo_inertia, move, to_pseudo_inertia

THICKNESS = 0.1
"""Diameter of a body of unknown shape, over the arm's reach."""
UNKNOWN_REACH_M = 0.5
"""Reach of an arm whose length nothing tells [m]."""
DENSITY = 1500.0
"""Of a body of unknown mass: aluminium housings, motors and gears, not solid [kg/m^3]."""
THINNEST = 0.1
"""Smallest radius of gyration over that diameter: flatter published bodies are made thicker."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialPrior:
    """Ten parameters a link that belong to real bodies."""

    parameters: Array
    """(n, 10) m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy in the parameter frames."""
    completed: tuple[str, ...] = ()
    """What was not published and how it was filled, in words."""


def link_ends(robot: RobotModel) -> Array:
    """(n, 3) each link's next joint, or flange, in the frame of its own joint [m].

    An unpublished last link that ends at its joint in the robot file is as long as the longest:
    gravity needs a lever.
    """
    ends = np.vstack([robot.placements[1:, :3, 3], robot.flange[:3, 3]])
    if not (robot.published[-1] or ends[-1].any()):
        ends[-1, 0] = np.linalg.norm(ends, axis=1).max() or UNKNOWN_REACH_M
    return ends


def reach(ends: Array) -> float:
    """Length of an arm of links with `link_ends` (n, 3) [m]."""
    return float(np.linalg.norm(ends, axis=1).sum()) or UNKNOWN_REACH_M


def inertial_prior(robot: RobotModel, frames: str) -> InertialPrior:
    """The published inertias of a robot; missing ones are those of uniform bodies.

    A body without a published tensor is a uniform rod along its link, as thick as a tenth of the
    arm's reach; one without a centre has it half way; one without a mass gets that rod's volume
    at `DENSITY`. A published tensor that no body can have is rounded to one that can.
    """
    ends = link_ends(robot)
    thick = THICKNESS * max(reach(ends), 1e-3)
    inverses = np.asarray(np.linalg.inv(robot.parameter_frames[frames]), dtype=np.float64)
    rows: list[Array] = []
    missing: dict[str, list[str]] = {}
    for i, (known, end) in enumerate(zip(robot.inertias, ends, strict=True)):
        row, words = _completed(np.array(known), end, thick)
        rows.append(move(row, inverses[i]))
        for word in words:
            missing.setdefault(word, []).append(str(i + 1))
    completed = tuple(f"{word} of links {', '.join(ids)}" for word, ids in missing.items())
    return InertialPrior(parameters=np.array(rows), completed=completed)


def _completed(known: Array, end: Array, thick: float) -> tuple[Array, list[str]]:
    words: list[str] = []
    length = float(np.linalg.norm(end))
    mass, first = float(known[0]), known[1:4]
    if not mass > 0:
        words.append("a uniform rod for the mass")
        mass = DENSITY * np.pi / 4 * thick**2 * (length + thick)
        first = mass * end / 2
    elif np.isnan(first).any():
        words.append("the middle of the link for the centre of mass")
        first = mass * end / 2
    centre = first / mass
    direction = end / length if length > 0 else np.zeros(3)
    rod = np.eye(3) * thick**2 / 16 + np.outer(direction, direction) * length**2 / 12
    spread = rod
    if np.isnan(known[4:]).any() or words:
        words.append("a uniform rod for the inertia tensor")
    else:
        second = to_pseudo_inertia(known)[:3, :3] / mass - np.outer(centre, centre)
        values, vectors = np.linalg.eigh(second)
        least = (THINNEST * thick) ** 2
        if values[0] < least:
            words.append("a thicker body for the inertia tensor")
        spread = (vectors * np.maximum(values, least)) @ vectors.T
    pseudo = np.empty((4, 4))
    pseudo[:3, :3] = mass * (spread + np.outer(centre, centre))
    pseudo[:3, 3] = pseudo[3, :3] = first
    pseudo[3, 3] = mass
    return from_pseudo_inertia(pseudo), words


def _orthonormal() -> Array:
    basis = np.zeros((10, 4, 4))
    rows, columns = np.tril_indices(4)
    count = np.arange(10)
    basis[count, rows, columns] = np.where(rows == columns, 1.0, np.sqrt(0.5))
    basis[count, columns, rows] = basis[count, rows, columns]
    return basis


ORTHONORMAL = _orthonormal()
"""(10, 4, 4) symmetric matrices, orthonormal by the trace of products."""


def metric_moves(pseudo: Array, basis: Array = ORTHONORMAL) -> Array:
    """(10 n, 10 n) moves of bodies: with J = L L' those by L E L', E of the basis (10, 4, 4).

    Those of the orthonormal basis are the units of the pseudo-inertias' own metric at J (n, 4, 4).
    """
    out = np.zeros((10 * len(pseudo), 10 * len(pseudo)))
    for i, root in enumerate(np.linalg.cholesky(pseudo)):
        here = slice(10 * i, 10 * i + 10)
        out[here, here] = from_pseudo_inertia(root @ basis @ root.T).T
    return out


NOT_NEGATIVE = ("Fc", "Fv", "Fr", "Fl", "Fw", "Im", "Fcm", "Fvm", "Imm")
"""Parameters that only take energy away, or store it."""


def symbol_of(name: str) -> str:
    """The symbol of a parameter without its joint."""
    return name.rstrip("0123456789")


def not_negative(model: regressor.InverseDynamicModel) -> Mask:
    """(p) whether each standard parameter only takes energy away or stores it."""
    return np.array([symbol_of(name) in NOT_NEGATIVE for name in model.names])


MASS_SPREAD, CENTRE_SPREAD_M, TENSOR_SPREAD = 0.058, 0.0058, 0.17
"""Standard deviations of real links about published inertias (share, m, share): masses are off
by up to 10 %, centres by up to 10 mm, tensors by up to 30 %."""


def deviations(robot: RobotModel, frames: str) -> Array:
    """(10 n, 10 n) moves of published inertias, each by one standard deviation.

    A published mass, centre and tensor are off as those of real links are. A tensor that was
    completed, or a whole body whose mass was, is off by its unit in the pseudo-inertias' metric.
    """
    given = inertial_prior(robot, frames).parameters
    out = np.zeros((given.size, given.size))
    places = robot.parameter_frames[frames]
    for i, row in enumerate(given):
        published, mass, centre = robot.inertias[i], row[0], row[1:4] / row[0]
        pseudo = to_pseudo_inertia(row)
        if not robot.published[i]:
            body = np.linalg.cholesky(pseudo)
            moves = COMPLETED * (body @ ORTHONORMAL @ body.T)
        else:
            theirs = np.allclose(move(row, places[i]), published)
            second = pseudo[:3, :3] - mass * np.outer(centre, centre)
            shape = np.asarray(np.linalg.cholesky(second), dtype=np.float64)
            moves = np.zeros((10, 4, 4))
            moves[:6, :3, :3] = shape @ ORTHONORMAL[:6, :3, :3] @ shape.T
            moves[:6] *= TENSOR_SPREAD if theirs else COMPLETED
            arm = np.append(centre, 1.0)
            shifts = CENTRE_SPREAD_M * mass * np.eye(3, 4)[:, :, None] * arm
            moves[6:9] = shifts + shifts.transpose(0, 2, 1)
            moves[9] = MASS_SPREAD * mass * np.outer(arm, arm)
        here = slice(10 * i, 10 * i + 10)
        out[here, here] = from_pseudo_inertia(moves).T
    return out


RELATIVE = 0.3
"""Standard deviation of a published pseudo-inertia in its own metric: 30 %."""
COMPLETED = 1.0
"""The same for one with a completed part."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedPrior:
    """Published inertias as a prior on base parameters, friction and motor inertia left free.

    The precision is that of the pseudo-inertias' own metric (Lee, Wensing and Park 2020) with a
    standard deviation of one, taken over what friction and motor inertias do not reach: a base
    parameter in which a motor inertia hides is shrunk in its other directions alone.
    """

    mean: Array
    """(r) base parameters of the published inertias, without friction and motor inertia."""
    root: Array
    """(k, r) root of the precision, root' root."""
    free: Array
    """(r, f) what friction and motor inertias add to the base parameters."""
    published: bool
    """Whether the masses are published; False for plausible bodies."""
    pull: Array
    """(r, 10 n) precision times base parameters of `deviations`."""

    @property
    def precision(self) -> Array:
        """(r, r) inverse covariance at a unit deviation."""
        return self.root.T @ self.root


def published_prior(base: reduction.BaseParametrization) -> PublishedPrior:
    """The prior of a model's base parameters."""
    model = base.model
    given = inertial_prior(model.robot, model.frames)
    inertial, mapping = 10 * model.robot.joints, base_mapping(base)
    spread = metric_moves(to_pseudo_inertia(given.parameters))
    scale = np.linalg.norm(mapping[:, :inertial] @ spread, axis=1)
    # Friction has its own unit: what rounding of a geometry adds to its rows is none.
    scale = np.where(np.array(base.independent) < inertial, scale, 1.0)
    free = mapping[:, inertial:]
    left, values, _ = np.linalg.svd(free / scale[:, None])
    rank = int((values > 1e-9 * values.max(initial=0.0)).sum())
    # What no friction or motor inertia can change.
    rest = left[:, rank:] / scale[:, None]
    triangle = upper_triangle((rest.T @ mapping[:, :inertial] @ spread).T)
    root = inverse_upper(triangle).T @ rest.T
    off = deviations(model.robot, model.frames)
    return PublishedPrior(
        mean=mapping[:, :inertial] @ given.parameters.ravel(),
        root=root,
        free=left[:, :rank] * scale[:, None],
        published=bool(np.nan_to_num(model.robot.inertias)[:, 0].any()),
        pull=root.T @ (root @ mapping[:, :inertial] @ off),
    )


@dataclass(frozen=True, kw_only=True)
class TowardPublished(least_squares.Estimator):
    """Weighted least squares, inertias shrunk toward the published ones.

    The weight of the prior is over the number of rows of a joint: at 1, a body that is off by
    its whole metric unit costs as much as doubling every residual. Deviations carry what the
    shrinkage leaves of errors of the published inertias.
    """

    name: ClassVar[str] = "bayes"
    by_factors: ClassVar[bool] = True
    weight: float
    """Of the prior, over the rows of a joint."""
    groups: tuple[int, ...] | None = None
    """See `WeightedLeastSquares`."""

    def fit(self, problem: IdentificationProblem) -> least_squares.Fit:
        """See `Estimator`."""
        factors = joint_factors(problem)
        known = published_prior(problem.base)
        word = "the published ones" if known.published else "plausible bodies"
        strength = self.weight * problem.blocks
        root, pull = np.sqrt(strength) * known.root, strength * known.pull
        fit = least_squares.reweighted(
            problem,
            factors,
            self.groups,
            lambda weights: posterior(
                factors, weights, problem.base, known.mean, root, least_squares.PRIOR_GAIN
            ),
        )
        return replace(
            fit,
            # The bodies are off by what real ones are, not by what the weight would say.
            score_covariance=pull @ pull.T,
            prior_strength=strength,
            choices=(f"inertias toward {word} with weight {self.weight:.2g}",),
        )


@dataclass(frozen=True, kw_only=True)
class BayesianRegression(least_squares.Estimator):
    """Gaussian prior on inertial parameters, Gaussian likelihood, both exact.

    The prior's covariance is the inverse of the pseudo-inertia metric at the published values, see
    `PublishedPrior`, so that no choice of frames or units matters; that of plausible bodies is as
    wide as the torques make likely. Residuals of robots are
    correlated: the likelihood is tempered by how much that inflates variances, otherwise the
    posterior would claim too much.
    """

    name: ClassVar[str] = "bayes"

    def fit(self, problem: IdentificationProblem) -> least_squares.Fit:
        """See `Estimator`."""
        model = problem.base.model
        plain = least_squares.WeightedLeastSquares(prior_gain=1.0).fit(problem)
        completed = inertial_prior(model.robot, model.frames).completed
        relative = COMPLETED if completed else RELATIVE
        # Of the torques: variances of base parameters depend on how link frames lie.
        scores = statistics.hac_covariance(plain, problem)
        torques = plain.information @ scores @ plain.information.T
        level = float(np.mean(np.square(plain.noise * plain.weights)))
        inflation = float(np.trace(torques)) / len(torques) / level
        factors = joint_factors(problem)
        tempered = plain.weights / np.sqrt(max(inflation, 1.0))
        known = published_prior(problem.base)
        root = known.root / relative
        if not known.published:
            scale = likely_scale(factors, tempered, known.mean, root)
            relative, root = scale * relative, root / scale
        values, information = posterior(factors, tempered, problem.base, known.mean, root)
        return replace(
            plain,
            values=values,
            weights=tempered,
            noise=least_squares.residual_noise(factors, values, problem),
            information=information,
            score_covariance=root.T @ root,
            prior_strength=relative**-2,
            choices=(
                f"prior of {100 * relative:g} % on published inertias",
                f"likelihood tempered by {inflation:.2g} for correlated residuals",
            ),
        )


SCALES = np.geomspace(1.0, 1e8, 241)
"""Of `likely_scale`, among which it chooses."""


def likely_scale(factors: Array, weights: Array, mean: Array, root: Array) -> float:
    """The factor on the prior's deviations, 1 or more, by which the torques are most likely.

    How far plausible bodies are from an arm's own, nothing but its torques can tell (type II
    maximum likelihood). Arguments as of `posterior`.
    """
    triangle = upper_triangle((factors * weights[:, None, None]).reshape(-1, len(mean) + 1))
    data, target = triangle[:-1, :-1], triangle[:-1, -1]
    _, sizes, turn = np.linalg.svd(root)
    # What the prior leaves free is fitted whatever its scale.
    taken, values, _ = np.linalg.svd(data @ turn[len(root) :].T)
    rest = taken[:, int((values > 1e-12 * values.max(initial=0.0)).sum()) :].T
    turned, gains, _ = np.linalg.svd(rest @ data @ (turn[: len(root)].T / sizes))
    shown = np.square(turned.T @ rest @ (target - data @ mean))[: len(gains)]
    variance = 1.0 + np.square(SCALES[:, None] * gains)
    return float(SCALES[np.argmin((shown / variance + np.log(variance)).sum(axis=1))])


def posterior(
    factors: Array,
    weights: Array,
    base: reduction.BaseParametrization,
    mean: Array,
    root: Array,
    prior_gain: float | None = None,
) -> tuple[Array, Array]:
    """Mean (r) of the posterior and the root (r, r) of its precision.

    From factors (n, r + 1, r + 1) of `joint_factors`, weights (n), the prior's mean (r) and a root
    (k, r) of its precision; a weak prior on what neither of them shows, see `PRIOR_GAIN`.
    """
    prior = np.column_stack([root, root @ mean])
    return least_squares.solve(factors, weights, base, prior_gain, prior)
