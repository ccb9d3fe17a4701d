"""Distances between the arm's bodies and from them to the scene, and how they change."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dynid.constraints.arm import ArmGeometry, samples_of
from dynid.constraints.collision_kernels import all_distances, nearest
from dynid.constraints.shortfall_kernels import shortfalls
from dynid.core.arrays import Array, Indices


@dataclass(frozen=True, slots=True, kw_only=True)
class Nearest:
    """The nearest pair at each sample."""

    distance: Array
    """(N) its signed distance [m]."""
    pair: Indices
    """(N) its row in the list of pairs."""
    bound: Array
    """(N) what no pair is below while the joints move on; see `Bodies.nearest`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bodies:
    """Capsules on the links, shapes in the base frame, and the pairs that are judged.

    Pairs stand in groups, those of two links or of a link and a shape: a sphere around all
    capsules of a link tells when a whole group is too far away to matter.
    """

    arm: ArmGeometry
    link: Indices
    """(C) the link of each capsule, 0 the base."""
    ends: Array
    """(C, 2, 3) ends of the segments in the joint frames of their links [m]."""
    radius: Array
    """(C) [m]"""
    spheres: Array
    """(n + 1, 4) centre and radius of a sphere around each link's capsules [m]."""
    shapes: Array
    """(S, 16) packed shapes: those of the scene, then what the flange carries, which stands in
    the joint frame of the last link."""
    corners: Array
    """(K, 8, 3) outermost points of the K carried shapes in the last link [m]."""
    pairs: Indices
    """(P, 2) capsules that must not meet, the one of the inner link first, group by group."""
    overlap: Array
    """(P) how far the capsules of a pair may overlap before the links touch [m]."""
    holds: Indices
    """(H, 2) capsule of the arm and carried shape that must not meet, group by group."""
    meetings: Indices
    """(E, 2) capsule and shape of the scene that must not meet, group by group."""
    nearer: Array
    """(E) how much nearer than the clearance a meeting may be [m]."""
    pair_groups: Indices = field(init=False)
    """(G, 4) inner link, outer link, first pair, last pair + 1."""
    hold_groups: Indices = field(init=False)
    """(G, 4) link, carried shape, first hold, last hold + 1."""
    meeting_groups: Indices = field(init=False)
    """(G, 4) link, shape, first meeting, last meeting + 1."""

    def __post_init__(self) -> None:
        inner, outer = self.link[self.pairs].T
        object.__setattr__(self, "pair_groups", _runs(inner, outer))
        for name, rows in (("hold_groups", self.holds), ("meeting_groups", self.meetings)):
            capsule, shape = rows.T
            object.__setattr__(self, name, _runs(self.link[capsule], shape))

    def distances(self, q: Array) -> tuple[Array, Array]:
        """Signed distances of all pairs.

        Args:
            q: (N, n) positions [rad or m].

        Returns:
            (N, P + H) between capsules, their overlap added, and from them to what is carried,
            and (N, E) from capsules to shapes of the scene, `nearer` added [m]. Capsules that
            intersect deeper than to their middle lines keep their least value.
        """
        own = np.empty((len(q), len(self.pairs) + len(self.holds)))
        around = np.empty((len(q), len(self.meetings)))
        all_distances(
            self.arm.joints,
            self.link,
            self.ends,
            self.radius,
            self.shapes,
            len(self.corners),
            self.pairs,
            self.overlap,
            self.holds,
            self.meetings,
            self.nearer,
            samples_of(q),
            own,
            around,
        )
        return own, around

    def nearest(
        self, q: Array, *, around: bool, travel: Array | None = None, way: Array | None = None
    ) -> Nearest:
        """The nearest pair at each sample, and a bound nearby.

        Args:
            q: (N, n) positions [rad or m].
            around: Judge the scene instead of the arm's own bodies.
            travel: (n) largest |q| of each joint anywhere [rad or m].
            way: (N, n) how far each joint may move from q [rad or m]; None for not at all.
        """
        if around:
            groups = self.meeting_groups
            return self._nearest(q, self.meetings, groups, self.nearer, True, travel, way)
        groups = self.pair_groups
        found = self._nearest(q, self.pairs, groups, self.overlap, False, travel, way)
        if not len(self.holds):
            return found
        none = np.zeros(len(self.holds))
        held = self._nearest(q, self.holds, self.hold_groups, none, True, travel, way)
        nearer = held.distance < found.distance
        return Nearest(
            distance=np.where(nearer, held.distance, found.distance),
            pair=np.where(nearer, len(self.pairs) + held.pair, found.pair),
            bound=np.minimum(held.bound, found.bound),
        )

    def _nearest(
        self,
        q: Array,
        pairs: Indices,
        groups: Indices,
        overlap: Array,
        solid: bool,
        travel: Array | None,
        way: Array | None,
    ) -> Nearest:
        """The nearest of some pairs: of capsule and shape if `solid`, else of capsules."""
        slack = np.zeros((len(q), len(groups)))
        if way is not None and travel is not None:
            slack = way @ self._rates(groups, solid, travel).T
        found = np.empty((2, len(q)))
        pair = np.empty(len(q), dtype=np.intp)
        nearest(
            self.arm.joints,
            self.link,
            self.ends,
            self.radius,
            self.spheres,
            self.shapes,
            len(self.corners),
            pairs,
            np.array(overlap),
            groups,
            solid,
            samples_of(q),
            np.ascontiguousarray(slack),
            found,
            pair,
        )
        return Nearest(distance=found[0], pair=pair, bound=found[1])

    def violation(self, q: Array, own: float, around: float) -> tuple[float, Array]:
        """Sum of squared shortfalls of the clearances, in units of `shortfall_kernels.LENGTH`.

        Args:
            q: (N, n) positions [rad or m].
            own: Smallest allowed distance between capsules [m].
            around: Smallest allowed distance to shapes [m].

        Returns:
            The sum over samples and pairs, and its derivative (N, n).
        """
        slope = np.zeros(q.shape)
        total = shortfalls(
            self.arm.joints,
            self.arm.prismatic,
            self.link,
            self.ends,
            self.radius,
            self.spheres,
            self.shapes,
            len(self.corners),
            self.pairs,
            self.overlap,
            self.pair_groups,
            self.holds,
            self.hold_groups,
            self.meetings,
            self.nearer,
            self.meeting_groups,
            samples_of(q),
            own,
            around,
            slope,
        )
        return float(total), slope

    def _rates(self, groups: Indices, solid: bool, travel: Array) -> Array:
        """(G, n) how fast each joint can change the distances of a group [m/rad or 1]."""
        reach = np.zeros((self.arm.count + 1, self.arm.count))
        for link, ends in zip(self.link, self.ends, strict=True):
            for end in ends:
                reach[link] = np.maximum(reach[link], self.arm.reach(int(link), end, travel))
        rates = reach[groups[:, 0 if solid else 1]]
        scene = len(self.shapes) - len(self.corners)
        for row, (inner, other) in zip(rates, groups[:, :2], strict=True):
            if solid and other < scene:
                continue
            if solid:
                points = self.corners[other - scene]
                row[:] = np.max([self.arm.reach(self.arm.count, p, travel) for p in points], axis=0)
            # Joints up to the inner link move both bodies together.
            row[:inner] = 0.0
        return rates


def _runs(first: Indices, second: Indices) -> Indices:
    """(G, 4) both numbers of each run of equal rows, where it starts and where it stops."""
    if not len(first):
        return np.empty((0, 4), dtype=np.intp)
    keys = np.column_stack([first, second])
    starts = np.flatnonzero(np.r_[True, (keys[1:] != keys[:-1]).any(axis=1)])
    stops = np.r_[starts[1:], len(keys)]
    return np.ascontiguousarray(np.column_stack([keys[starts], starts, stops]), dtype=np.intp)
