"""Where each standard parameter comes from: the data, or the prior."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.core.linalg import inverse_upper, upper_triangle
from dynid.identification.consistent_conic import ConsistentSolution
from dynid.identification.consistent_problem import ConsistentProblem
from dynid.identification.least_squares import StandardFit
from dynid.identification.prior import ORTHONORMAL
from dynid.robot.inertia import from_pseudo_inertia, to_pseudo_inertia


def standard_fit(
    problem: ConsistentProblem, gamma: float, solution: ConsistentSolution, root: Array
) -> StandardFit:
    """What data and prior each say about a solution, from its first-order response.

    The prior's share of a parameter is how far it moves when the prior's bodies move at random
    by one unit of their own metric, over what such a move is for the prior's parameter: 1 where
    the data say nothing or a bound of the prior holds, near 0 where they say all. Friction and
    motor inertia have no prior of their own, but move where they are seen only in sum with a
    link's inertia.

    Args:
        problem: The problem.
        gamma: Weight of the prior.
        solution: Its solution.
        root: (m, r) columns of the base parameters.
    """
    values, inertial = solution.values, 10 * problem.links
    turn = np.eye(len(values))
    known = np.zeros((inertial, inertial))
    roots = np.linalg.cholesky(problem.pseudo_inertias(values))
    priors = np.linalg.cholesky(to_pseudo_inertia(problem.prior))
    for i, (body, before) in enumerate(zip(roots, priors, strict=True)):
        here = slice(10 * i, 10 * i + 10)
        turn[here, here] = from_pseudo_inertia(body @ ORTHONORMAL @ body.T).T
        known[here, here] = from_pseudo_inertia(before @ ORTHONORMAL @ before.T).T
    slack = np.maximum(problem.constraints @ values - problem.floor, 1e-12)
    stiff = np.sqrt(solution.multipliers / slack)
    rows = np.vstack(
        [
            problem.matrix @ turn,
            (stiff[:, None] * problem.constraints) @ turn,
            # In these coordinates the prior's second derivatives are gamma times the identity.
            np.sqrt(gamma) * np.eye(inertial, len(values)),
        ]
    )
    scale = 1.0 / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    inner = scale[:, None] * inverse_upper(upper_triangle(rows * scale))
    half = turn @ inner
    # The prior J0 pulls with gamma J0^-1: its unit moves shift the pull by known^-T.
    moved = gamma * np.linalg.norm(half @ (half[:inertial].T @ np.linalg.inv(known).T), axis=1)
    size = np.abs(values)
    size[:inertial] = np.linalg.norm(known, axis=1)
    share = np.divide(moved, size, out=np.ones_like(size), where=size > 0)
    held = solution.multipliers > slack
    bodies = np.abs(problem.constraints[held][:, :inertial]) > 0
    share[:inertial][bodies.any(axis=0)] = 1.0
    return StandardFit(
        values=values,
        gain=half @ (half.T @ (problem.matrix.T @ root)),
        prior_share=np.minimum(share, 1.0),
        prior=np.concatenate([problem.prior.ravel(), np.full(len(values) - inertial, np.nan)]),
    )
