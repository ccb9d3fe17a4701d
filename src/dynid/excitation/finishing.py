"""From candidates to one certified motion: the certificate decides, and repairs are tried.

Where no start came free of limits and bodies: grow a motion out of a pose that is free.

In a tight cell hardly any random motion is free, and descents from those that are not end in
corners. Poses are far easier to find: many are tried, the roomiest are moved to where more room
is, and small motions about them are improved like any other, which keeps them free.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from dynid.constraints import Certificate, MotionConstraints, certify
from dynid.core import Array, InputError
from dynid.excitation.evaluation import DesignEvaluation
from dynid.excitation.gradient import STAGES, improve, judged
from dynid.excitation.problem import Candidate, Found, Search, Stop
from dynid.excitation.region import MotionRegion, random_numbers
from dynid.trajectory import Trajectory

POSES = 20_000
"""Random poses that are tried."""
FEW = 300
"""Poses of which one that is free ends the question at once."""
_KEPT = 3
"""Of them, from which motions grow."""
_STEPS = (0.3, 0.1, 0.03, 0.01, 0.003)
"""Spread of the steps towards more room [rad or m]."""
_TRIES = 300
"""Of each step."""
_SHAPES = 5
_HALVINGS = 14
_FAR = 0.1
"""Distance that counts as much as a whole torque limit [m]."""

_NEXT = {
    "self_collision": "Check the payload's size and place (metres, in the flange's frame), or the"
    " capsules of the robot.",
    "environment": "Check the scene: metres, in the robot's base frame; shapes are solid.",
    "torque": "Check the torque limits, the masses and the payload; the prediction counts doubt and"
    " friction in.",
}


def rescued(
    evaluation: DesignEvaluation, region: MotionRegion, *, seed: int, stop: Stop, found: Found
) -> list[Candidate]:
    """Candidates that grew out of free poses, best first; none if no pose is free.

    Args:
        evaluation: Judges motions.
        region: The bounds.
        seed: Seed of all random numbers.
        stop: True when there is no more time for improving.
        found: Told each candidate.
    """
    random = np.random.default_rng(seed)
    grown: list[Candidate] = []
    for pose in free_poses(evaluation.constraints, region, random):
        small = _small_motion(evaluation, region, pose, random)
        if small is None:
            continue
        grown.append(small)
        if not stop():
            grown.append(improve(evaluation, region, small, stop=stop, found=found))
        if stop():
            break
    return sorted(grown, key=lambda candidate: candidate.key)


def check_room(constraints: MotionConstraints, region: MotionRegion) -> None:
    """Refuse limits and bodies that leave no pose free, before minutes are spent on a search.

    Args:
        constraints: The judge.
        region: The bounds.

    Raises:
        InputError: No pose was found that keeps every clearance and that the joints can hold.
    """
    random = np.random.default_rng(0)
    if (_room(constraints, _poses(constraints, region, random, FEW)) > 0).any():
        return
    best = _roomiest(constraints, region, random)
    if any(room > 0 for _, room in best):
        return
    pose = max(best, key=lambda item: item[1])[0][None]
    still = np.zeros(pose.shape)
    worst = constraints.usage(pose, still, still).worst
    kind, item = min(worst.items(), key=lambda pair: pair[1].room)
    unit = " m" if item.distance else ""
    raise InputError(
        f"no pose was found in which the arm can stand: {kind.replace('_', ' ')}",
        where=item.what,
        value=f"{item.value:.4g}{unit} at best",
        limit=f"{item.limit:.4g}{unit}",
        next_step=_NEXT.get(kind),
    )


def free_poses(
    constraints: MotionConstraints, region: MotionRegion, random: np.random.Generator
) -> list[Array]:
    """Up to three poses (n) at which the arm can stand, those with the most room.

    Args:
        constraints: The judge.
        region: The bounds; where it has a pose, only that one is tried.
        random: Where the numbers come from.
    """
    return [pose for pose, room in _roomiest(constraints, region, random) if room > 0]


def _poses(
    constraints: MotionConstraints, region: MotionRegion, random: np.random.Generator, count: int
) -> Array:
    if region.pose is not None:
        return region.pose[None]
    half = 0.99 * region.reach[0]
    turning = ~np.array(constraints.robot.prismatic)
    reach = np.where(turning, np.minimum(half, np.pi), half)
    return region.middle + random.uniform(-reach, reach, (count, len(half)))


def _roomiest(
    constraints: MotionConstraints, region: MotionRegion, random: np.random.Generator
) -> list[tuple[Array, float]]:
    """The best of many poses, moved to where more room is, and their room."""
    poses = _poses(constraints, region, random, POSES)
    middle, half = region.middle, 0.99 * region.reach[0]
    room = _room(constraints, poses)
    found: list[tuple[Array, float]] = []
    for pose in poses[np.argsort(-room, kind="stable")[:_KEPT]]:
        near = pose[None]
        for spread in _STEPS if region.pose is None else ():
            step = spread * random.standard_normal((_TRIES, len(middle)))
            near = np.vstack([near[:1], np.clip(near[:1] + step, middle - half, middle + half)])
            near = near[[int(np.argmax(_room(constraints, near)))]]
        found.append((near[0], float(_room(constraints, near)[0])))
    return found


def _room(constraints: MotionConstraints, poses: Array) -> Array:
    """(N) the least of what is left of clearances and of torques at rest; negative if missed."""
    room = np.full(len(poses), 1.0)
    around, settings = constraints.surroundings, constraints.settings
    if around is not None:
        for kind, names in around.names.items():
            if names:
                found = around.bodies.nearest(poses, around=kind == "environment")
                missing = found.distance - settings.clearances[kind]
                room = np.minimum(room, missing / _FAR)
    if constraints.torque is not None:
        still = np.zeros(poses.shape)
        torque, _ = constraints.torque.largest(poses, still, still)
        share = np.nan_to_num(torque / constraints.torque.limits)
        room = np.minimum(room, 1.0 - share.max(axis=1))
    return room


def _small_motion(
    evaluation: DesignEvaluation, region: MotionRegion, pose: Array, random: np.random.Generator
) -> Candidate | None:
    """The largest of some shapes about a pose that keeps every limit; None if none does."""
    best, largest = None, 0.0
    for _ in range(_SHAPES):
        x = random_numbers(region, 1, random, fill=0.5)[0]
        x[:, 0] = pose
        share = 1.0
        for _ in range(_HALVINGS):
            trial = x * np.r_[1.0, np.full(x.shape[1] - 1, share)]
            inside = bool((region.slack(trial) > 0).all())
            if inside and evaluation.violation(trial) == 0.0:
                break
            share /= 2
        else:
            continue
        if share > largest:
            best, largest = judged(evaluation, trial), share
    return best


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
        if seen[-1].certificate.feasible:
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
        if found.certificate.feasible:
            return found
    smaller = _smaller(evaluation, first.x)
    if smaller is not None:
        return smaller
    for candidate in rescued(evaluation, region, seed=0, stop=stop, found=_ignored):
        found = tried(candidate.x, "smaller")
        if found.certificate.feasible:
            return found
    return seen[0]


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
    bounds = problem.constraints.bounds
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
        if found.certificate.feasible:
            best, low = found, share
        else:
            high = share
    return best


def _ignored(candidate: Candidate) -> None:
    """Nobody is told."""
