"""The weight of the prior on bodies, from regions of the motion that are left out.

A motion that does not tell its parameters apart predicts itself whatever the weight, but not
another motion. Stretches of time that are left out lie beside those that stay, so that they do
not show it; the ends of the motion do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, read_only
from dynid.core.errors import JobError
from dynid.identification.accumulate import joint_factors
from dynid.identification.conditioning import base_mapping
from dynid.identification.consistent_conic import solve_conic
from dynid.identification.consistent_problem import reduced_problem
from dynid.identification.prior import InertialPrior
from dynid.identification.problem import IdentificationProblem

AXES = 3
"""Principal axes of the poses whose two ends are left out in turn."""
END = 0.25
"""Share of the rows at one end."""
POWERS = tuple(k / 2 for k in range(-12, 1))
"""Decimal powers of the weights that are tried, over the weighted residual sum."""
TOLERANCE = 1e-8
"""Of the solver while weights are compared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutWeight:
    """A weight, and what spoke for it."""

    gamma: float
    scores: Array
    """(folds, weights) sum over joints of log RMS on the region left out [log N.m]."""
    regions: int


def pose_regions(q: Array) -> Array:
    """(k, N) marks of the rows at each end of the principal axes of poses.

    Args:
        q: (N, n) positions.
    """
    spread = q.std(axis=0)
    moving = spread > 1e-9
    centred = (q - q.mean(axis=0))[:, moving] / spread[moving]
    axes = np.linalg.svd(centred, full_matrices=False)[2][:AXES]
    along = axes @ centred.T
    low, high = np.quantile(along, [END, 1 - END], axis=1)
    return np.concatenate([along > high[:, None], along < low[:, None]])


def held_out_weight(
    problem: IdentificationProblem, weights: Array, prior: InertialPrior
) -> HeldOutWeight:
    """The largest weight that predicts unseen regions as well as the best, to its own doubt.

    Each end of the motion's principal axes is left out in turn. Of all weights whose mean score
    lies within one standard error of the best, the largest is taken (Breiman, Friedman, Olshen
    and Stone 1984): what the record cannot tell, the prior says.

    Args:
        problem: The problem.
        weights: (n) weight of each joint, in units of the plain residual sum.
        prior: Inertias in the model's parameter frames.

    Raises:
        JobError: The solver finds no solution for any weight.
    """
    used = problem.samples.q[problem.samples.rows]
    poses = used[:: problem.samples.block][: problem.blocks]
    marks = pose_regions(poses)
    mapping = base_mapping(problem.base)
    scores = np.full((len(marks), len(POWERS)), np.inf)
    for k, mark in enumerate(marks):
        left, stay = (
            joint_factors(problem, np.broadcast_to(rows, (problem.samples.joints, len(rows))))
            for rows in (mark.astype(np.float64), (~mark).astype(np.float64))
        )
        # Fewer rows, same meaning of the weight: the residual sum of all rows is one.
        share = float(np.sqrt(len(mark) / (~mark).sum()))
        reduced, _ = reduced_problem(problem, stay, weights * share, prior)
        for i, power in enumerate(POWERS):
            try:
                found = solve_conic(reduced, 10.0**power, TOLERANCE)
            except JobError:
                continue
            error = np.linalg.norm(left @ np.append(mapping @ found.values, -1.0), axis=1)
            scores[k, i] = np.log(np.maximum(error / np.sqrt(mark.sum()), 1e-12)).sum()
    chosen = one_standard_error(scores)
    return HeldOutWeight(gamma=10.0 ** POWERS[chosen], scores=read_only(scores), regions=len(marks))


def one_standard_error(scores: Array) -> int:
    """The last column whose mean lies within one standard error of the best column's.

    Args:
        scores: (folds, candidates), smaller is better, the candidates from weak to strong.

    Raises:
        JobError: No candidate has a score in all folds.
    """
    mean = scores.mean(axis=0)
    best = int(np.argmin(mean))
    if not np.isfinite(mean[best]):
        raise JobError("no weight of the prior has a solution on every part of the record")
    error = scores[:, best].std(ddof=1) / np.sqrt(len(scores))
    return int(np.flatnonzero(mean <= mean[best] + error)[-1])
