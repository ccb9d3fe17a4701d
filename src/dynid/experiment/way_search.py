"""A search for a free way in joint space: two trees that grow towards each other (RRT-Connect).

Kuffner and LaValle (2000), doi 10.1109/ROBOT.2000.844730, with shortcuts afterwards. Ways are
looked at in samples here; the certificate decides about what is found.
"""

from __future__ import annotations

import numpy as np

from dynid.constraints.motion import MotionConstraints
from dynid.constraints.usage import DISTANCES
from dynid.core.arrays import Array

SPACING = 0.03
"""Largest joint motion between two looks at a way [rad or m]."""
STEP = 0.8
"""Longest growth of a tree at once [rad or m]."""
SHORTCUTS = 40
"""Attempts to leave out a piece of the way that was found."""
_SHARE = 0.02
"""Of each limit that is no distance, kept free."""
_WANDER = np.pi
"""How far the search goes beyond both ends [rad or m]."""
_ROUNDING = 1e-6


class FreeSpace:
    """The poses and straight ways that a judge lets pass.

    Args:
        constraints: The judge.
        q: (n) where the way begins [rad or m].
        goal: (n) where it ends [rad or m].
        speed: Joint speed at which it is taken [rad/s or m/s].
        room: Distance to keep beyond the clearance, where both ends have it too [m].
    """

    def __init__(
        self, constraints: MotionConstraints, q: Array, goal: Array, *, speed: float, room: float
    ) -> None:
        self.q, self.goal = np.array(q, dtype=np.float64), np.array(goal, dtype=np.float64)
        bounds = constraints.settings.bounds
        ends = np.stack([self.q, self.goal])
        self.lower = np.maximum(bounds.lower, ends.min(axis=0) - _WANDER)
        self.upper = np.minimum(bounds.upper, ends.max(axis=0) + _WANDER)
        self._constraints, self._speed = constraints, speed
        # An end that is near something must not lock the robot in.
        at_ends = self._rooms(ends, np.zeros(ends.shape))
        wish = {kind: room if kind in DISTANCES else _SHARE for kind in at_ends}
        self._least = {k: min(wish[k], max(at_ends[k] - _ROUNDING, 0.0)) for k in at_ends}

    def free(self, a: Array, b: Array) -> bool:
        """Whether the straight way from a (n) to b (n) passes in its samples."""
        step = b - a
        way = float(np.abs(step).max())
        if way == 0.0:
            return True
        count = int(np.ceil(way / SPACING)) + 1
        q = a + np.linspace(0.0, 1.0, count)[:, None] * step
        dq = np.broadcast_to(self._speed / way * step, q.shape).copy()
        # What is in the way is most often near the far end: a look there may spare the rest.
        return self._passes(q[-1:], dq[-1:]) and self._passes(q, dq)

    def _passes(self, q: Array, dq: Array) -> bool:
        return all(room >= self._least[kind] for kind, room in self._rooms(q, dq).items())

    def _rooms(self, q: Array, dq: Array) -> dict[str, float]:
        worst = self._constraints.usage(q, dq, np.zeros(q.shape)).worst
        return {kind: item.room for kind, item in worst.items()}


class _Tree:
    """Poses that can be reached from the first one."""

    def __init__(self, root: Array) -> None:
        self.poses, self.parents = [root], [-1]

    def nearest(self, q: Array) -> int:
        return int(np.argmin(np.linalg.norm(np.array(self.poses) - q, axis=1)))

    def grow(self, space: FreeSpace, towards: Array) -> int | None:
        """The number of a new pose one step nearer to another pose; None if it is blocked."""
        base = self.nearest(towards)
        a = self.poses[base]
        away = towards - a
        way = float(np.abs(away).max())
        b = towards if way <= STEP else a + STEP / way * away
        if way == 0.0:
            return base
        if not space.free(a, b):
            return None
        self.poses.append(b)
        self.parents.append(base)
        return len(self.poses) - 1

    def way(self, number: int) -> list[Array]:
        """The poses from the root to one."""
        found: list[Array] = []
        while number >= 0:
            found.append(self.poses[number])
            number = self.parents[number]
        return found[::-1]


def find_way(space: FreeSpace, random: np.random.Generator, growths: int) -> Array | None:
    """A free way from the space's first pose to its goal.

    Args:
        space: Where the way may go.
        random: What decides where the trees grow.
        growths: Attempts to grow before the search gives up.

    Returns:
        (k, n) poses from one end to the other, few of them; None if none was found.
    """
    trees = _Tree(space.q), _Tree(space.goal)
    for number in range(growths):
        one, other = trees if number % 2 == 0 else trees[::-1]
        new = one.grow(space, random.uniform(space.lower, space.upper))
        if new is None:
            continue
        target = one.poses[new]
        met = other.grow(space, target)
        while met is not None and not np.array_equal(other.poses[met], target):
            met = other.grow(space, target)
        if met is not None:
            way = one.way(new) + other.way(met)[-2::-1]
            return _shortened(space, np.array(way if one is trees[0] else way[::-1]), random)
    return None


def _shortened(space: FreeSpace, poses: Array, random: np.random.Generator) -> Array:
    """Fewer poses and a shorter way: what lies between two points of it is left out."""
    poses = _pruned(space, poses)
    for _ in range(SHORTCUTS):
        if len(poses) <= 2:
            break
        i, j = np.sort(random.choice(len(poses) - 1, 2, replace=False))
        u, v = random.uniform(size=2)
        a = poses[i] + u * (poses[i + 1] - poses[i])
        b = poses[j] + v * (poses[j + 1] - poses[j])
        if space.free(a, b):
            poses = np.concatenate([poses[: i + 1], [a, b], poses[j + 1 :]])
            poses = _pruned(space, poses)
    return poses


def _pruned(space: FreeSpace, poses: Array) -> Array:
    """From each pose straight to the farthest one along the way that can be reached."""
    kept, last = [poses[0]], 0
    while last < len(poses) - 1:
        nxt = next(
            (k for k in range(len(poses) - 1, last + 1, -1) if space.free(poses[last], poses[k])),
            last + 1,
        )
        kept.append(poses[nxt])
        last = nxt
    return np.array(kept)
