"""Drive gains from a payload of known mass (Gautier and Briot 2014).

Currents alone leave the scale of all torques open; a payload that was weighed sets it. For
joint j of every record

    k_j current_j = Y_j (own friction, arm) + Y_Lj (payload),

with the payload's mass known. Gautier and Briot solve this as one homogeneous linear problem,
by total least squares. Here the currents carry the noise, not the columns: it is the same model
fitted to the currents, by Gauss-Newton in log k and the parameters, started from the linear
answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError, JobError
from dynid.core.linalg import inverse_upper, upper_triangle
from dynid.identification.drive_gains_system import WeighedSystem, factored
from dynid.identification.shared import SINGULAR, SharedProblem
from dynid.identification.shared_fit import repetitions
from dynid.identification.statistics import correlation_lag, long_run_covariance

ITERATIONS = 50
CONVERGED = 1e-9
RUNAWAY = 30.0
"""Factor from the first gain at which one is lost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WeighedGains:
    """Drive gains from a known payload."""

    gain: Array
    """(n) joint torque per motor current [N.m/A]."""
    std: Array
    """(n) standard deviations that allow for correlated residuals [N.m/A]."""
    payload: Array
    """(10) the payload about the flange: what was known, and the rest as found."""
    noise: Array
    """(R, n) residual standard deviation of each record's joints [A]."""


def weighed_gains(
    problem: SharedProblem, turn: Array, known: Array, start: Array | None = None
) -> WeighedGains:
    """Drive gains of records, some of them with the payload.

    Args:
        problem: The records with currents [A] in place of torques.
        turn: (10, 10) payload about the last link's parameter frame from payload about the
            flange.
        known: (10) the payload about the flange, NaN where unknown; the mass must be known.
        start: (n) gains to start from; None for those of the linear problem, which noise makes
            too small.

    Raises:
        InputError: No loaded or no unloaded record, or an unknown mass.
        JobError: A singular problem, or one that does not converge.
    """
    if not any(problem.loaded) or all(problem.loaded):
        raise InputError("needs records with and without the payload", value=problem.loaded)
    if not known[0] > 0:
        raise InputError("the payload's mass must be known", value=float(known[0]))
    system = WeighedSystem(problem=problem, turn=turn, known=known)
    records, joints = len(problem.problems), problem.joints
    data = factored(system)
    blocks = np.array([item.blocks for item in problem.problems])
    scale = np.linalg.norm(data[2], axis=2) / np.sqrt(blocks)[:, None]
    gain = first = _linear_start(data, scale) if start is None else start
    values = np.zeros(system.size)
    noise = scale
    for _ in range(ITERATIONS):
        _check_scale(gain, first)
        values = _values(data, gain, noise)
        predicted = (data[0] @ values + data[1]) / gain[:, None]
        residual = data[2] - predicted
        # One noise a joint: what all records get wrong alike then cancels.
        used = (system.size + joints) / joints
        total = np.square(residual).sum(axis=(0, 2)) / max(blocks.sum() - used, 1.0)
        noise = np.tile(np.maximum(np.sqrt(total), 1e-9 * scale.max()), (records, 1))
        step, root = _step(data[0], predicted, residual, gain, noise)
        # Half a logarithm at most: far from the answer the linear model is no guide.
        step = step * min(1.0, 0.5 / max(float(np.abs(step[:joints]).max()), 1e-300))
        gain = gain * np.exp(step[:joints])
        if np.abs(step[:joints]).max() < CONVERGED:
            break
    else:
        raise JobError("the drive gains do not converge", value=gain.tolist())
    covariance = _covariance(system, gain, values, noise, root)
    payload = known.copy()
    payload[np.isnan(known)] = values[system.size - int(np.isnan(known).sum()) :]
    return WeighedGains(
        gain=gain,
        std=gain * np.sqrt(np.diag(covariance)[:joints]),
        payload=payload,
        noise=noise,
    )


def _linear_start(data: tuple[Array, Array, Array], scale: Array) -> Array:
    """(n) gains of the homogeneous linear problem, currents among the columns."""
    columns, fixed, current = data
    joints, size = columns.shape[1], columns.shape[3]
    rows: list[Array] = []
    for k in range(len(columns)):
        for j in range(joints):
            part = np.zeros((columns.shape[2], joints + size + 1))
            part[:, j] = current[k, j]
            part[:, joints:-1] = -columns[k, j]
            part[:, -1] = fixed[k, j]
            rows.append(part / scale[k, j])
    gain = _solved(np.vstack(rows))[0][:joints]
    return gain


