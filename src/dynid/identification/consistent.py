"""Least squares over physically consistent parameters as a cone program."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.core import Array, JobError, Mask, require, scipy_part, upper_triangle
from dynid.identification import bayesian
from dynid.identification.problem import IdentificationProblem, base_mapping
from dynid.regressor import InverseDynamicModel
from dynid.robot import PSEUDO_INERTIA_BASIS, frame_map, to_pseudo_inertia

BOUNDED_BY = {"Fca": "Fc", "Fva": "Fv", "Fs": "Fc"}
"""Added friction that must not outweigh its term: friction opposes motion both ways."""

MASS_FACTOR = 3.0
"""A published mass is right to this factor."""
CENTRE_MARGIN = 0.25
"""How far beside its link a centre of mass may lie, over the arm's reach."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsistentProblem:
    """Minimise ||A p - y||^2 / 2 + gamma sum_i D(J_i || J0_i) with C p >= d and J_i > 0.

    D is the log-det (entropic) divergence tr(J0^-1 J) - log det(J0^-1 J) - 4 of Lee, Wensing and
    Park (2020): zero at the prior, infinite at bodies that cannot exist, the same in all frames
    and units.
    """

    matrix: Array
    """A (m, p), the triangular root of the weighted data in standard parameters."""
    target: Array
    """y (m)."""
    prior: Array
    """(n, 10) inertial parameters of bodies that exist; p starts with the 10 n of them."""
    constraints: Array
    """C (k, p)."""
    floor: Array
    """d (k)."""
    least: float = 0.0
    """Residual sum that no parameters can go below."""

    @property
    def links(self) -> int:
        """Number of links n."""
        return len(self.prior)

    def pseudo_inertias(self, parameters: Array) -> Array:
        """(n, 4, 4) of parameters (p)."""
        return to_pseudo_inertia(parameters[: 10 * self.links].reshape(-1, 10))

    def misfit(self, parameters: Array) -> float:
        """The weighted residual sum, ||A p - y||^2 and what lies below."""
        return self.least + float(np.square(self.matrix @ parameters - self.target).sum())


def reduced_problem(
    problem: IdentificationProblem, factors: Array, weights: Array, prior: bayesian.InertialPrior
) -> ConsistentProblem:
    """The reduced problem.

    With factors (n, r + 1, r + 1) of `joint_factors`, weights (n) [1/(N.m)] and inertias in the
    model's parameter frames.
    """
    rank = problem.base.rank
    upper = upper_triangle((factors * weights[:, None, None]).reshape(-1, rank + 1))
    signs = sign_constraints(problem.base.model)
    bodies, floors = body_constraints(problem.base.model)
    return ConsistentProblem(
        matrix=upper[:rank, :rank] @ base_mapping(problem.base),
        target=upper[:rank, rank],
        prior=prior.parameters,
        constraints=np.vstack([signs, bodies]),
        floor=np.concatenate([np.zeros(len(signs)), floors]),
        least=float(upper[rank, rank] ** 2),
    )


def sign_constraints(model: InverseDynamicModel) -> Array:
    """C (k, p) with C p >= 0: friction opposes motion, motor inertia is not negative."""
    names, unit = model.names, np.eye(len(model.names))
    place = {name: k for k, name in enumerate(names)}
    rows: list[Array] = []
    for name, k in place.items():
        symbol = bayesian.symbol_of(name)
        if symbol in bayesian.NOT_NEGATIVE:
            rows.append(unit[k])
        base = BOUNDED_BY.get(symbol)
        if base is None:
            continue
        other = place.get(base + name[len(symbol) :])
        for sign in (1.0,) if symbol == "Fs" else (1.0, -1.0):
            row = sign * unit[k]
            if other is not None:
                row[other] += 1.0
            rows.append(row)
    return np.array(rows).reshape(-1, len(names))


