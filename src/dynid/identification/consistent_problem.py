"""Least squares over bodies that can exist, as a convex problem in the standard parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.core.linalg import upper_triangle
from dynid.identification.conditioning import base_mapping
from dynid.identification.plausible_signs import NOT_NEGATIVE, symbol_of
from dynid.identification.prior import InertialPrior
from dynid.identification.problem import IdentificationProblem
from dynid.regressor.model import InverseDynamicModel
from dynid.robot.inertia import frame_map, to_pseudo_inertia

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

    @property
    def links(self) -> int:
        """Number of links n."""
        return len(self.prior)

    def pseudo_inertias(self, parameters: Array) -> Array:
        """(n, 4, 4) of parameters (p)."""
        return to_pseudo_inertia(parameters[: 10 * self.links].reshape(-1, 10))

    def misfit(self, parameters: Array) -> float:
        """||A p - y||^2."""
        return float(np.square(self.matrix @ parameters - self.target).sum())

    def divergence(self, parameters: Array) -> float:
        """The sum of D over the links; infinite outside the bodies that exist."""
        bodies, prior = self.pseudo_inertias(parameters), to_pseudo_inertia(self.prior)
        try:
            # Not by the determinant: two negative eigenvalues make a positive one.
            roots = np.linalg.cholesky(bodies)
        except np.linalg.LinAlgError:
            return float("inf")
        size = 2.0 * np.log(np.diagonal(roots, axis1=1, axis2=2)).sum()
        known = np.linalg.slogdet(prior)[1].sum()
        trace = np.trace(np.linalg.solve(prior, bodies), axis1=1, axis2=2).sum()
        return float(trace - size + known - 4.0 * self.links)


def reduced_problem(
    problem: IdentificationProblem, factors: Array, weights: Array, prior: InertialPrior
) -> tuple[ConsistentProblem, float]:
    """The reduced problem, and the residual sum that no parameters can go below.

    Args:
        problem: The problem.
        factors: (n, r + 1, r + 1) from `joint_factors`.
        weights: (n) weight of each joint [1/(N.m)].
        prior: Inertias in the model's parameter frames.
    """
    rank = problem.base.rank
    upper = upper_triangle((factors * weights[:, None, None]).reshape(-1, rank + 1))
    signs = sign_constraints(problem.base.model)
    bodies, floors = body_constraints(problem.base.model)
    return (
        ConsistentProblem(
            matrix=upper[:rank, :rank] @ base_mapping(problem.base),
            target=upper[:rank, rank],
            prior=prior.parameters,
            constraints=np.vstack([signs, bodies]),
            floor=np.concatenate([np.zeros(len(signs)), floors]),
        ),
        float(upper[rank, rank] ** 2),
    )


def sign_constraints(model: InverseDynamicModel) -> Array:
    """C (k, p) with C p >= 0: friction opposes motion, motor inertia is not negative."""
    names = model.names
    place = {name: k for k, name in enumerate(names)}
    rows: list[Array] = []
    for name, k in place.items():
        symbol = symbol_of(name)
        if symbol in NOT_NEGATIVE:
            rows.append(_row(len(names), k))
        base = BOUNDED_BY.get(symbol)
        if base is None:
            continue
        other = place.get(base + name[len(symbol) :])
        for sign in (1.0,) if symbol == "Fs" else (1.0, -1.0):
            row = sign * _row(len(names), k)
            if other is not None:
                row[other] += 1.0
            rows.append(row)
    return np.array(rows).reshape(-1, len(names))


def body_constraints(model: InverseDynamicModel) -> tuple[Array, Array]:
    """C (k, p) and d (k) with C p >= d: masses and centres of mass where they can be.

    A published mass is right to `MASS_FACTOR`; the last link may carry a tool besides. A centre
    of mass lies in the box of its link's joint and the next, wider by `CENTRE_MARGIN`.
    """
    robot, width = model.robot, len(model.columns)
    ends = [*robot.placements[1:, :3, 3], robot.flange[:3, 3]]
    margin = CENTRE_MARGIN * float(sum(np.linalg.norm(end) for end in ends))
    rows: list[Array] = []
    floors: list[float] = []
    for i, end in enumerate(ends):
        known = robot.inertias[i]
        here = slice(10 * i, 10 * i + 10)
        if known[0] > 0:
            rows.append(_row(width, 10 * i))
            floors.append(float(known[0]) / MASS_FACTOR)
            if i < robot.joints - 1:
                rows.append(-_row(width, 10 * i))
                floors.append(-float(known[0]) * MASS_FACTOR)
        published = known[1:4] / known[0] if known[0] > 0 else np.zeros(3)
        corners = np.array([np.zeros(3), end, np.nan_to_num(published)])
        lower, upper = corners.min(axis=0) - margin, corners.max(axis=0) + margin
        first = frame_map(robot.parameter_frames[model.frames][i])[:4]
        for axis in range(3):
            for sign, bound in ((1.0, lower[axis]), (-1.0, upper[axis])):
                row = np.zeros(width)
                row[here] = sign * (first[1 + axis] - bound * first[0])
                rows.append(row)
                floors.append(0.0)
    return np.array(rows), np.array(floors)


def _row(width: int, place: int) -> Array:
    row = np.zeros(width)
    row[place] = 1.0
    return row
