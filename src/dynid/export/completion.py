"""From base parameters to standard ones: one member of all that give the same torques.

Motion shows the base parameters alone. Files want ten parameters a link, so what motion cannot
show is taken from the prior: of all standard parameters with the same torques, those whose bodies
are nearest to the prior's in the log-det divergence of Lee, Wensing and Park (2020), which only
bodies that can exist have.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.export.bodies import Bodies
from dynid.identification.estimate import Estimate
from dynid.identification.prior import inertial_prior
from dynid.reduction.sampling import random_states
from dynid.regressor.model import InverseDynamicModel

NULL = 1e-11
"""Singular values below this share of the largest, columns of unit norm, are no motion's."""
_DIVERGENCE = (
    "the bodies nearest to the robot's published ones (log-det divergence) of all with the "
    "identified base parameters"
)
_LEAST_SQUARES = (
    "the parameters nearest to the robot's published ones of all with the identified base "
    "parameters; no bodies that can exist have these base parameters"
)
_STEPS = 200
_DECREMENT = 1e-10
_SHORTEST = 1e-12
_INSIDE = 1e-9
"""Share of the prior by which a body is inside those that can exist."""
_SEED = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Completion:
    """Standard parameters with the torques of an estimate."""

    values: Array
    """(p) standard parameters."""
    physical: bool
    """Whether every link is a body that can exist and no motor inertia is negative."""
    worst: str
    """The link or motor that is farthest from possible, in words; empty if all are possible."""
    origin: str
    """How they were found, in words."""


def complete(estimate: Estimate) -> Completion:
    """The standard parameters of an estimate that are nearest to the prior.

    Where no possible bodies have these torques, those nearest to the prior in its own metric;
    `physical` says so.

    Args:
        estimate: The estimate.
    """
    model = estimate.model
    prior = inertial_prior(model.robot, model.frames).parameters
    start = np.asarray(estimate.standard_parameters(), dtype=np.float64)
    unseen = null_space(model)
    bodies = Bodies.of(model, prior)
    nearest = unseen @ _nearest(bodies, start, unseen)
    z = _possible(bodies, start + nearest, unseen)
    if z is None:
        values = start + nearest
        return Completion(
            values=values, physical=False, worst=bodies.worst(values), origin=_LEAST_SQUARES
        )
    z = _minimise(bodies, start + nearest, unseen, z)
    values = start + nearest + unseen @ z
    return Completion(values=values, physical=True, worst="", origin=_DIVERGENCE)


def null_space(model: InverseDynamicModel) -> Array:
    """(p, k) directions of the standard parameters that no motion of this very robot shows."""
    rows = -(-4 * len(model.columns) // model.robot.joints)
    w = model.observation_matrix(*random_states(model.robot, rows, _SEED))
    norms = np.linalg.norm(w, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    _, singular, right = np.linalg.svd(w / scale, full_matrices=False)
    unseen = np.asarray(right[singular <= NULL * singular[0]].T, dtype=np.float64)
    return unseen / scale[:, None]


def _nearest(bodies: Bodies, start: Array, unseen: Array) -> Array:
    """Coordinates (k) of the least squares distance to the prior, in the prior's metric."""
    _, _, metric = bodies.divergence(bodies.prior)
    # The metric's square root turns it into an ordinary least squares problem.
    values, vectors = np.linalg.eigh(metric)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return _least_squares(root @ unseen, root @ (bodies.prior - start))


def _possible(bodies: Bodies, start: Array, unseen: Array) -> Array | None:
    """Coordinates (k) where every body can exist, or None if there are none.

    The first phase of an interior point method: how much of the prior must be added to every
    body before it can exist, made as small as it gets.
    """
    need = bodies.shortfall(start)
    z: Array = np.zeros(len(unseen.T))
    if need < 0.0:
        return z
    wide = np.column_stack([unseen, bodies.prior])
    z = np.append(z, 1.1 * need + 1e-3)
    for weight in 10.0 ** np.arange(0.0, 10.0):
        z = _minimise(bodies, start, wide, z, weight)
        if bodies.shortfall(start + unseen @ z[:-1]) < -_INSIDE:
            return z[:-1]
    return None


def _minimise(
    bodies: Bodies, start: Array, directions: Array, z: Array, weight: float = 0.0
) -> Array:
    """Coordinates (k) that minimise the divergence plus `weight` times the last of them.

    Newton's method with a line search; the divergence is self-concordant, so it converges from
    every point where it is finite.
    """
    slope = np.zeros(len(z))
    slope[-1:] = weight
    value, gradient, curvature = bodies.divergence(start + directions @ z)
    for _ in range(_STEPS):
        down = directions.T @ gradient + slope
        matrix = directions.T @ curvature @ directions
        step = -_least_squares(matrix, down)
        gain = -float(down @ step)
        if gain < _DECREMENT:
            break
        here, length = value + float(slope @ z), 1.0
        while length > _SHORTEST:
            trial = z + length * step
            value, gradient, curvature = bodies.divergence(start + directions @ trial)
            if value + float(slope @ trial) <= here - 0.1 * length * gain:
                break
            length *= 0.5
        else:
            break
        z = trial
    return z


def _least_squares(matrix: Array, right: Array) -> Array:
    """The smallest x (k) with the smallest |A x - b|."""
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=1e-15)[0], dtype=np.float64)
