"""Cross-validation over contiguous blocks of one record, for many model variants at once.

All variants of friction shape and delay share the same motion. Their columns and torques are
put side by side once, the products are summed block by block, and every variant is then a
small solve on a sub-matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dynid.core.arrays import Array, Indices
from dynid.identification.least_squares import PRIOR_GAIN
from dynid.identification.problem import block_mean
from dynid.reduction.base import BaseParametrization
from dynid.regressor.model import CHUNK

BLOCKS = 8
"""Contiguous stretches that are left out in turn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """Which of a joint's candidate columns and torques are used."""

    columns: tuple[int, ...]
    """Indices into the joint's candidate columns."""
    torque: int
    """Index into the joint's candidate torques (delays)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidates:
    """Sums of products of shared columns, candidate columns and candidate torques."""

    products: Array
    """(n, BLOCKS, m, m); order: r shared, c candidates, then a torque a delay."""
    shared: int
    """r, columns every variant has."""
    torques: int
    """Index of the first torque."""
    samples: int
    """N."""

    def score(
        self, variants: tuple[Variant, ...], weights: Array, prior_gain: float = PRIOR_GAIN
    ) -> tuple[Array, Array]:
        """Held-out and training errors of one variant a joint.

        Args:
            variants: n variants.
            weights: (n) weight of each joint [1/(N.m)].
            prior_gain: See `PRIOR_GAIN`.

        Returns:
            (n) mean squared error of predicted against measured torque on the stretches
            left out, and (n) mean squared residual of the fit to all blocks.
        """
        picks = self._picks(variants)
        matrix, vector, energy = self._normal_equations(picks, weights)
        total, target = matrix.sum(axis=0), vector.sum(axis=0)
        scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
        size = len(scale)
        prior = np.eye(size) / max(prior_gain**2 * energy, 1e-300)
        # The products square the condition number: keep a margin above rounding.
        prior += 1e-12 * np.eye(size)
        systems = np.concatenate([total[None] - matrix, total[None]]) / np.outer(scale, scale)
        targets = np.concatenate([target[None] - vector, target[None]]) / scale
        values = np.linalg.solve(systems + prior, targets[..., None])[..., 0] / scale
        held_out = np.empty(len(variants))
        training = np.empty(len(variants))
        for j, (here, there, torque) in enumerate(picks):
            block = self.products[j]
            held_out[j] = sum(
                _square_error(block[k], values[k][here], there, torque) for k in range(BLOCKS)
            )
            training[j] = _square_error(block.sum(axis=0), values[-1][here], there, torque)
        held_out, training = (np.maximum(x / self.samples, 1e-18) for x in (held_out, training))
        return held_out, training

    def _picks(self, variants: tuple[Variant, ...]) -> list[tuple[Indices, Indices, int]]:
        """For each joint: unknowns it touches, where their products stand, its torque."""
        common = np.arange(self.shared)
        picks: list[tuple[Indices, Indices, int]] = []
        first = self.shared
        for variant in variants:
            own = np.arange(first, first + len(variant.columns))
            first += len(own)
            there = self.shared + np.array(variant.columns, dtype=np.intp)
            picks.append(
                (
                    np.concatenate([common, own]),
                    np.concatenate([common, there]),
                    self.torques + variant.torque,
                )
            )
        return picks

    def _normal_equations(
        self, picks: list[tuple[Indices, Indices, int]], weights: Array
    ) -> tuple[Array, Array, float]:
        size = 1 + max(int(here[-1]) for here, _, _ in picks)
        matrix = np.zeros((BLOCKS, size, size))
        vector = np.zeros((BLOCKS, size))
        energy = 0.0
        for j, (here, there, torque) in enumerate(picks):
            square = weights[j] ** 2
            matrix[:, here[:, None], here] += square * self.products[j][:, there[:, None], there]
            vector[:, here] += square * self.products[j][:, there, torque]
            energy += square * float(self.products[j][:, torque, torque].sum())
        return matrix, vector, energy


def _square_error(products: Array, values: Array, columns: Indices, torque: int) -> float:
    quadratic = values @ products[np.ix_(columns, columns)] @ values
    return float(products[torque, torque] - 2 * values @ products[columns, torque] + quadratic)


def accumulate_candidates(
    base: BaseParametrization,
    motion: tuple[Array, Array, Array],
    own_columns: Array,
    torques: Array,
    block: int = 1,
) -> Candidates:
    """Sum the products of one record.

    Args:
        base: Model with the columns that every variant shares.
        motion: q, dq, ddq, each (N, n).
        own_columns: (n, c, N) candidate columns of each joint.
        torques: (n, d, N) torque of each joint for each delay.
        block: Samples to average over, torques and columns alike.

    Returns:
        The products, ready to score variants.
    """
    model = base.model
    q, dq, ddq = motion
    samples = len(q)
    known = model.known_torque(q).T
    count = base.rank + own_columns.shape[1] + torques.shape[1]
    products = np.zeros((model.robot.joints, BLOCKS, count, count))
    edges = np.linspace(0, samples // block, BLOCKS + 1).astype(int) * block
    step = max(1, CHUNK // block) * block
    for k, (start, stop) in enumerate(pairwise(edges)):
        for first in range(start, stop, step):
            part = slice(first, min(first + step, stop))
            stack = model.stack(q[part], dq[part], ddq[part])[list(base.independent)]
            for j in range(model.robot.joints):
                rows = np.vstack(
                    [stack[:, j], own_columns[j][:, part], torques[j][:, part] + known[j, part]]
                )
                rows = block_mean(rows, block)
                products[j, k] += rows @ rows.T
    return Candidates(
        products=products,
        shared=base.rank,
        torques=base.rank + own_columns.shape[1],
        samples=samples // block,
    )
