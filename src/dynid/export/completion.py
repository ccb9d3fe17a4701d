"""From base parameters to standard ones: one member of all that give the same torques.

Motion shows the base parameters alone. Files want ten parameters a link, so what motion cannot
show is taken from the prior: of all standard parameters with the same torques, those whose bodies
are nearest to the prior's in the log-det divergence of Lee, Wensing and Park (2020), which only
physically consistent bodies have.
"""

import json
from dataclasses import dataclass

import numpy as np

from dynid.core import Array, Indices, freeze
from dynid.identification import Estimate, inertial_prior
from dynid.reduction import random_states, reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.robot import PSEUDO_INERTIA_BASIS, robot_to_json, to_pseudo_inertia

MOTOR_SYMBOLS = ("Im", "Imm")
_OTHER = 1e-6
"""Curvature of the parameters without a prior, so that a Newton step is defined."""
_POSSIBLE = 1e-5
"""Share of its prior that a body may lack before it counts as impossible: the solver's digits."""
_NAMED = 1e-3
"""Share of the largest lack from which a body is named: at a lack of 5 451 priors, consistent links
were found to lack up to 0.13 (2.4e-5) with one BLAS kernel or another, inconsistent ones 17."""
_OF_SLIDES = 1e-3
"""Share of what a slide moves that its motor's inertia is guessed to be."""
_SHOWN = 1e-9
"""Of the largest column: what rounding shows of a direction that motion does not."""
_POSES = 50
_SEED = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class PseudoInertias:
    """The links, then the motors, among the standard parameters, with their prior.

    The divergence of a link is tr(J0^-1 J) - log det(J0^-1 J) - 4 of its pseudo-inertia J to the
    prior's J0; that of a motor inertia, the same of a number, m / m0 - log(m / m0) - 1.
    """

    names: tuple[str, ...]
    """(b) what the bodies are called: numbers of links, names of motor inertias."""
    links: int
    """Number of links; the first 10 parameters a link are theirs."""
    motors: Indices
    """(b - links) columns of the motor inertias."""
    prior: Array
    """(p) inertial parameters and motor inertias of possible bodies; 0 for friction."""
    inverses: Array
    """(links, 4, 4) of the prior's pseudo-inertias."""

    @staticmethod
    def of(model: InverseDynamicModel, prior: Array) -> "PseudoInertias":
        """The bodies of a model, with inertial parameters (n, 10) of possible bodies as the prior.

        A motor's inertia is guessed to be that of the arm it drives, the mean over random poses:
        gears are chosen so that the two are alike. Of a slide it is guessed to be little: what may
        be either is mass, which every file has a place for.
        """
        n, values = model.robot.joints, np.zeros(len(model.columns))
        values[: prior.size] = prior.ravel()
        motors = [
            k
            for k, column in enumerate(model.columns)
            if k >= prior.size and column.name.rstrip("0123456789") in MOTOR_SYMBOLS
        ]
        poses, _, _ = random_states(model.robot, _POSES, _SEED)
        mass = np.diagonal(model.mass_matrix(poses, values), axis1=1, axis2=2).mean(axis=0)
        driven = np.where(model.robot.prismatic, _OF_SLIDES, 1.0) * mass
        values[motors] = driven[[model.columns[k].joint for k in motors]]
        return PseudoInertias(
            names=(*(str(i + 1) for i in range(n)), *(model.names[k] for k in motors)),
            links=n,
            motors=np.array(motors, dtype=np.intp),
            prior=values,
            inverses=np.asarray(np.linalg.inv(to_pseudo_inertia(prior)), dtype=np.float64),
        )

    def divergence(self, values: Array) -> tuple[float, Array, Array]:
        """The divergence to the prior, its gradient (p) and its second derivatives (p, p).

        Infinite, with zeros for the derivatives, where a body cannot exist.
        """
        width, n, inertial = len(values), self.links, 10 * self.links
        here, share = self._links(values), self._motor_shares(values)
        gradient, curvature = np.zeros(width), np.zeros((width, width))
        try:
            # Factor and inverse both: bodies at the edge of the possible have the one alone.
            factors = np.linalg.cholesky(here)
            inverses = np.linalg.inv(here)
        except np.linalg.LinAlgError:
            return float("inf"), gradient, curvature
        if (share <= 0.0).any():
            return float("inf"), gradient, curvature
        other = values[inertial:]
        total = float(np.sum(self.inverses * here)) - 4.0 * n + float((share - 1.0).sum())
        total -= 2.0 * float(np.log(np.diagonal(factors, axis1=1, axis2=2)).sum())
        total -= float(np.linalg.slogdet(self.inverses)[1].sum() + np.log(share).sum())
        total += 0.5 * _OTHER * float(other @ other)
        gradient[:inertial] = np.tensordot(
            self.inverses - inverses, PSEUDO_INERTIA_BASIS, ((1, 2), (1, 2))
        ).ravel()
        gradient[inertial:] = _OTHER * other
        gradient[self.motors] += (1.0 - 1.0 / share) / self.prior[self.motors]
        turned = inverses[:, None] @ PSEUDO_INERTIA_BASIS
        flat, swapped = turned.reshape(n, 10, 16), turned.swapaxes(2, 3).reshape(n, 10, 16)
        blocks, link = curvature[:inertial, :inertial].reshape(n, 10, n, 10), np.arange(n)
        blocks[link, :, link, :] = flat @ swapped.swapaxes(1, 2)
        places = np.arange(inertial, width)
        curvature[places, places] = _OTHER
        curvature[self.motors, self.motors] += 1.0 / np.square(share * self.prior[self.motors])
        return total, gradient, curvature

    def shortfalls(self, values: Array) -> Array:
        """(b) the share of its prior that each body lacks to be possible; else negative."""
        roots = np.linalg.cholesky(self.inverses)
        white = roots.transpose(0, 2, 1) @ self._links(values) @ roots
        lacking = np.concatenate([np.linalg.eigvalsh(white)[:, 0], self._motor_shares(values)])
        return -np.asarray(lacking, dtype=np.float64)

    def prior_by_body(self) -> Array:
        """(p, b) a column a body: the prior of that one alone."""
        apart = np.zeros((len(self.prior), len(self.names)))
        inertial = np.arange(10 * self.links)
        apart[inertial, inertial // 10] = self.prior[inertial]
        apart[self.motors, np.arange(self.links, len(self.names))] = self.prior[self.motors]
        return apart

    def _links(self, values: Array) -> Array:
        return to_pseudo_inertia(values[: 10 * self.links].reshape(self.links, -1))

    def _motor_shares(self, values: Array) -> Array:
        return values[self.motors] / self.prior[self.motors]

    def impossible(self, values: Array) -> str:
        """The links and motors that are not physically consistent, in words; empty if all are.

        Those that lack less than a thousandth of what the worst one lacks are not named: where
        thousands of priors are lacking, the search ends that far from its optimum, and which side
        of zero they are on depends on the last digits of the linear algebra.
        """
        lacking = self.shortfalls(values)
        short = lacking > max(_POSSIBLE, _NAMED * float(lacking.max()))
        named = list(zip(self.names, short, strict=True))
        links, motors = (
            [name for name, bad in some if bad]
            for some in (named[: self.links], named[self.links :])
        )
        words = [
            f"{what}{'s' if len(some) > 1 else ''} {', '.join(some)}"
            for what, some in (("link", links), ("motor inertia", motors))
            if some
        ]
        return " and ".join(words)


_DIVERGENCE = (
    "of all links with the identified base parameters, those nearest to the published ones "
    "(log-det divergence)"
)
_CONSISTENT = "those of the physically consistent estimate"
_IMPOSSIBLE = (
    "of all with the identified base parameters, those nearest to physically consistent links; "
    "no physically consistent links have these base parameters"
)
_STEPS = 200
_DECREMENT = 1e-10
_ON_PATH = 1e-2
"""The same on the way of the first phase, where a point near the central path is enough."""
_FACTOR = 2.0
"""Of the weight from one point of the path to the next. With 10, 200 Newton steps were not enough
for estimates of the paper's preset: the sum of what is lacking stayed 1 % too large."""
_DIGITS = 1e-13
"""Share of the objective below which a gain is rounding."""
_HEAVIEST = 1e6
"""At this weight the first phase knows to a millionth of the prior whether there are bodies."""
_CERTAIN = 1e-4
"""It ends earlier where it knows what is lacking to this share."""
_SHORTEST = 1e-12
_INSIDE = 1e-9
"""Share of the prior by which a body is inside those that can exist."""
_LEAST_MASS = 0.1
"""Share of the prior's mass that a link without possible bodies gets at least."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Completion:
    """Standard parameters with the torques of an estimate."""

    values: Array
    """(p) standard parameters, read-only."""
    physical: bool
    """Whether every link is physically consistent and no motor inertia is negative."""
    worst: str
    """The links and motors that are not physically consistent, in words; empty if all are."""
    origin: str
    """How they were found, in words."""

    def __post_init__(self) -> None:
        freeze(self, values=(None,))


_LAST: dict[str, Completion] = {}
"""The last one, by what it follows from: files, verdict and report of an estimate all need it."""


def complete(estimate: Estimate) -> Completion:
    """The standard parameters of an estimate that are nearest to the prior.

    Physically consistent estimates carry theirs. Where no possible bodies have these torques, the
    parameters that lack the least of the prior's bodies; `physical` says so.
    """
    model, standard = estimate.model, estimate.standard
    words = robot_to_json(model.robot), model.frames, model.friction.to_json()
    numbers = estimate.values if standard is None else standard.values
    key = json.dumps([*words, standard is None, numbers.tolist()])
    found = _LAST.get(key)
    if found is None:
        found = _complete(estimate)
        _LAST.clear()
        _LAST[key] = found
    return found


def _complete(estimate: Estimate) -> Completion:
    model = estimate.model
    bodies = PseudoInertias.of(model, inertial_prior(model.robot, model.frames).parameters)
    if estimate.standard is not None:
        values = np.array(estimate.standard.values)
        worst = bodies.impossible(values)
        return Completion(values=values, physical=not worst, worst=worst, origin=_CONSISTENT)
    start = np.asarray(estimate.standard_parameters(), dtype=np.float64)
    unseen = null_space(model)
    # The least squares distance to the prior, in the prior's metric.
    root = _metric(bodies)
    nearest = unseen @ _least_squares(root @ unseen, root @ (bodies.prior - start))
    z, possible = _possible(bodies, start + nearest, unseen)
    if not possible:
        values = start + nearest + unseen @ z
        worst = bodies.impossible(values) or "one link (by a small margin)"
        values = _with_masses(bodies, *_as_predicted(model, start, values, unseen))
        return Completion(values=values, physical=False, worst=worst, origin=_IMPOSSIBLE)
    z = _minimise(bodies, start + nearest, unseen, z)
    values = start + nearest + unseen @ z
    return Completion(values=values, physical=True, worst="", origin=_DIVERGENCE)


def null_space(model: InverseDynamicModel) -> Array:
    """(p, k) directions of the standard parameters that leave all base parameters as they are.

    As many as the nominal geometry has: one that is off by 1e-7 rad shows all parameters, with
    torques that no sensor can tell from zero.
    """
    base = reduce_model(model)
    unseen = np.zeros((len(model.columns), len(base.dependent)))
    unseen[list(base.independent)] = -base.regrouping
    unseen[list(base.dependent)] = np.eye(len(base.dependent))
    return unseen


def _as_predicted(
    model: InverseDynamicModel, start: Array, values: Array, unseen: Array
) -> tuple[Array, Array]:
    """The smallest step that gives a geometry off nominal the torques of the base parameters.

    It shows weakly what the nominal one does not. Possible bodies have little of that; of others,
    moments of 100 kg.m on the first link of an arm that leans by 0.9 degree made 11 N.m. Also the
    directions that it does not show either.
    """
    columns = model.stack(*random_states(model.robot, _POSES, _SEED))
    shown = np.tensordot(unseen, columns, axes=(0, 0)).reshape(unseen.shape[1], -1).T
    _, sizes, turn = np.linalg.svd(shown, full_matrices=False)
    clear = sizes > _SHOWN * np.abs(columns).max()
    if not clear.any():
        return values, unseen
    left = np.tensordot(values - start, columns, axes=1).ravel()
    return values - unseen @ _least_squares(shown, left), unseen @ turn[~clear].T


def _metric(bodies: PseudoInertias) -> Array:
    """(p, p) whose product with a small change is as long as the change's divergence says."""
    _, _, metric = bodies.divergence(bodies.prior)
    values, vectors = np.linalg.eigh(metric)
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T


def _with_masses(bodies: PseudoInertias, values: Array, unseen: Array) -> Array:
    """The same torques with positive masses, which loaders insist on, if there are any.

    The smallest step that motion does not show and that lifts masses to a share of the prior's.
    """
    places = 10 * np.arange(bodies.links)
    lift = np.maximum(_LEAST_MASS * bodies.prior[places] - values[places], 0.0)
    if not lift.any():
        return values
    scaled, masses = _metric(bodies) @ unseen, unseen[places]
    width = unseen.shape[1]
    system = np.zeros((width + bodies.links, width + bodies.links))
    system[:width, :width] = scaled.T @ scaled
    system[:width, width:], system[width:, :width] = masses.T, masses
    step = _least_squares(system, np.concatenate([np.zeros(width), lift]))[:width]
    lifted = values + unseen @ step
    return lifted if (lifted[places] > 0.0).all() else values


def _possible(bodies: PseudoInertias, start: Array, unseen: Array) -> tuple[Array, bool]:
    """Coordinates (k) where every body can exist, or as many as can, and whether it is all.

    The first phase of an interior point method: how much of its prior must be added to each body
    before it can exist, the sum made as small as it gets. As sums of sizes do, it leaves few
    bodies lacking, those whom the data contradict.
    """
    lacking = bodies.shortfalls(start)
    z: Array = np.zeros(len(unseen.T))
    if (lacking < 0.0).all():
        return z, True
    wide = np.column_stack([unseen, bodies.prior_by_body()])
    z = np.append(z, np.maximum(1.1 * lacking, 0.0) + 1e-3)
    weight = 1.0
    while weight < _FACTOR * _HEAVIEST:
        z = _minimise(bodies, start, wide, z, slacks=len(lacking), weight=weight)
        found = z[: -len(lacking)]
        if (bodies.shortfalls(start + unseen @ found) < -_INSIDE).all():
            return found, True
        # The optimum of the barrier lies within its degree / weight of the smallest sum.
        if 4.0 * bodies.links + 2.0 * len(lacking) < _CERTAIN * weight * z[-len(lacking) :].sum():
            break
        weight *= _FACTOR
    return z[: -len(lacking)], False


def _minimise(
    bodies: PseudoInertias,
    start: Array,
    directions: Array,
    z: Array,
    slacks: int = 0,
    weight: float = 0.0,
) -> Array:
    """Coordinates (k) that minimise the divergence plus `weight` times the positive slacks.

    Newton's method with a line search; the divergence is self-concordant, so it converges from
    every point where it is finite, as it is at z (k). Parameters are start (p) + directions (p, k)
    z; so many of the last coordinates are slacks, which must stay positive.
    """
    first, enough = len(z) - slacks, _ON_PATH if slacks else _DECREMENT
    value, down, matrix = _objective(bodies, start, directions, z, first, weight)
    for _ in range(_STEPS):
        step = -_least_squares(matrix, down)
        gain, here, length = -float(down @ step), value, 1.0
        if gain < max(enough, _DIGITS * abs(here)):
            break
        while length > _SHORTEST:
            trial = z + length * step
            value, down, matrix = _objective(bodies, start, directions, trial, first, weight)
            if value <= here - 0.1 * length * gain:
                break
            length *= 0.5
        else:
            break
        z = trial
    return z


def _objective(
    bodies: PseudoInertias, start: Array, directions: Array, z: Array, first: int, weight: float
) -> tuple[float, Array, Array]:
    """Divergence, cost and logarithmic barrier of the slacks z[first:], with two derivatives."""
    slack = z[first:]
    if (slack <= 0.0).any():
        return float("inf"), np.zeros(len(z)), np.eye(len(z))
    value, gradient, curvature = bodies.divergence(start + directions @ z)
    down, matrix = directions.T @ gradient, directions.T @ curvature @ directions
    down[first:] += weight - 1.0 / slack
    places = np.arange(first, len(z))
    matrix[places, places] += 1.0 / np.square(slack)
    return value + weight * float(slack.sum()) - float(np.log(slack).sum()), down, matrix


def _least_squares(matrix: Array, right: Array) -> Array:
    """The smallest x (k) with the smallest |A x - b|."""
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=1e-15)[0], dtype=np.float64)