def body_constraints(model: InverseDynamicModel) -> tuple[Array, Array]:
    """C (k, p) and d (k) with C p >= d: masses and centres of mass where they can be.

    A published mass is right to `MASS_FACTOR`; the last link may carry a tool besides. A centre
    of mass lies in the box of its link's joint and the next, wider by `CENTRE_MARGIN`.
    """
    robot, unit = model.robot, np.eye(len(model.columns))
    ends = bayesian.link_ends(robot)
    margin = CENTRE_MARGIN * bayesian.reach(ends)
    rows: list[Array] = []
    floors: list[float] = []
    for i, end in enumerate(ends):
        known = robot.inertias[i]
        here = slice(10 * i, 10 * i + 10)
        if known[0] > 0:
            rows.append(unit[10 * i])
            floors.append(float(known[0]) / MASS_FACTOR)
            if i < robot.joints - 1:
                rows.append(-unit[10 * i])
                floors.append(-float(known[0]) * MASS_FACTOR)
        published = known[1:4] / known[0] if known[0] > 0 else np.zeros(3)
        corners = np.array([np.zeros(3), end, np.nan_to_num(published)])
        lower, upper = corners.min(axis=0) - margin, corners.max(axis=0) + margin
        first = frame_map(robot.parameter_frames[model.frames][i])[:4]
        for axis in range(3):
            for sign, bound in ((1.0, lower[axis]), (-1.0, upper[axis])):
                row = np.zeros(len(unit))
                row[here] = sign * (first[1 + axis] - bound * first[0])
                rows.append(row)
                floors.append(0.0)
    return np.array(rows), np.array(floors)


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
    held: Mask
    """(k) which bounds bind."""


def solve_conic(problem: ConsistentProblem, gamma: float) -> ConsistentSolution:
    """The minimiser by an interior-point method, gamma > 0 the weight of the prior.

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
        linear[10 * i : 10 * i + 10] += gamma * np.trace(PSEUDO_INERTIA_BASIS, axis1=1, axis2=2)
        linear[first + 10 : first + EXTRA] = -gamma
        rows += _link_rows(10 * i, first, columns)
        right += [np.zeros(36), *[np.array([0.0, 1.0, 0.0])] * 4]
        cones += [clarabel.PSDTriangleConeT(8), *[clarabel.ExponentialConeT()] * 4]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    settings.max_iter = 400
    matrix = scipy_part("sparse").csc_matrix
    solver = clarabel.DefaultSolver(
        matrix(np.triu(quadratic)),
        linear,
        matrix(np.vstack(rows)),
        np.concatenate(right),
        cones,
        settings,
    )
    solution = solver.solve()
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise JobError("the conic solver found no solution", value=str(solution.status))
    # In the solver's units, which those of the arm do not change.
    multipliers, slack = (
        np.array(x[: len(sizes)], dtype=np.float64) for x in (solution.z, solution.s)
    )
    return ConsistentSolution(
        values=units @ np.array(solution.x[:width], dtype=np.float64),
        multipliers=np.maximum(multipliers / sizes, 0.0),
        held=multipliers > slack,
    )


def _units(problem: ConsistentProblem) -> Array:
    """(p, p) parameters in which the solver works: bodies in those of the prior, columns of one.

    Friction in N.m beside inertias of a wrist would stop the solver short of its tolerance.
    """
    units, inertial = np.eye(problem.matrix.shape[1]), 10 * problem.links
    units[:inertial, :inertial] = bayesian.metric_moves(
        to_pseudo_inertia(problem.prior), PSEUDO_INERTIA_BASIS
    )
    norms = np.linalg.norm(problem.matrix[:, inertial:], axis=0)
    for k, norm in enumerate(norms, start=inertial):
        units[k, k] = 1.0 / norm if norm > 0 else 1.0
    return units


def _link_rows(here: int, first: int, columns: int) -> list[Array]:
    """Rows of one link: its 8x8 matrix, then the cone of each logarithm."""
    block = np.zeros((columns, 8, 8))
    block[here : here + 10, :4, :4] = PSEUDO_INERTIA_BASIS
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
    columns, rows = np.tril_indices(matrices.shape[-1])
    return matrices[..., rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2.0))
