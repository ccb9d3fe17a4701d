"""Quasi-Newton descent inside a polytope: the barrier's exact curvature, BFGS for the rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.excitation.region import MotionRegion

Objective = Callable[[Array], tuple[float, Array]]
"""Value and gradient (n, 1 + k) at numbers (n, 1 + k)."""

SUFFICIENT = 1e-4
"""Share of the promised decrease that a step must bring (Armijo)."""
SHRINK = 0.4
TRIALS = 8
RIDGES = (1e-13, 1e-10, 1e-7, 1e-4)
"""Of the largest diagonal entry, tried in this order."""


@dataclass(slots=True)
class Descent:
    """Where a descent stands; BFGS's curvature is kept from one stage to the next."""

    x: Array
    curvature: Array | None = None
    """(D, D) of the objective, without the barrier."""
    evaluations: int = 0


def descend(
    objective: Objective,
    region: MotionRegion,
    state: Descent,
    *,
    weight: float,
    iterations: int,
    tolerance: float,
    stop: Callable[[], bool],
) -> None:
    """Minimise objective + weight * barrier; `state` is moved to the best point found.

    The barrier's Hessian is exact and cheap (a small block a joint), so that only the objective's
    curvature has to be learnt from gradients (damped BFGS: Nocedal and Wright, procedure 18.2).

    Args:
        objective: What to minimise.
        region: The bounds; the start lies strictly inside and every point stays there.
        state: Start, and where to go on.
        weight: Weight of the barrier: small weights let the motion closer to its bounds.
        iterations: Most steps.
        tolerance: Stop after two steps that bring less than this.
        stop: Asked before each evaluation; True ends the descent at the best point so far.
    """
    x, shape = state.x, state.x.shape
    value, gradient = objective(x)
    state.evaluations += 1
    slack = region.slack(x)
    total = value + weight * region.barrier_value(slack)
    idle = 0
    for _ in range(iterations):
        barrier = region.barrier(slack)
        if state.curvature is None:
            state.curvature = np.eye(x.size)
        slope = gradient + weight * barrier.gradient
        if region.pose is not None:
            slope[:, 0] = 0.0
        direction = _newton(
            state.curvature,
            weight * barrier.curvature,
            slope.ravel(),
            fixed=region.pose is not None,
        )
        step = direction.reshape(shape)
        promised = float(slope.ravel() @ direction)
        length = region.longest_step(slack, step)
        for _ in range(TRIALS):
            if stop():
                return
            trial = x + length * step
            trial_slack = region.slack(trial)
            trial_value, trial_gradient = objective(trial)
            state.evaluations += 1
            reached = trial_value + weight * region.barrier_value(trial_slack)
            if math.isfinite(reached) and reached <= total + SUFFICIENT * length * promised:
                break
            length *= SHRINK
        else:
            return
        state.curvature = _damped_update(
            state.curvature, (trial - x).ravel(), (trial_gradient - gradient).ravel()
        )
        gained = total - reached
        x, gradient, slack, total = trial, trial_gradient, trial_slack, reached
        state.x = x
        idle = idle + 1 if gained < tolerance else 0
        if idle == 2:
            return


def _newton(curvature: Array, blocks: Array, slope: Array, *, fixed: bool) -> Array:
    """The step - (curvature + blocks)^-1 slope, with no change of offsets if they are fixed."""
    matrix = curvature.copy()
    width = blocks.shape[1]
    for j, block in enumerate(blocks):
        part = slice(j * width, (j + 1) * width)
        matrix[part, part] += block
    if fixed:
        matrix[::width], matrix[:, ::width] = 0.0, 0.0
        matrix[range(0, len(matrix), width), range(0, len(matrix), width)] = 1.0
    # Sums of positive definite matrices, but for rounding where some directions are very flat.
    diagonal = np.diag(matrix).copy()
    for ridge in RIDGES:
        np.fill_diagonal(matrix, diagonal + ridge * np.max(diagonal))
        try:
            factor = np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            continue
        step = np.linalg.solve(factor.T, np.linalg.solve(factor, -slope))
        return np.asarray(step, dtype=np.float64)
    return -slope / np.maximum(diagonal, 1e-300)


def _damped_update(curvature: Array, step: Array, change: Array) -> Array:
    """BFGS, with Powell's damping so that the matrix stays positive definite."""
    image = curvature @ step
    bend, seen = float(step @ image), float(step @ change)
    if not bend > 0:
        return curvature
    if seen < 0.2 * bend:
        share = 0.8 * bend / (bend - seen)
        change = share * change + (1 - share) * image
        seen = float(step @ change)
    return curvature - np.outer(image, image) / bend + np.outer(change, change) / seen
