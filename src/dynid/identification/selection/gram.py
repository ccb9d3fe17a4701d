"""Gram blocks: products of columns and torques, summed joint by joint and cell by cell.

The rows of a recording are divided into cells (region, stretch of time, recording, moving or at
rest). For each joint and cell the products of all candidate columns and torques are summed once;
least squares with any of the columns on any union of cells is then a small solve on sums of
blocks, and so is the error of any solution on any other union. Nothing here depends on how long
a recording is: blocks of parts of a recording add up.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynid.core import Array, Indices, Mask, compiled

HELD = 1e12
"""Stiffness that holds an unknown of unit columns at zero."""
RIDGE = 1e-7
"""Of unit columns: a parameter that parts of a recording do not show stays small."""
ROUNDING = 1e-12
"""Of unit columns that the prior holds: some hardly differ from each other, which depends on link
frames, and carry torques that cancel."""
WEIGHTING_STEPS = 5
"""Fits and noise levels in turn; a sixth changes no weight by a per cent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GramBlocks:
    """Sums of products of columns and torques by joint and cell."""

    products: Array
    """(n, C, m, m) of the m rows' products: columns first, then candidate torques."""
    rows: Array
    """(n, C) number of rows."""

    def merged(self, groups: Indices) -> GramBlocks:
        """Cells summed by group (C), numbered from 0; -1 leaves a cell out."""
        found = [groups == group for group in range(int(groups.max(initial=-1)) + 1)]
        return GramBlocks(
            products=np.stack([self.products[:, here].sum(axis=1) for here in found], axis=1),
            rows=np.stack([self.rows[:, here].sum(axis=1) for here in found], axis=1),
        )


