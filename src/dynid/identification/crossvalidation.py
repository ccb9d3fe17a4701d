"""Cross-validation over contiguous blocks of one record, for many model variants at once.

All variants of friction shape and delay share the same motion. Their columns and torques are
put side by side once, the products are summed block by block, and every variant is then a
small solve on a sub-matrix.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dynid.core import Array, Indices, Mask
from dynid.identification.bayesian import not_negative
from dynid.identification.least_squares import PRIOR_GAIN
from dynid.identification.problem import block_mean, chunk_size, recorded_rows
from dynid.reduction import BaseParametrization
from dynid.signals import Samples

HELD = 1e12
"""Stiffness that holds an unknown of unit columns at zero."""
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
    positive: Mask
    """(r + c) columns whose parameters cannot be negative: friction, motor inertia."""

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
        sums = [self._sums(j, there, torque) for j, (_, there, torque) in enumerate(picks)]
        matrix, vector, energy = _normal_equations(picks, sums, weights)
        total, target = matrix.sum(axis=0), vector.sum(axis=0)
        scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
        size = len(scale)
        prior = np.eye(size) / max(prior_gain**2 * energy, 1e-300)
        # The products square the condition number: keep a margin above rounding.
        prior += 1e-12 * np.eye(size)
        systems = np.concatenate([total[None] - matrix, total[None]]) / np.outer(scale, scale)
        targets = np.concatenate([target[None] - vector, target[None]]) / scale
        positive = np.concatenate(
            [
                self.positive[: self.shared],
                *(self.positive[there[self.shared :]] for _, there, _ in picks),
            ]
        )
        values = signed_solutions(systems + prior, targets, positive) / scale
        held_out = np.empty(len(variants))
        training = np.empty(len(variants))
        for j, (here, _, _) in enumerate(picks):
            square, cross, alone = sums[j]
            held_out[j] = _square_error(square, cross, alone, values[:-1, here])
            # The same parameters in every block.
            training[j] = _square_error(square, cross, alone, values[-1:, here])
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

    def _sums(self, joint: int, there: Indices, torque: int) -> tuple[Array, Array, Array]:
        """Products (BLOCKS, m, m) of one joint's columns, with its torque, of its torque."""
        products = self.products[joint]
        return (
            products[:, there[:, None], there],
            products[:, there, torque],
            products[:, torque, torque],
        )


def _normal_equations(
    picks: list[tuple[Indices, Indices, int]],
    sums: list[tuple[Array, Array, Array]],
    weights: Array,
) -> tuple[Array, Array, float]:
    size = 1 + max(int(here[-1]) for here, _, _ in picks)
    matrix = np.zeros((BLOCKS, size, size))
    vector = np.zeros((BLOCKS, size))
    energy = 0.0
    for weight, (here, _, _), (square, cross, alone) in zip(weights, picks, sums, strict=True):
        matrix[:, here[:, None], here] += weight**2 * square
        vector[:, here] += weight**2 * cross
        energy += weight**2 * float(alone.sum())
    return matrix, vector, energy


def signed_solutions(systems: Array, targets: Array, positive: Mask) -> Array:
    """Solutions (k, m) of systems (k, m, m) with `positive` (m) unknowns not below zero.

    A model that needs negative friction or motor inertia fits this record, not the robot. What
    comes out negative is held at zero and not let go again: close to the constrained minimum,
    which would cost ten times as much.
    """
    held = np.zeros(targets.shape, dtype=bool)
    values = np.empty_like(targets)
    todo = np.arange(len(targets))
    while len(todo):
        stiff = HELD * held[todo, :, None] * np.eye(targets.shape[1])
        found = np.linalg.solve(systems[todo] + stiff, targets[todo, :, None])[..., 0]
        values[todo] = found
        wrong = (found < -1e-6) & positive & ~held[todo]
        held[todo] |= wrong
        todo = todo[wrong.any(axis=1)]
    return values


def _square_error(square: Array, cross: Array, alone: Array, values: Array) -> float:
    """Sum over blocks of squared errors for values (BLOCKS, m), or (1, m) for all blocks."""
    predicted = (square @ values[..., None])[..., 0] - 2.0 * cross
    return float(alone.sum() + (predicted * values).sum())


def accumulate_candidates(
    base: BaseParametrization,
    samples: Samples,
    own_columns: Array,
    torques: Array,
    positive: Mask,
) -> Candidates:
    """Sum the products of one record.

    Args:
        base: Model with the columns that every variant shares.
        samples: Its samples (N).
        own_columns: (n, c, N) candidate columns of each joint.
        torques: (n, d, N) torque of each joint for each delay.
        positive: (c) candidate columns whose parameters cannot be negative.

    Returns:
        The products, ready to score variants.
    """
    model, block, columns = base.model, samples.block, list(base.independent)
    own = samples.as_recorded(own_columns)
    # The torques come in several versions: only what is added to them is wanted here.
    still = replace(samples, tau=np.zeros(samples.q.shape))
    count = base.rank + own.shape[1] + torques.shape[1]
    products = np.zeros((model.robot.joints, BLOCKS, count, count))
    used = samples.rows
    count_used = (used.stop - used.start) // block
    cuts = [used.start + k * count_used // BLOCKS * block for k in range(BLOCKS + 1)]
    step = max(1, chunk_size(samples) // block) * block
    for k, (start, stop) in enumerate(pairwise(cuts)):
        for first in range(start, stop, step):
            part = slice(first, min(first + step, stop))
            stack, known = recorded_rows(model, still, part, columns, None)
            for j in range(model.robot.joints):
                rows = np.vstack([stack[:, j], own[j][:, part], torques[j][:, part] + known[j]])
                rows = block_mean(rows, block)
                products[j, k] += rows @ rows.T
    return Candidates(
        products=products,
        shared=base.rank,
        torques=base.rank + own.shape[1],
        samples=count_used,
        positive=np.concatenate([not_negative(model)[columns], positive]),
    )
