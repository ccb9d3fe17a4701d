"""The way to the start pose: straight where that is free, else through planned way points."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dynid.constraints.certificate import Certificate, certify
from dynid.constraints.motion import MotionConstraints
from dynid.core.arrays import Array
from dynid.experiment.way_search import FreeSpace, find_way
from dynid.trajectory.quintic import Quintic

APPROACH_SPEED = 0.5
"""Joint speed of the way to the start [rad/s]."""
SEARCHES = (
    *[(0.005, 400)] * 2,
    *[(0.002, 400)] * 4,
    *[(0.001, 400)] * 6,
    *[(0.0003, 400)] * 3,
    (0.0003, 1500),
)
"""Distances kept beyond the clearance in one search after the other [m], and the growths of its
trees: trees that have not met early rarely do, new ones may."""
_NEAR = 1e-3
_PEAK = 15.0 / 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """How a robot gets from where it stands to the start of a motion."""

    poses: Array
    """(k, n) where it stands, way points, the start; `movej` takes each straight way between
    two of them and rests at its end [rad or m]."""
    refused: Certificate | None = None
    """Of the straight way, if no way was found; None if the way is certified."""

    @property
    def free(self) -> bool:
        """Whether the way was certified from pose to pose."""
        return self.refused is None

    @property
    def via(self) -> tuple[Array, ...]:
        """Way points, each (n), without both ends [rad or m]."""
        return tuple(self.poses[1:-1])

    @property
    def length(self) -> float:
        """Sum over the straight ways of the largest joint motion [rad or m]."""
        return float(np.abs(np.diff(self.poses, axis=0)).max(axis=1).sum())

    def describe(self) -> str:
        """The way in words."""
        if self.length <= _NEAR:
            return "already there"
        points = len(self.poses) - 2
        if points == 0:
            return f"{self.length:.3g} rad"
        return f"{points} way point{'s' if points > 1 else ''}, {self.length:.3g} rad"


def plan_approach(
    q: Array, start: Array, constraints: MotionConstraints, *, seed: int = 0
) -> Approach:
    """Find and certify a way to the start.

    Args:
        q: (n) where the robot stands [rad or m].
        start: (n) the start of the motion [rad or m].
        constraints: What the way is held to.
        seed: Of the search; the same seed gives the same way.

    Returns:
        The straight way where it passes the certificate, else one through way points, each
        straight piece certified; if none was found, the straight way and its verdict.
    """
    straight = np.stack([q, start])
    if np.abs(start - q).max() <= _NEAR:
        return Approach(poses=straight)
    verdict = certify_straight(q, start, constraints)
    if verdict.feasible:
        return Approach(poses=straight)
    for number, (room, growths) in enumerate(SEARCHES):
        space = FreeSpace(constraints, q, start, speed=APPROACH_SPEED, room=room)
        poses = find_way(space, np.random.default_rng([seed, number]), growths)
        if poses is not None and all(
            certify_straight(a, b, constraints).feasible for a, b in pairwise(poses)
        ):
            return Approach(poses=poses)
    return Approach(poses=straight, refused=verdict)


def certify_straight(a: Array, b: Array, constraints: MotionConstraints) -> Certificate:
    """Certify the straight way in joint space from a (n) to b (n), as `movej` takes it."""
    way = float(np.abs(b - a).max())
    travel = max(_PEAK * way / APPROACH_SPEED, 0.1)
    return certify(Quintic(start=a, goal=b, travel_time=travel), constraints)