def gram_blocks(
    parts: Iterable[tuple[slice, Array]], labels: Indices, cells: int, width: int
) -> GramBlocks:
    """Sum the products of parts of recordings.

    Args:
        parts: Rows covered and their columns and torques (m, n, T).
        labels: (n, N) cell of each joint's rows.
        cells: C.
        width: m.
    """
    joints = len(labels)
    # Sorted in one pass where they are short.
    labels = labels.astype(np.min_scalar_type(cells))
    products = np.zeros((joints, cells, width, width))
    rows = np.zeros((joints, cells))
    for covered, values in parts:
        for j in range(joints):
            here = labels[j, covered]
            order = np.argsort(here, kind="stable")
            cell_of = here[order]
            ends = np.flatnonzero(np.diff(cell_of)) + 1
            parted: list[Array] = np.split(values[:, j][:, order], ends, axis=1)
            for cell, part in zip(cell_of[np.append(0, ends)].tolist(), parted, strict=True):
                products[j, cell] += part @ part.T
                rows[j, cell] += part.shape[1]
    return GramBlocks(products=products, rows=rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pick:
    """The columns of one joint that a model uses, and its torque."""

    unknowns: Indices
    """(k) which unknowns of the model act on the joint."""
    columns: Indices
    """(k) where their columns stand in the blocks."""
    torque: int
    """Where the torque stands in the blocks."""
    positive: Mask
    """(k) unknowns that are not allowed below zero; see `signed_solutions`."""


def shared_picks(width: int, joints: int) -> tuple[Pick, ...]:
    """Picks of blocks whose columns all joints share, with one torque behind them."""
    every, signs = np.arange(width), np.zeros(width, dtype=np.bool_)
    return (Pick(unknowns=every, columns=every, torque=width, positive=signs),) * joints


@dataclass(frozen=True, slots=True, kw_only=True)
class Shrinkage:
    """A Gaussian prior on the first unknowns: weight times (v - mean)' precision (v - mean)."""

    mean: Array
    """(r)"""
    precision: Array
    """(r, r), zero along what is not shrunk."""

    def times(self, weight: float) -> Shrinkage:
        """The same prior, stronger by a factor."""
        return Shrinkage(mean=self.mean, precision=weight * self.precision)


class NormalEquations:
    """Normal equations of one model in each cell of some blocks.

    Args:
        blocks: The blocks.
        picks: What each joint uses of them.
        weights: (n) weight of each joint's rows [1/(N.m)].
    """

    def __init__(self, blocks: GramBlocks, picks: Sequence[Pick], weights: Array) -> None:
        self._size = 1 + max(int(pick.unknowns.max()) for pick in picks)
        self._blocks = blocks.products
        self._picks = picks
        self._weights = weights
        self._positive: Mask = np.zeros(self._size, dtype=np.bool_)
        for pick in picks:
            self._positive[pick.unknowns] = pick.positive

    @cached_property
    def matrix(self) -> Array:
        """(C, s, s) weighted products of the columns."""
        matrix = np.zeros((self._blocks.shape[1], self._size, self._size))
        for products, pick, weight in zip(self._blocks, self._picks, self._weights, strict=True):
            _add_products(matrix, products, pick.unknowns, pick.columns, weight**2)
        return matrix

    @cached_property
    def vector(self) -> Array:
        """(C, s) weighted products of columns and torques."""
        vector = np.zeros((self._blocks.shape[1], self._size))
        for products, pick, weight in zip(self._blocks, self._picks, self._weights, strict=True):
            vector[:, pick.unknowns] += weight**2 * products[:, pick.columns, pick.torque]
        return vector

    def whole(self, shrinkage: Shrinkage | None) -> Array:
        """(1, s) the solution of all cells."""
        matrix, vector = self.matrix.sum(axis=0)[None], self.vector.sum(axis=0)[None]
        return solutions(matrix, vector, shrinkage, self._positive)

    @property
    def others(self) -> tuple[Array, Array]:
        """(C, s, s) and (C, s): for each cell the sums of all others, for a lone one its own."""
        if len(self.matrix) == 1:
            return self.matrix, self.vector
        return self.matrix.sum(axis=0) - self.matrix, self.vector.sum(axis=0) - self.vector

    def left_out(self, shrinkage: Shrinkage | None) -> Array:
        """(C, s) for each cell the solution of `others`."""
        return solutions(*self.others, shrinkage, self._positive)

    def square_errors(self, values: Array) -> Array:
        """(n, C) sums of squared errors of values (C, s), or (1, s) for all cells alike."""
        found = np.empty(self._blocks.shape[:2])
        for errors, products, pick in zip(found, self._blocks, self._picks, strict=True):
            _sum_errors(errors, products, pick.columns, pick.torque, values.take(pick.unknowns, 1))
        return np.maximum(found, 0.0)


@compiled()
def _add_products(
    matrix: Array, products: Array, unknowns: Indices, columns: Indices, factor: float
) -> None:
    """Add a joint's products (C, m, m) of some columns (k), times a factor, to (C, s, s)."""
    for cell in range(len(matrix)):
        for a in range(len(columns)):
            for b in range(len(columns)):
                product = products[cell, columns[a], columns[b]]
                matrix[cell, unknowns[a], unknowns[b]] += factor * product


@compiled()
def _sum_errors(
    errors: Array, products: Array, columns: Indices, torque: int, values: Array
) -> None:
    """The sum of squared errors (C) of a joint's values (C, k) or (1, k), in each cell."""
    for cell in range(len(errors)):
        own, block = values[cell if len(values) > 1 else 0], products[cell]
        total = block[torque, torque]
        for a in range(len(columns)):
            inner = -2.0 * block[columns[a], torque]
            for b in range(len(columns)):
                inner += block[columns[a], columns[b]] * own[b]
            total += inner * own[a]
        errors[cell] = total


def solutions(
    matrix: Array, vector: Array, shrinkage: Shrinkage | None, positive: Mask | None = None
) -> Array:
    """Solutions (k, s) of normal equations (k, s, s), (k, s) with a prior.

    Args:
        matrix: (k, s, s)
        vector: (k, s)
        shrinkage: Prior on the first unknowns.
        positive: (s) as in `Pick`; None for none.
    """
    size = matrix.shape[-1]
    ridge = np.full(size, RIDGE)
    if shrinkage is not None:
        r = len(shrinkage.mean)
        # Friction has no prior.
        ridge[:r][np.diag(shrinkage.precision) > 0] = ROUNDING
        matrix, vector = matrix.copy(), vector.copy()
        matrix[:, :r, :r] += shrinkage.precision
        vector[:, :r] += shrinkage.precision @ shrinkage.mean
    scale = np.sqrt(np.maximum(np.diagonal(matrix, axis1=1, axis2=2).max(axis=0), 1e-300))
    systems = matrix / np.outer(scale, scale)
    systems[:, range(size), range(size)] += ridge
    targets = vector / scale
    signs = np.zeros(size, dtype=np.bool_) if positive is None else positive
    return signed_solutions(systems, targets, signs) / scale


def signed_solutions(systems: Array, targets: Array, positive: Mask) -> Array:
    """Solutions (k, m) of systems (k, m, m) with `positive` (m) unknowns not below zero.

    A model that needs negative friction or motor inertia fits this record, not the robot. What
    comes out negative is held at zero and not let go again: close to the constrained minimum,
    which would cost ten times as much.
    """
    # Nothing is held at first.
    values = np.asarray(np.linalg.solve(systems, targets[..., None]), dtype=np.float64)[..., 0]
    held = (values < -1e-6) & positive
    todo = np.flatnonzero(held.any(axis=1))
    while len(todo):
        stiff = HELD * held[todo, :, None] * np.eye(targets.shape[1])
        found = np.linalg.solve(systems[todo] + stiff, targets[todo, :, None])[..., 0]
        values[todo] = found
        wrong = (found < -1e-6) & positive & ~held[todo]
        held[todo] |= wrong
        todo = todo[wrong.any(axis=1)]
    return values


def joint_weights(blocks: GramBlocks, picks: Sequence[Pick], shrinkage: Shrinkage) -> Array:
    """(n) weights 1 / RMS residual of the fit to all cells that uses them.

    Args:
        blocks: The blocks.
        picks: What each joint uses.
        shrinkage: Prior for unit weight; it is multiplied by the number of rows.
    """
    whole = blocks.merged(np.zeros(int(blocks.rows.shape[1]), dtype=np.intp))
    rows = np.maximum(whole.rows.sum(axis=1), 1.0)
    prior = shrinkage.times(float(rows.mean()))
    weights = np.ones(len(picks))
    for _ in range(WEIGHTING_STEPS):
        system = NormalEquations(whole, picks, weights)
        error = system.square_errors(system.whole(prior)).sum(axis=1) / rows
        floor = 1e-18 * whole.products[[*range(len(picks))], 0, [p.torque for p in picks], -1]
        weights = 1.0 / np.sqrt(np.maximum(error, np.maximum(np.abs(floor), 1e-18)))
    return weights