def _check_scale(gain: Array, first: Array) -> None:
    """Refuse gains that run away: nothing holds them."""
    wrong = ~((first > 0) & (gain < RUNAWAY * first) & (gain > first / RUNAWAY))
    if wrong.any():
        raise JobError(
            "the payload does not set the scale of every joint's current",
            value=f"joints {', '.join(str(j + 1) for j in np.flatnonzero(wrong))}",
            next_step="Use a heavier payload off the last axis, or a motion that loads and "
            "accelerates every joint.",
        )


def _values(data: tuple[Array, Array, Array], gain: Array, noise: Array) -> Array:
    """The best parameters for given gains."""
    columns, fixed, current = data
    rows = np.concatenate([columns, (current * gain[:, None] - fixed)[..., None]], axis=3)
    rows = rows / (noise * gain)[:, :, None, None]
    return _solved(rows.reshape(-1, rows.shape[-1]))[0]


def _step(
    columns: Array, predicted: Array, residual: Array, gain: Array, noise: Array
) -> tuple[Array, Array]:
    """A Gauss-Newton step in log gain and parameters, and the root of the information."""
    records, joints, height, size = columns.shape
    rows = np.zeros((records, joints, height, joints + size + 1))
    for j in range(joints):
        rows[:, j, :, j] = -predicted[:, j]
        rows[:, j, :, joints:-1] = columns[:, j] / gain[j]
    rows[..., -1] = residual
    rows /= noise[:, :, None, None]
    return _solved(rows.reshape(-1, joints + size + 1))


def _solved(rows: Array) -> tuple[Array, Array]:
    """Least squares for [A b] with columns of unit norm, and the triangular root of A'A."""
    norms = np.linalg.norm(rows[:, :-1], axis=0)
    if (norms == 0).any():
        raise JobError("a parameter has no effect on any current of these recordings")
    upper = upper_triangle(rows / np.append(norms, 1.0))
    root = upper[:-1, :-1]
    pivots = np.abs(np.diag(root))
    if pivots.min() < SINGULAR * pivots.max():
        raise JobError(
            "the records and the payload leave a gain or a parameter open",
            value=f"smallest pivot {pivots.min():.1e}",
            next_step="Record motions that load and accelerate every joint.",
        )
    return inverse_upper(root) @ upper[:-1, -1] / norms, root * norms


def _covariance(
    system: WeighedSystem, gain: Array, values: Array, noise: Array, root: Array
) -> Array:
    """Sandwich of Newey-West covariances, as `shared_fit`, of log gains and parameters."""
    problem, joints = system.problem, len(gain)
    inverse = inverse_upper(root)
    naive = inverse @ inverse.T
    long_run = np.zeros_like(naive)
    for group in repetitions(problem):
        rows = min(problem.problems[k].blocks for k in group)
        summed, lag = np.zeros((len(naive), rows)), 1
        for k in group:
            blocks = problem.problems[k].blocks
            scores, residual = np.zeros((len(naive), blocks)), np.empty((joints, blocks))
            for part, columns, current in problem.chunks(k):
                wide, fixed = system.spread(k, columns)
                predicted = (np.tensordot(values, wide, axes=1) + fixed) / gain[:, None]
                residual[:, part] = current - predicted
                weighted = residual[:, part] / np.square(noise[k])[:, None]
                scores[:joints, part] = -predicted * weighted
                scores[joints:, part] = np.einsum(
                    "rjt,jt->rt", wide, weighted / gain[:, None], optimize=True
                )
            lag = max(lag, correlation_lag(residual, problem.problems[k].rate_hz))
            summed += scores[:, :rows]
        short = 1.0 / max(1.0 - 2.0 * lag / rows, 0.5)
        long_run += short * long_run_covariance(summed, lag)
    covariance = naive @ long_run @ naive
    lift = np.sqrt(np.maximum(np.diag(naive) / np.maximum(np.diag(covariance), 1e-300), 1.0))
    return covariance * lift[:, None] * lift[None, :]
