"""Distances between the bodies of the arm and from them to the scene."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from dynid.constraints.arm import ArmGeometry, collect, place_point, samples_of
from dynid.constraints.distance import (
    all_distances,
    closest_on_segments,
    group_distance,
    nearest,
    place_capsules,
    place_shapes,
    point_to_segment,
    segment_to_shape,
    signed_distance,
)
from dynid.core import Array, Indices

LENGTH = 0.1
"""The distance that counts as much as a limit exceeded by its whole value [m]."""


@njit(cache=True, error_model="numpy")
def _push(force: Array, moment: Array, x: float, y: float, z: float, way: Array, by: float) -> None:
    """Add the force `by * way` at a point to a link's force (3) and moment (3)."""
    f0, f1, f2 = by * way[0], by * way[1], by * way[2]
    force[0] += f0
    force[1] += f1
    force[2] += f2
    moment[0] += y * f2 - z * f1
    moment[1] += z * f0 - x * f2
    moment[2] += x * f1 - y * f0


@njit(cache=True, error_model="numpy")
def _along(segment: Array, t: float) -> tuple[float, float, float]:
    """The point of a segment (2, 3) at t, 0 to 1."""
    return (
        segment[0, 0] + t * (segment[1, 0] - segment[0, 0]),
        segment[0, 1] + t * (segment[1, 1] - segment[0, 1]),
        segment[0, 2] + t * (segment[1, 2] - segment[0, 2]),
    )


@njit(cache=True, error_model="numpy")
def _from_shapes(
    meetings: Indices,
    nearer: Array,
    groups: Indices,
    link: Indices,
    radius: Array,
    spheres: Array,
    centres: Array,
    shapes: Array,
    placed: Array,
    middles: Array,
    half: Array,
    clearance: float,
    carried: bool,
    force: Array,
    moment: Array,
    way: Array,
) -> float:
    """Sum of squared shortfalls towards shapes; adds what pushes the links away from them.

    Shapes that are carried push back on the last link.
    """
    total = 0.0
    for g in range(len(groups)):
        if group_distance(True, groups[g], spheres, centres, shapes, way) >= clearance:
            continue
        for p in range(groups[g, 2], groups[g, 3]):
            a, b = meetings[p]
            touch = float(radius[a] + clearance - nearer[p])
            x0, x1, x2 = middles[a, 0], middles[a, 1], middles[a, 2]
            if signed_distance(shapes[b], x0, x1, x2, way) >= touch + half[a]:
                continue
            far, t = segment_to_shape(shapes[b], placed[a, 0], placed[a, 1], way)
            if far >= touch:
                continue
            short = (touch - far) / LENGTH
            total += short * short
            x0, x1, x2 = _along(placed[a], t)
            by = -2.0 * short / LENGTH
            _push(force[link[a]], moment[link[a]], x0, x1, x2, way, by)
            if carried:
                # Along the line of action the same moment, wherever on it the shape is hit.
                _push(force[-1], moment[-1], x0, x1, x2, way, -by)
    return total


@njit(cache=True, error_model="numpy")
def shortfalls(
    joints: Array,
    prismatic: Indices,
    link: Indices,
    ends: Array,
    radius: Array,
    spheres: Array,
    shapes: Array,
    carried: int,
    pairs: Indices,
    overlap: Array,
    pair_groups: Indices,
    holds: Indices,
    hold_groups: Indices,
    meetings: Indices,
    nearer: Array,
    meeting_groups: Indices,
    q: Array,
    own: float,
    around: float,
    out: Array,
) -> float:
    """Sum of squared shortfalls of two clearances; adds its derivative (N, n) to `out`."""
    n = q.shape[1]
    turn, origin, axis = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
    placed, way, solids = np.empty((len(link), 2, 3)), np.empty(3), shapes.copy()
    force, moment, centres = np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 3))
    half, middles = np.empty(len(link)), np.empty((len(link), 3))
    for c in range(len(link)):
        square = 0.0
        for r in range(3):
            square += (ends[c, 1, r] - ends[c, 0, r]) ** 2
        half[c] = 0.5 * math.sqrt(square)
    none = np.zeros(len(holds))
    total = 0.0
    for k in range(len(q)):
        place_capsules(joints, link, ends, q[k], turn, origin, axis, placed)
        place_shapes(shapes, carried, turn[n], origin[n], solids)
        for i in range(n + 1):
            place_point(turn[i], origin[i], spheres[i, :3], centres[i])
        for c in range(len(link)):
            middles[c, 0], middles[c, 1], middles[c, 2] = _along(placed[c], 0.5)
        force[:] = 0.0
        moment[:] = 0.0
        before = total
        for g in range(len(pair_groups)):
            if group_distance(False, pair_groups[g], spheres, centres, solids, way) >= own:
                continue
            outer, last, far_off = pair_groups[g, 1], -1, False
            for p in range(pair_groups[g, 2], pair_groups[g, 3]):
                a, b = pairs[p]
                if a != last:
                    # Pairs stand capsule by capsule: one look spares all those of this capsule.
                    last = a
                    far = point_to_segment(centres[outer], placed[a, 0], placed[a, 1])
                    far_off = far >= spheres[outer, 3] + radius[a] + own
                if far_off:
                    continue
                touch = float(radius[a] + radius[b] + own - overlap[p])
                room = touch + half[a] + half[b]
                x0 = middles[a, 0] - middles[b, 0]
                x1 = middles[a, 1] - middles[b, 1]
                x2 = middles[a, 2] - middles[b, 2]
                if x0 * x0 + x1 * x1 + x2 * x2 >= room * room:
                    continue
                far, s, t = closest_on_segments(
                    placed[a, 0], placed[a, 1], placed[b, 0], placed[b, 1]
                )
                if far >= touch:
                    continue
                short = (touch - far) / LENGTH
                total += short * short
                if far <= 0.0:
                    continue
                by = -2.0 * short / LENGTH / far
                x0, x1, x2 = _along(placed[a], s)
                y0, y1, y2 = _along(placed[b], t)
                way[0], way[1], way[2] = x0 - y0, x1 - y1, x2 - y2
                _push(force[link[a]], moment[link[a]], x0, x1, x2, way, by)
                _push(force[link[b]], moment[link[b]], y0, y1, y2, way, -by)
        for inside in (True, False):
            total += _from_shapes(
                holds if inside else meetings,
                none if inside else nearer,
                hold_groups if inside else meeting_groups,
                link,
                radius,
                spheres,
                centres,
                solids,
                placed,
                middles,
                half,
                own if inside else around,
                inside,
                force,
                moment,
                way,
            )
        if total > before:
            collect(origin, axis, prismatic, force, moment, out[k])
    return total


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
