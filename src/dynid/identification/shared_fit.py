"""Weighted least squares over several records: unequal noise, and deviations to believe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.core.linalg import inverse_upper
from dynid.identification.problem import IdentificationProblem
from dynid.identification.shared import SharedProblem, SharedSolution, solve_shared
from dynid.identification.statistics import correlation_lag, long_run_covariance

MAX_ITERATIONS = 20
TOLERANCE = 1e-4
"""Stop when no noise changes by more than this share."""
SAME_LENGTH = 0.01
"""Records of one motion differ in length by no more than this share ..."""
SAME_PLACE = 0.02
"""... and at no instant in position, over each joint's range."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedFit:
    """A weighted solution with its noise and covariance."""

    solution: SharedSolution
    noise: Array
    """(R, n) residual standard deviation of each record's joints [N.m or N]."""
    covariance: Array
    """(R f + s, R f + s) covariance that allows for correlated residuals."""
    naive: Array
    """The same if residuals were white."""

    def places(self, record: int) -> list[int]:
        """(f + s) where a record's parameters stand in the covariance."""
        records, own = self.solution.own.shape
        return [
            *range(record * own, (record + 1) * own),
            *range(records * own, len(self.covariance)),
        ]


def fit_shared(problem: SharedProblem, *, one_noise: bool = False) -> SharedFit:
    """Fit, weighting each joint of each record by its own noise, iterated.

    Args:
        problem: The records.
        one_noise: Weight a joint alike in all records: errors that records share, as of a
            model that both get wrong, then cancel in their difference.

    Raises:
        JobError: A singular problem.
    """
    factors = np.array([problem.factors(k) for k in range(len(problem.problems))])
    blocks = np.array([item.blocks for item in problem.problems])
    own = len(problem.own)
    scale = np.linalg.norm(factors[..., -1], axis=2) / np.sqrt(blocks)[:, None]
    scale = np.where(scale > 0, scale, 1.0)
    noise = pooled_noise(scale, blocks) if one_noise else scale
    solution = solve_shared(factors, 1.0 / noise, own)
    for _ in range(MAX_ITERATIONS):
        update = _noise(factors, solution, blocks, scale)
        if one_noise:
            update = pooled_noise(update, blocks)
        change = np.abs(update / noise - 1).max()
        noise = update
        solution = solve_shared(factors, 1.0 / noise, own)
        if change < TOLERANCE:
            break
    inverse = inverse_upper(solution.information)
    naive = inverse @ inverse.T
    return SharedFit(
        solution=solution,
        noise=noise,
        covariance=_covariance(problem, solution, 1.0 / noise, naive),
        naive=naive,
    )


def pooled_noise(noise: Array, blocks: Array) -> Array:
    """(R, n) the root mean square over records in each record's place."""
    mean = np.sqrt(np.average(np.square(noise), axis=0, weights=blocks))
    return np.tile(mean, (len(noise), 1))


def _noise(factors: Array, solution: SharedSolution, blocks: Array, scale: Array) -> Array:
    records, own = solution.own.shape
    found = np.empty(scale.shape)
    for k in range(records):
        norms = np.linalg.norm(factors[k] @ np.append(solution.local(k), -1.0), axis=1)
        used = own + len(solution.shared) * blocks[k] / blocks.sum()
        found[k] = norms / np.sqrt(max(blocks[k] - used / scale.shape[1], 1.0))
    # A joint that fits to rounding would get an infinite weight.
    return np.maximum(found, 1e-9 * np.maximum(scale, 1e-9))


def _covariance(
    problem: SharedProblem, solution: SharedSolution, weights: Array, naive: Array
) -> Array:
    """Sandwich of the Newey-West covariances of the scores.

    As `statistics.hac_covariance`, and never below the naive answer. The scores of records that
    repeat one motion are added instant by instant: what the model gets wrong there is the same
    in all of them, and says nothing about their difference.
    """
    records, own = solution.own.shape
    long_run = np.zeros_like(naive)
    total = sum(item.blocks for item in problem.problems)
    for group in repetitions(problem):
        rows = min(problem.problems[k].blocks for k in group)
        summed, lag = np.zeros((len(naive), rows)), 1
        for k in group:
            scores, residual = _scores(problem, k, solution.local(k), weights[k])
            lag = max(lag, correlation_lag(residual, problem.problems[k].rate_hz))
            summed[k * own : (k + 1) * own] += scores[:own, :rows]
            summed[records * own :] += scores[own:, :rows]
        used = own * len(group) + len(solution.shared) * rows * len(group) / total
        freedom = rows / max(rows - used / (problem.joints * len(group)), 1.0)
        short = 1.0 / max(1.0 - 2.0 * lag / rows, 0.5)
        long_run += freedom * short * long_run_covariance(summed, lag)
    covariance = naive @ long_run @ naive
    lift = np.sqrt(np.maximum(np.diag(naive) / np.maximum(np.diag(covariance), 1e-300), 1.0))
    return covariance * lift[:, None] * lift[None, :]


def repetitions(problem: SharedProblem) -> list[list[int]]:
    """The records, those that repeat one motion together."""
    groups: list[list[int]] = []
    for k, item in enumerate(problem.problems):
        for group in groups:
            if _same_motion(problem.problems[group[0]], item):
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _same_motion(a: IdentificationProblem, b: IdentificationProblem) -> bool:
    if abs(a.blocks - b.blocks) > SAME_LENGTH * a.blocks or a.rate_hz != b.rate_hz:
        return False
    rows = min(a.samples.count, b.samples.count)
    apart = np.abs(a.samples.q[:rows] - b.samples.q[:rows]).max(axis=0)
    return bool((apart <= SAME_PLACE * np.ptp(a.samples.q, axis=0)).all())


def _scores(
    problem: SharedProblem, record: int, values: Array, weights: Array
) -> tuple[Array, Array]:
    """Scores (w, N) and residuals (n, N) of a record."""
    blocks = problem.problems[record].blocks
    scores, residual = np.empty((len(values), blocks)), np.empty((problem.joints, blocks))
    for part, columns, torque in problem.chunks(record):
        residual[:, part] = torque - np.tensordot(values, columns, axes=1)
        weighted = residual[:, part] * np.square(weights)[:, None]
        scores[:, part] = np.einsum("rjt,jt->rt", columns, weighted, optimize=True)
    return scores, residual
