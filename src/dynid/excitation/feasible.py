"""Poses at which an arm can stand, and motions that grow out of them.

In a tight cell hardly any random motion is free, and descents from those that are not end in
corners. Poses are far easier to find: many are tried, and where none is free the roomiest are
moved to where more room is. A random shape about a free pose is made smaller until it is free.
"""

import numpy as np

from dynid.constraints import MotionConstraints
from dynid.core import Array, InputError
from dynid.excitation.evaluation import DesignEvaluation
from dynid.excitation.region import MotionRegion, random_numbers

POSES = 20_000
"""Random poses that are tried where few are free."""
FEW = 300
"""Poses that are tried first."""
_KEPT = 3
"""Of many, those that are moved to where more room is."""
_STEPS = (0.3, 0.1, 0.03, 0.01, 0.003)
"""Spread of the steps towards more room [rad or m]."""
_TRIES = 300
"""Of each step."""
_SHRINK = 0.7
_SHRINKS = 28
_FAR = 0.1
"""Distance that counts as much as a whole torque limit [m]."""

_NEXT = {
    "self_collision": "Check the payload's size and place (metres, in the flange's frame), or the"
    " bodies of the robot.",
    "environment": "Check the scene: metres, in the robot's base frame; shapes are solid. The"
    " floor is at the mounting plane unless --floor says otherwise.",
    "torque": "Check the torque limits, the masses and the payload; the prediction counts doubt and"
    " friction in.",
}


def check_room(constraints: MotionConstraints, region: MotionRegion) -> None:
    """Refuse limits and bodies that leave no pose free, before minutes are spent on a search.

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
        f"no free pose of the arm was found: {kind.replace('_', ' ')}",
        where=item.what,
        value=f"{item.value:.4g}{unit} at best",
        limit=f"{item.limit:.4g}{unit}",
        next_step=_NEXT.get(kind),
    )


def free_poses(
    constraints: MotionConstraints, region: MotionRegion, random: np.random.Generator
) -> Array:
    """(m, n) poses at which the arm can stand, from all of its range; none if none was found.

    Where the region has a pose, only that one is tried.
    """
    poses = _poses(constraints, region, random, FEW)
    free = poses[_room(constraints, poses) > 0]
    if len(free):
        return free
    return np.array([pose for pose, room in _roomiest(constraints, region, random) if room > 0])


def grown_motion(
    evaluation: DesignEvaluation,
    region: MotionRegion,
    pose: Array,
    random: np.random.Generator,
    *,
    fill: float,
    tighten: float = 0.0,
) -> Array | None:
    """Numbers (n, 1 + k) of a random motion about a pose, as large as the limits let it be.

    The pose (n) is its mean, or its start for families that begin there. It may use the share
    `fill` of the bounds, other limits shrunk by `tighten`. None where even a tiny motion breaks a
    limit.
    """
    x = random_numbers(region, 1, random, fill=fill)[0]
    x[:, 0] = pose
    for _ in range(_SHRINKS):
        inside = bool((region.slack(x) > 0).all())
        if inside and evaluation.search_violation(x, tighten, 0.0) == 0.0:
            return x
        x[:, 1:] *= _SHRINK
    return None


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
    around = constraints.surroundings
    if around is not None:
        for pairs in around.pairs.values():
            room = np.minimum(room, around.bodies.nearest(poses, pairs).room / _FAR)
    if constraints.torque is not None:
        still = np.zeros(poses.shape)
        torque, _ = constraints.torque.largest(poses, still, still)
        share = np.nan_to_num(torque / constraints.torque.limits)
        room = np.minimum(room, 1.0 - share.max(axis=1))
    return room
