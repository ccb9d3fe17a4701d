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
    """(S, 16) packed shapes."""
    pairs: Indices
    """(P, 2) capsules that must not meet, the one of the inner link first, group by group."""
    overlap: Array
    """(P) how far the capsules of a pair may overlap before the links touch [m]."""
    meetings: Indices
    """(E, 2) capsule and shape that must not meet, group by group."""
    pair_groups: Indices = field(init=False)
    """(G, 4) inner link, outer link, first pair, last pair + 1."""
    meeting_groups: Indices = field(init=False)
    """(G, 4) link, shape, first meeting, last meeting + 1."""

    def __post_init__(self) -> None:
        inner, outer = self.link[self.pairs].T
        object.__setattr__(self, "pair_groups", _runs(inner, outer))
        capsule, shape = self.meetings.T
        object.__setattr__(self, "meeting_groups", _runs(self.link[capsule], shape))

    def distances(self, q: Array) -> tuple[Array, Array]:
        """Signed distances of all pairs.

        Args:
            q: (N, n) positions [rad or m].

        Returns:
            (N, P) between capsules, their overlap added, and (N, E) from capsules to shapes
            [m]. Capsules that intersect deeper than to their middle lines keep their least
            value.
        """
        own = np.empty((len(q), len(self.pairs)))
        around = np.empty((len(q), len(self.meetings)))
        all_distances(
            self.arm.joints,
            self.link,
            self.ends,
            self.radius,
            self.shapes,
            self.pairs,
            self.overlap,
            self.meetings,
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
        groups = self.meeting_groups if around else self.pair_groups
        slack = np.zeros((len(q), len(groups)))
        if way is not None and travel is not None:
            slack = way @ self._rates(groups, around, travel).T
        found = np.empty((2, len(q)))
        pair = np.empty(len(q), dtype=np.intp)
        nearest(
            self.arm.joints,
            self.link,
            self.ends,
            self.radius,
            self.spheres,
            self.shapes,
            self.meetings if around else self.pairs,
            np.zeros(len(self.meetings)) if around else np.array(self.overlap),
            groups,
            around,
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
            self.pairs,
            self.overlap,
            self.pair_groups,
            self.meetings,
            self.meeting_groups,
            samples_of(q),
            own,
            around,
            slope,
        )
        return float(total), slope

    def _rates(self, groups: Indices, around: bool, travel: Array) -> Array:
        """(G, n) how fast each joint can change the distances of a group [m/rad or 1]."""
        reach = np.zeros((self.arm.count + 1, self.arm.count))
        for link, ends in zip(self.link, self.ends, strict=True):
            for end in ends:
                reach[link] = np.maximum(reach[link], self.arm.reach(int(link), end, travel))
        if around:
            return reach[groups[:, 0]]
        rates = reach[groups[:, 1]]
        # Joints up to the inner link move both bodies together.
        for row, inner in zip(rates, groups[:, 0], strict=True):
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
