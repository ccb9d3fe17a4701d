"""From candidates to one certified motion: the certificate decides, and repairs are tried."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from dynid.constraints import Certificate, certify
from dynid.core import Array
from dynid.excitation.evaluation import DesignEvaluation
from dynid.excitation.gradient import STAGES, improve
from dynid.excitation.problem import Candidate, Search, Stop
from dynid.excitation.region import MotionRegion
from dynid.trajectory import Trajectory

TIGHTER = (0.05, 0.1)
"""Shares by which limits shrink when the search's own did not pass the certificate."""
HALVINGS = 7
"""Of the interval in which the largest passing amplitude is sought."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """A motion and the verdict on it."""

    x: Array
    trajectory: Trajectory
    certificate: Certificate
    repair: str
    """What had to be done: empty, `tightened` or `smaller`."""


def finish(
    search: Search, evaluation: DesignEvaluation, region: MotionRegion, *, stop: Stop
) -> Finished:
    """The best motion that passes the certificate.

    Candidates are taken best first. If none passes, the best one is improved again under tighter
    limits, then made smaller until it passes. If nothing helps, the best one comes back with its
    certificate, which says what is broken.

    Args:
        search: What was found; at least one candidate.
        evaluation: Judges motions.
        region: The bounds.
        stop: True when there is no more time for improving; the rest is short.
    """
    tried = partial(_certified, evaluation)
    seen: list[Finished] = []
    for candidate, _ in search.candidates:
        seen.append(tried(candidate.x, ""))
        if seen[-1].certificate.holds:
            return seen[-1]
    first = search.candidates[0][0]
    for share in TIGHTER:
        if stop():
            break
        better = improve(
            evaluation,
            region,
            first,
            stop=stop,
            found=_ignored,
            stages=STAGES[2:],
            tighten=share,
        )
        found = tried(better.x, "tightened")
        if found.certificate.holds:
            return found
    return _smaller(evaluation, first.x) or seen[0]


def without_turns(evaluation: DesignEvaluation, x: Array) -> Array:
    """The same poses, each revolute joint as near to the middle of its range as turns bring it.

    A turn changes neither torques nor distances, but the robot would have to make it on its way
    to the start. A start pose that was asked for is kept.

    Args:
        evaluation: Of the problem.
        x: (n, 1 + k) offset and free numbers of each joint.

    Returns:
        (n, 1 + k) the same with other offsets; what kept the position bounds still does.
    """
    problem = evaluation.problem
    if problem.start_pose is not None:
        return x
    q = problem.family.trajectory(x[:, 0], x[:, 1:]).evaluate(problem.times).q
    bounds = problem.constraints.settings.bounds
    # Of the range, not of the mean: a range that is nearer to the middle cannot leave the bounds.
    away = (q.min(axis=0) + q.max(axis=0) - bounds.lower - bounds.upper) / 2
    turns: Array = np.rint(away / (2 * np.pi))
    turns[np.array(evaluation.constraints.robot.prismatic, dtype=bool)] = 0.0
    if not turns.any():
        return x
    moved = np.array(x)
    moved[:, 0] -= 2 * np.pi * turns
    return moved


def _certified(evaluation: DesignEvaluation, x: Array, repair: str) -> Finished:
    x = without_turns(evaluation, x)
    trajectory = evaluation.problem.family.trajectory(x[:, 0], x[:, 1:])
    certificate = certify(trajectory, evaluation.constraints)
    return Finished(x=x, trajectory=trajectory, certificate=certificate, repair=repair)


def _smaller(evaluation: DesignEvaluation, x: Array) -> Finished | None:
    """The motion about its own mean pose, as large as passes; None if even its pose does not."""
    best: Finished | None = None
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        share = (low + high) / 2
        size = np.ones(x.shape)
        size[:, 1:] = share
        found = _certified(evaluation, x * size, "smaller")
        if found.certificate.holds:
            best, low = found, share
        else:
            high = share
    return best


def _ignored(candidate: Candidate) -> None:
    """Nobody is told."""
