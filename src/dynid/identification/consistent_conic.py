"""The convex problem of consistent bodies as a cone programme, solved by Clarabel.

log det J of each whitened pseudo-inertia stands as the sum of the logarithms of the diagonal of
a triangle Z with [[J, Z], [Z', diag(Z)]] >= 0, each logarithm in an exponential cone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse  # pyright: ignore[reportMissingTypeStubs]

from dynid.core.arrays import Array
from dynid.core.errors import JobError
from dynid.core.optional import require
from dynid.identification.consistent_problem import ConsistentProblem
from dynid.robot.inertia import from_pseudo_inertia, to_pseudo_inertia

TRIANGLE = tuple((a, b) for a in range(4) for b in range(a + 1))
"""Entries of the lower triangle Z."""
EXTRA = 14
"""Variables a link besides its parameters: the ten of Z and four logarithms."""
TOLERANCE = 1e-10
"""Of gaps and residuals."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsistentSolution:
    """A minimiser."""

    values: Array
    """(p) standard parameters."""
    multipliers: Array
    """(k) of the bounds, zero where they do not bind."""


def solve_conic(
    problem: ConsistentProblem, gamma: float, tolerance: float = TOLERANCE
) -> ConsistentSolution:
    """The minimiser by an interior-point method.

    Args:
        problem: The problem.
        gamma: Weight of the prior, positive.
        tolerance: Of gaps and residuals.

    Raises:
        MissingExtraError: Clarabel is not installed.
        JobError: The solver does not find a solution.
    """
    clarabel: Any = require("clarabel", "sdp")
    width, columns = problem.matrix.shape[1], problem.matrix.shape[1] + EXTRA * problem.links
    units = _units(problem)
    matrix, bounds = problem.matrix @ units, problem.constraints @ units
    sizes = np.linalg.norm(bounds, axis=1)
    quadratic = np.zeros((columns, columns))
    quadratic[:width, :width] = matrix.T @ matrix
    linear = np.zeros(columns)
    linear[:width] = -matrix.T @ problem.target
    # Clarabel: minimise x'Px/2 + q'x with A x + s = b, s in cones.
    padding = np.zeros((len(sizes), columns - width))
    rows = [np.hstack([-bounds / sizes[:, None], padding])]
    right = [-problem.floor / sizes]
    cones: list[Any] = [clarabel.NonnegativeConeT(len(sizes))]
    for i in range(problem.links):
        first = width + EXTRA * i
        linear[10 * i : 10 * i + 10] += gamma * np.trace(_BASIS, axis1=1, axis2=2)
        linear[first + 10 : first + EXTRA] = -gamma
        added = _link_rows(_BASIS, 10 * i, first, columns)
        rows += added
        right += [np.zeros(36), *[np.array([0.0, 1.0, 0.0])] * 4]
        cones += [clarabel.PSDTriangleConeT(8), *[clarabel.ExponentialConeT()] * 4]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    settings.max_iter = 400
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(quadratic)),
        linear,
        sparse.csc_matrix(np.vstack(rows)),
        np.concatenate(right),
        cones,
        settings,
    )
    solution = solver.solve()
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise JobError("the conic solver found no solution", value=str(solution.status))
    multipliers = np.array(solution.z[: len(sizes)], dtype=np.float64) / sizes
    return ConsistentSolution(
        values=units @ np.array(solution.x[:width], dtype=np.float64),
        multipliers=np.maximum(multipliers, 0.0),
    )


def _units(problem: ConsistentProblem) -> Array:
    """(p, p) parameters in which the solver works: bodies in those of the prior, columns of one.

    Friction in N.m beside inertias of a wrist would stop the solver short of its tolerance.
    """
    units = np.eye(problem.matrix.shape[1])
    for i, root in enumerate(np.linalg.cholesky(to_pseudo_inertia(problem.prior))):
        here = slice(10 * i, 10 * i + 10)
        units[here, here] = from_pseudo_inertia(root @ _BASIS @ root.T).T
    norms = np.linalg.norm(problem.matrix[:, 10 * problem.links :], axis=0)
    for k, norm in enumerate(norms, start=10 * problem.links):
        units[k, k] = 1.0 / norm if norm > 0 else 1.0
    return units


def _link_rows(white: Array, here: int, first: int, columns: int) -> list[Array]:
    """Rows of one link: its 8x8 matrix, then the cone of each logarithm."""
    block = np.zeros((columns, 8, 8))
    block[here : here + 10, :4, :4] = white
    for k, (a, b) in enumerate(TRIANGLE):
        block[first + k, a, 4 + b] = block[first + k, 4 + b, a] = 1.0
        if a == b:
            block[first + k, 4 + a, 4 + a] = 1.0
    rows = [-_upper_triangles(block).T]
    for a in range(4):
        cone = np.zeros((3, columns))
        cone[0, first + 10 + a] = -1.0
        cone[2, first + TRIANGLE.index((a, a))] = -1.0
        rows.append(cone)
    return rows


def _upper_triangles(matrices: Array) -> Array:
    """(..., k (k + 1) / 2) upper triangles by columns, off-diagonal entries times sqrt(2)."""
    size = matrices.shape[-1]
    entries = [
        matrices[..., a, b] * (1.0 if a == b else np.sqrt(2.0))
        for b in range(size)
        for a in range(b + 1)
    ]
    return np.stack(entries, axis=-1)


_BASIS = to_pseudo_inertia(np.eye(10))
