"""Many recordings of one robot: shared inertias, and a friction state of each recording.

Of a recording only its sufficient statistics are needed: for each joint the triangular factor of
[friction columns of the joint, shared columns, torque]. The friction columns come first, so their
elimination does not depend on weights, and recordings are pooled by sums of small Gram matrices.
Memory grows with recordings by some 50 kB each, and a new recording costs its own pass alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.core import Array, JobError, Mask, upper_triangle
from dynid.identification.problem import IdentificationProblem
from dynid.identification.shared import SharedProblem, friction_parameters, friction_places
from dynid.identification.statistics import correlation_lag, long_run_covariance, raised
from dynid.reduction import BaseParametrization, acting_joints

ROUNDS = 6
"""Rounds of weighting each joint of each recording by its own noise."""
UNRESOLVED = 1e-9
"""Eigenvalue over the largest, columns of unit norm, below which no recording shows a direction."""
UNSEEN_SHARE = 1e-3
"""Share of a parameter among unresolved directions from which it is not resolved."""
CERTAIN = 3.0
"""Standard deviations by which a recording lacks torque, to be left out."""
MOVING = 0.02
"""Share of a joint's highest speed from which it counts as moving."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordStatistics:
    """What a recording contributes; f friction columns a joint at most, s shared columns."""

    factors: Array
    """(n, f + s + 1, f + s + 1) triangular factors; missing friction columns are zero."""
    scores: Array
    """(n, f, f) long-run covariance of the sums of friction column times residual."""
    samples: int
    """Rows a joint."""
    speed: Array
    """(n) mean speed of each joint while it moves [rad/s or m/s]; 0 where it never does."""


def shared_names(base: BaseParametrization) -> list[str]:
    """(s) names of the base parameters that recordings share."""
    own = set(friction_parameters(base))
    return [name for k, name in enumerate(base.names) if k not in own]


def friction_names(base: BaseParametrization) -> list[list[str]]:
    """For each joint, the names of its own friction parameters, the first in `RobotStates`."""
    own = friction_parameters(base)
    return [[base.names[own[c]] for c in place] for place in friction_places(base)]


def _acting_places(base: BaseParametrization) -> list[list[int]]:
    """For each joint, which of `friction_parameters` act on it, its own first.

    Of a motor that drives several joints, each of these has a value of its own.
    """
    acting, first = acting_joints(base.model), 10 * base.model.robot.joints
    found = friction_places(base)
    for j, place in enumerate(found):
        for c, k in enumerate(friction_parameters(base)):
            if c not in place and acting[base.independent[k] - first, j]:
                place.append(c)
    return found


def _moving(speed: Array) -> Mask:
    """(N, n) where each joint moves, of its speeds (N, n) at N times or in N recordings."""
    return speed > MOVING * speed.max(axis=0)


