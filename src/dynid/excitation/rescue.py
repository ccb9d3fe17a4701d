"""Where no start came free of limits and bodies: grow a motion out of a pose that is free.

In a tight cell hardly any random motion is free, and descents from those that are not end in
corners. Poses are far easier to find: many are tried, the roomiest are moved to where more room
is, and small motions about them are improved like any other, which keeps them free.
"""

from __future__ import annotations

import numpy as np

from dynid.constraints.motion import MotionConstraints
from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.excitation.candidate import Candidate, Found, Stop
from dynid.excitation.evaluation import DesignEvaluation
from dynid.excitation.gradient import improve, judged
from dynid.excitation.region import MotionRegion
from dynid.excitation.starts import random_numbers

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
