"""The body that can exist nearest to an estimate, in the measure of its covariance."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import JobError
from dynid.robot.inertia import from_pseudo_inertia, to_pseudo_inertia

_BASIS = to_pseudo_inertia(np.eye(10))
_START = 1e-3
"""Smallest eigenvalue of the first body, over the largest."""
_SHRINK = 0.1
_LAST = 1e-10
"""Weight of the barrier at the end: the misfit is then at most four times that above its least."""
_STEPS = 200
_DONE = 1e-6
"""Square of the Newton decrement, over the barrier's weight, at which a stage ends."""


def nearest_body(free: Array, covariance: Array) -> Array:
    """Minimise (p - p0)' C^-1 (p - p0) over parameters whose pseudo-inertia is not negative.

    This is the constrained least-squares answer of the whole problem, with all else already
    eliminated. Newton's method on half the misfit less mu log det J(p), mu falling to zero
    (Boyd and Vandenberghe 2004, 11.3).

    Args:
        free: p0 (10) unconstrained estimate.
        covariance: C (10, 10), positive definite.

    Raises:
        JobError: Newton's method does not converge.
    """
    values, vectors = np.linalg.eigh(to_pseudo_inertia(free))
    if values[0] >= 0:
        return free.copy()
    size = float(np.abs(values).max())
    point = from_pseudo_inertia((vectors * np.maximum(values, _START * size)) @ vectors.T)
    white = np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=np.float64)
    precision = white.T @ white
    mu = 1.0
    while mu > _LAST:
        point = _centred(point, free, precision, mu)
        mu *= _SHRINK
    return point


def _centred(point: Array, free: Array, precision: Array, mu: float) -> Array:
    """The minimiser for one weight of the barrier."""
    for _ in range(_STEPS):
        solved = _solve(to_pseudo_inertia(point), _BASIS)
        gradient = precision @ (point - free) - mu * np.trace(solved, axis1=1, axis2=2)
        hessian = precision + mu * np.einsum("iab,jba->ij", solved, solved)
        scale = 1.0 / np.sqrt(np.diag(hessian))
        scaled = hessian * scale[:, None] * scale[None, :]
        step = -scale * _solve(scaled, scale * gradient)
        decrement = float(-gradient @ step)
        if decrement < _DONE * mu:
            return point
        # The damped step of self-concordant functions stays among the bodies and descends.
        length = float(np.sqrt(max(decrement, 0.0) / mu))
        point = point + (step if length < 0.25 else step / (1.0 + length))
    raise JobError("no nearest body was found", value=f"barrier {mu:.0e}")


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