def record_statistics(item: IdentificationProblem) -> RecordStatistics:
    """Sufficient statistics of one recording, in two passes over its samples."""
    alone, places = SharedProblem(problems=(item,)), _acting_places(item.base)
    own, widest = len(alone.own), max(len(place) for place in places)
    width = widest + alone.shared + 1
    factors = np.zeros((alone.joints, width, width))
    for found, whole, place in zip(factors, alone.factors(0), places, strict=True):
        rows = np.zeros((len(whole), width))
        rows[:, : len(place)] = whole[:, place]
        rows[:, widest:] = whole[:, own:]
        found[:] = upper_triangle(rows)
    # The residuals' correlation hardly depends on the parameters: those of this recording serve.
    rest = factors[None, :, widest:, widest:]
    level = np.linalg.norm(factors[..., -1], axis=1)[None]
    local = _pooled(rest, np.maximum(level, 1e-9 * max(float(level.max()), 1e-9)))[0]
    values = np.tile(np.concatenate([np.zeros(own), local]), (alone.joints, 1))
    whole, lever, _ = _friction(factors, local)
    for row, friction, place in zip(values, whole - lever, places, strict=True):
        row[place] = friction[: len(place)]
    scores = np.zeros((alone.joints, widest, item.blocks))
    residual = np.empty((alone.joints, item.blocks))
    for part, columns, torque in alone.chunks(0):
        residual[:, part] = torque - np.einsum("jc,cjt->jt", values, columns)
        for j, place in enumerate(places):
            scores[j, : len(place), part] = columns[place, j] * residual[j, part]
    lag = correlation_lag(residual, item.rate_hz)
    short = 1.0 / max(1.0 - 2.0 * lag / item.blocks, 0.5)
    speed = np.abs(item.samples.dq)
    moves = _moving(speed)
    return RecordStatistics(
        factors=factors,
        scores=np.array([short * long_run_covariance(one, lag) for one in scores]),
        samples=item.blocks,
        speed=np.where(moves, speed, 0.0).sum(axis=0) / np.maximum(moves.sum(axis=0), 1),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotStates:
    """What the recordings of one robot say together."""

    shared: Array
    """(s) shared parameters, the inertias."""
    shared_std: Array
    """(s) their standard deviations, by the scatter between recordings; NaN where none of the
    recordings shows the parameter."""
    friction: Array
    """(R, n, f) friction parameters of each recording and joint; NaN where it stands still."""
    covariance: Array
    """(R, n, f, f) their covariance, correlated residuals allowed for; NaN there too."""
    speed: Array
    """(n) median over the recordings of its mean speed where it moves [rad/s or m/s]."""
    scale: Array
    """(R, n) measured over predicted torque of the inertias: 1 where neither the inertias nor the
    drive gain of the joint moved."""
    scale_std: Array
    """(R, n)"""
    noise: Array
    """(R, n) residual standard deviation [N.m or N]."""

    @property
    def strange(self) -> Mask:
        """(R) recordings of another arm, or with wrong signs.

        In most of their joints that show inertias, less than half of the shared inertias' torque is
        found, so that none at all predicts better; and that is sure.
        """
        lacking = self.scale + CERTAIN * self.scale_std < 0.5
        return 2 * lacking.sum(axis=1) > np.isfinite(self.scale_std).sum(axis=1)

    def level(self, weights: Array) -> tuple[Array, Array]:
        """(R, n) a combination of the friction parameters, and its standard deviation.

        By weights (n, f) such as 1 for Coulomb, a speed for viscous friction.
        """
        variance = np.einsum("jf,rjfg,jg->rj", weights, self.covariance, weights)
        return np.einsum("rjf,jf->rj", self.friction, weights), np.sqrt(np.maximum(variance, 0.0))


def solve_robot(statistics: Sequence[RecordStatistics]) -> RobotStates:
    """Pool the recordings, at least one, of one robot and one model.

    Raises:
        JobError: Recordings in which nothing moves.
    """
    factors = np.array([one.factors for one in statistics])
    samples = np.array([one.samples for one in statistics], dtype=np.float64)[:, None]
    noise = np.linalg.norm(factors[..., -1], axis=2) / np.sqrt(samples)
    least = 1e-9 * max(float(noise.max()), 1e-9)
    noise = np.maximum(noise, least)
    inner, widest = factors.shape[-1] - 1, statistics[0].scores.shape[-1]
    rest = factors[:, :, widest:, widest:]
    for _ in range(ROUNDS):
        shared = _pooled(rest, noise)[0]
        left = np.linalg.norm(rest @ np.append(shared, -1.0), axis=2)
        noise = np.maximum(left / np.sqrt(np.maximum(samples - inner, 1.0)), least)
    shared, inverse, resolved = _pooled(rest, noise)
    whole, lever, gain = _friction(factors, shared)
    scores = np.array([one.scores for one in statistics])
    bread = gain @ gain.swapaxes(2, 3)
    naive = bread * np.square(noise)[..., None, None]
    # Never below the answer for white residuals.
    covariance = raised(bread @ scores @ bread, np.einsum("rjff->rjf", naive))
    speeds = np.array([one.speed for one in statistics])
    # A joint that stands still shows nothing of its friction.
    moves = _moving(speeds)
    trace = np.einsum("rjff->rj", covariance), np.einsum("rjff->rj", naive)
    inertial = rest[..., :-1] @ shared
    power = np.square(inertial).sum(axis=2)
    seen = power > 0
    scale = np.where(seen, (inertial * rest[..., -1]).sum(axis=2) / np.where(seen, power, 1), 1.0)
    inflation = trace[0] / np.maximum(trace[1], 1e-300)
    std = noise * np.sqrt(np.maximum(inflation, 1.0) / np.where(seen, power, np.nan))
    # Friction goes with the inertias' torque as far as that scatters by more than its noise.
    spread = np.maximum(np.nanmean(np.square(scale - 1.0) - np.square(std), axis=0), 0.0)
    told = np.nan_to_num(spread / (spread + np.square(std)))
    friction = whole - (1.0 + told * (scale - 1.0))[..., None] * lever
    return RobotStates(
        shared=shared,
        shared_std=np.where(resolved, _scatter(rest, noise, shared, inverse), np.nan),
        friction=np.where(moves[..., None], friction, np.nan),
        covariance=np.where(moves[..., None, None], covariance, np.nan),
        speed=np.array(
            [np.median(one[one > 0]) if one.any() else 0.0 for one in (speeds * moves).T]
        ),
        scale=scale,
        scale_std=std,
        noise=noise,
    )


def _pooled(rest: Array, noise: Array) -> tuple[Array, Array, Mask]:
    """Weighted least squares in the shared parameters.

    With factors (R, n, s + 1, s + 1), friction eliminated, and noise (R, n): the parameters (s),
    the inverse of their information (s, s), which are resolved (s).
    """
    rows = rest / noise[..., None, None]
    gram = np.einsum("rjka,rjkb->ab", rows, rows, optimize=True)
    size = np.sqrt(np.diag(gram)[:-1])
    if not size.any():
        raise JobError("nothing moves in these recordings", next_step="Record a motion.")
    scale = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(gram[:-1, :-1] / np.outer(scale, scale))
    seen = values > UNRESOLVED * values[-1]
    turn = vectors[:, seen] / np.sqrt(values[seen])
    inverse = turn @ turn.T / np.outer(scale, scale)
    resolved = np.square(vectors[:, ~seen]).sum(axis=1) < UNSEEN_SHARE
    return inverse @ gram[:-1, -1], inverse, resolved


def _friction(factors: Array, shared: Array) -> tuple[Array, Array, Array]:
    """Friction (..., f) of each joint with no inertias, what these take of it, a root of its gain.

    That root is (..., f, f).
    """
    widest = factors.shape[-1] - 1 - len(shared)
    gain: Array = np.asarray(np.linalg.pinv(factors[..., :widest, :widest]), dtype=np.float64)
    whole = gain @ factors[..., :widest, -1:]
    return whole[..., 0], (gain @ factors[..., :widest, widest:-1]) @ shared, gain


def _scatter(rest: Array, noise: Array, shared: Array, inverse: Array) -> Array:
    """(s) standard deviations of the shared parameters: sandwich, one cluster a recording.

    What the model gets wrong in a recording is then one error, not one a sample.
    """
    rows = rest / noise[..., None, None]
    error = rows @ np.append(shared, -1.0)
    scores = np.einsum("rjka,rjk->ra", rows[..., :-1], error, optimize=True)
    count = len(scores)
    spread = scores.T @ scores * (count / max(count - 1, 1))
    variance = np.diag(inverse @ spread @ inverse) if count > 1 else np.zeros(len(shared))
    return np.sqrt(np.maximum(variance, np.diag(inverse)))
