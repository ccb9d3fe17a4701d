"""How late torques were recorded, measured before anything else is chosen.

A delay and friction that builds up late look alike where a joint reverses, and not elsewhere: all
friction that is known stands beside the delays, at once and without a choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.core import Array
from dynid.identification.selection.columns import LOAD, CandidateColumns, JointChoice
from dynid.identification.selection.gram import RIDGE, joint_weights
from dynid.identification.selection.scoring import (
    LEAST_GAIN,
    PRIOR_OF_PLAIN,
    CandidateBlocks,
    Scores,
    ScoreSearch,
)
from dynid.signals import ProcessingSettings

LONGEST_DELAY_S = 0.08
DELAY_STEP_S, FINE_STEP_S = 0.008, 0.002
"""Between delays that are tried, and between those beside the best where the rate allows."""


def measured_delays(search: ScoreSearch, settings: ProcessingSettings) -> tuple[float, ...] | None:
    """How much later each joint's torque was recorded than its motion [s]; None for not at all.

    Beside every column of friction that is known here, those of presliding among them: what
    only looks like a delay when a joint reverses is not one. Each delay must lower the errors
    on what is left out by more than its standard error, on every partition.

    Args:
        search: The recordings.
        settings: Without delays.
    """
    smooth = settings.torque_filter
    if smooth is not None and smooth.cutoff_hz * LONGEST_DELAY_S < 0.5:
        # The filter has spread every reversal over more time than any delay.
        return None
    rate, n = search.recordings[0].rate_hz, search.robot.joints
    extras = tuple(term for term in search.columns.extras if term != LOAD)
    columns = replace(search.columns, extras=extras)
    places = [tuple(range(len(columns.positive)))] * n
    found, reach = np.zeros(n), LONGEST_DELAY_S
    steps = [max(1, round(length * rate)) / rate for length in (DELAY_STEP_S, FINE_STEP_S)]
    for step in dict.fromkeys(steps):
        # On the samples: between them straight lines take noise away, and would be preferred.
        near = np.round(found * rate) / rate
        count = max(1, round(reach / step))
        trials = np.asarray(np.arange(-count, count + 1) * step, dtype=np.float64)
        blocks = search.summed(settings, columns, near + trials[:, None])
        found, reach = near + _best_delays(search, blocks, columns, places, trials), 2 * step
    near = np.where(np.abs(found) < LONGEST_DELAY_S, np.round(found * rate) / rate, 0.0)
    blocks = search.summed(settings, columns, np.stack([np.zeros(n), near]))
    taken = (near != 0).astype(int).tolist()
    prior = search.prior.times(PRIOR_OF_PLAIN)

    def scored(which: list[int]) -> Scores:
        picks = search.picks_at(places, columns, which)
        weights = joint_weights(blocks.all, picks, prior, search.positive(picks))
        return search.errors_of(blocks, picks, weights, PRIOR_OF_PLAIN)

    for j in np.argsort(np.abs(near)):
        if taken[j]:
            without = [*taken[:j], 0, *taken[j + 1 :]]
            gains = scored(taken).gains(scored(without))
            if min(gain - error for gain, error in gains) < LEAST_GAIN:
                taken = without
    return tuple(np.where(taken, found, 0.0).tolist()) if any(taken) else None


def refined_delays(
    search: ScoreSearch, settings: ProcessingSettings, choices: tuple[JointChoice, ...]
) -> tuple[float, ...] | None:
    """The delays of the settings, measured again beside the friction that was chosen."""
    if settings.delays_s is None:
        return None
    rate, late = search.recordings[0].rate_hz, np.array(settings.delays_s)
    step = max(1, round(FINE_STEP_S * rate)) / rate
    near = np.round(late * rate) / rate
    trials = np.asarray(np.arange(-2, 3) * step, dtype=np.float64)
    blocks = search.summed(
        replace(settings, delays_s=None), search.columns, near + trials[:, None] * (late != 0)
    )
    places = [search.columns.places(j, c.step, c.terms) for j, c in enumerate(choices)]
    by = _best_delays(search, blocks, search.columns, places, trials)
    return tuple(np.where(late != 0, np.round(near + by, 4), 0.0).tolist())


def _best_delays(
    search: ScoreSearch,
    blocks: CandidateBlocks,
    columns: CandidateColumns,
    places: Sequence[tuple[int, ...]],
    delays: Array,
) -> Array:
    """(n) the delays that fit best, of those whose torques stand in the blocks.

    With the torques t of all joints at all delays side by side and s a choice of one a joint,
    the squared error of the best fit to t s is s' (t't - t'W (W'W)^-1 W't) s: one solution
    serves all choices.
    """
    n, rank, count = search.robot.joints, search.base.rank, len(delays)
    products = blocks.all.products.sum(axis=1)
    size, torque = rank + sum(map(len, places)), rank + len(columns.positive) + np.arange(count)
    shrinkage = search.prior.times(PRIOR_OF_PLAIN * blocks.rows)
    chosen = np.full(n, int(np.argmin(np.abs(delays))))
    joints, costs = np.arange(n), np.empty((n, count))
    for _ in range(2):
        picks = search.picks_at(places, columns, chosen.tolist())
        weights = joint_weights(
            blocks.all, picks, search.prior.times(PRIOR_OF_PLAIN), search.positive(picks)
        )
        matrix, cross = np.zeros((size, size)), np.zeros((size, n * count + 1))
        energy = np.zeros((n * count + 1, n * count + 1))
        matrix[:rank, :rank] = shrinkage.precision
        cross[:rank, -1] = shrinkage.precision @ shrinkage.mean
        for j, pick in enumerate(picks):
            here, there, weight = pick.unknowns, pick.columns, weights[j] ** 2
            at = j * count + np.arange(count)
            matrix[np.ix_(here, here)] += weight * products[j][np.ix_(there, there)]
            cross[np.ix_(here, at)] = weight * products[j][np.ix_(there, torque)]
            energy[np.ix_(at, at)] = weight * products[j][np.ix_(torque, torque)]
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        solved = np.linalg.solve(
            matrix / np.outer(scale, scale) + RIDGE * np.eye(size), cross / scale[:, None]
        )
        square = energy - (cross / scale[:, None]).T @ solved
        together = [
            float(square[np.ix_(k, k)].sum())
            for k in (np.append(joints * count + d, n * count) for d in range(count))
        ]
        chosen = np.full(n, int(np.argmin(together)))
        for _ in range(2 * n):
            before = chosen.copy()
            for j in range(n):
                others = np.append(np.delete(joints * count + chosen, j), n * count)
                at = j * count + np.arange(count)
                costs[j] = np.diag(square)[at] + 2.0 * square[np.ix_(at, others)].sum(axis=1)
                chosen[j] = int(np.argmin(costs[j]))
            if (chosen == before).all():
                break
    inner = np.clip(chosen, 1, count - 2)
    left, middle, right = (costs[joints, inner + k] for k in (-1, 0, 1))
    bend = np.maximum(left - 2.0 * middle + right, 1e-300)
    between = np.clip(0.5 * (left - right) / bend, -0.5, 0.5)
    step = float(delays[1] - delays[0])
    return delays[chosen] + np.where(inner == chosen, between * step, 0.0)
