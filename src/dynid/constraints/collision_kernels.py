"""The compiled part of `collision`: distances."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dynid.constraints.arm import place_joints, place_point
from dynid.constraints.distance import (
    closest_on_segments,
    point_to_segment,
    segment_to_shape,
    signed_distance,
)
from dynid.core.arrays import Array, Indices


@njit(cache=True, error_model="numpy")
def place_capsules(
    joints: Array,
    link: Indices,
    ends: Array,
    q: Array,
    turn: Array,
    origin: Array,
    axis: Array,
    placed: Array,
) -> None:
    """Write the capsules' ends in the base frame (C, 2, 3)."""
    place_joints(joints, q, turn, origin, axis)
    for c in range(len(link)):
        for side in range(2):
            place_point(turn[link[c]], origin[link[c]], ends[c, side], placed[c, side])


@njit(cache=True, error_model="numpy")
def place_shapes(shapes: Array, carried: int, turn: Array, origin: Array, placed: Array) -> None:
    """Write the last `carried` shapes, which stand on one link, in the base frame.

    Args:
        shapes: (S, 16) packed; the last ones in the link's frame.
        carried: How many.
        turn: (3, 3) rotation of the link's frame.
        origin: (3) its origin [m].
        placed: (S, 16) where they are written; kind and size stand there already.
    """
    for s in range(len(shapes) - carried, len(shapes)):
        place_point(turn, origin, shapes[s, 10:13], placed[s, 10:13])
        for r in range(3):
            for c in range(3):
                placed[s, 1 + 3 * r + c] = (
                    shapes[s, 1 + 3 * r] * turn[c, 0]
                    + shapes[s, 2 + 3 * r] * turn[c, 1]
                    + shapes[s, 3 + 3 * r] * turn[c, 2]
                )


@njit(cache=True, error_model="numpy")
def all_distances(
    joints: Array,
    link: Indices,
    ends: Array,
    radius: Array,
    shapes: Array,
    carried: int,
    pairs: Indices,
    overlap: Array,
    holds: Indices,
    meetings: Indices,
    nearer: Array,
    q: Array,
    own: Array,
    around: Array,
) -> None:
    """Write the distances of all pairs, (N, P + H) and (N, E)."""
    n = q.shape[1]
    turn, origin, axis = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
    placed, slope, solids = np.empty((len(link), 2, 3)), np.empty(3), shapes.copy()
    for k in range(len(q)):
        place_capsules(joints, link, ends, q[k], turn, origin, axis, placed)
        place_shapes(shapes, carried, turn[n], origin[n], solids)
        for p in range(len(pairs)):
            a, b = pairs[p]
            far = closest_on_segments(placed[a, 0], placed[a, 1], placed[b, 0], placed[b, 1])[0]
            own[k, p] = far - radius[a] - radius[b] + overlap[p]
        for p in range(len(holds)):
            a, s = holds[p]
            far = segment_to_shape(solids[s], placed[a, 0], placed[a, 1], slope)[0]
            own[k, len(pairs) + p] = far - radius[a]
        for p in range(len(meetings)):
            a, s = meetings[p]
            far = segment_to_shape(solids[s], placed[a, 0], placed[a, 1], slope)[0]
            around[k, p] = far - radius[a] + nearer[p]


@njit(cache=True, error_model="numpy")
def group_distance(
    around: bool,
    group: Indices,
    spheres: Array,
    centres: Array,
    shapes: Array,
    slope: Array,
) -> float:
    """What no pair of a group is below, from the spheres around the links."""
    a, b = group[0], group[1]
    if around:
        far = signed_distance(shapes[b], centres[a, 0], centres[a, 1], centres[a, 2], slope)
        return far - spheres[a, 3]
    x, y, z = (
        centres[a, 0] - centres[b, 0],
        centres[a, 1] - centres[b, 1],
        centres[a, 2] - centres[b, 2],
    )
    return math.sqrt(x * x + y * y + z * z) - spheres[a, 3] - spheres[b, 3]


@njit(cache=True, error_model="numpy")
def nearest(
    joints: Array,
    link: Indices,
    ends: Array,
    radius: Array,
    spheres: Array,
    shapes: Array,
    carried: int,
    pairs: Indices,
    overlap: Array,
    groups: Indices,
    around: bool,
    q: Array,
    slack: Array,
    found: Array,
    pair: Indices,
) -> None:
    """Write the least distance, its pair, and the least of distance less slack.

    Args:
        joints: See `ArmGeometry`; the next six see `Bodies`.
        link: (C).
        ends: (C, 2, 3).
        radius: (C).
        spheres: (n + 1, 4).
        shapes: (S, 16).
        carried: How many of them, the last ones, stand on the last link.
        pairs: (P, 2) pairs of capsules, or of capsule and shape if `around`.
        overlap: (P) added to the distances [m].
        groups: (G, 4) two links, or link and shape; first and last + 1 of its pairs.
        around: Whether pairs are with shapes.
        q: (N, n) positions.
        slack: (N, G) what is taken off the distances of a group [m].
        found: (2, N) least distance, and least distance less slack [m].
        pair: (N) the pair of least distance.
    """
    n = q.shape[1]
    turn, origin, axis = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
    placed, slope, solids = np.empty((len(link), 2, 3)), np.empty(3), shapes.copy()
    centres = np.empty((n + 1, 3))
    for k in range(len(q)):
        place_capsules(joints, link, ends, q[k], turn, origin, axis, placed)
        place_shapes(shapes, carried, turn[n], origin[n], solids)
        for i in range(n + 1):
            place_point(turn[i], origin[i], spheres[i, :3], centres[i])
        least, low, index = np.inf, np.inf, 0
        for g in range(len(groups)):
            off = slack[k, g]
            floor = group_distance(around, groups[g], spheres, centres, solids, slope)
            if floor >= least and floor - off >= low:
                continue
            outer, last, far_off = groups[g, 1], -1, False
            for p in range(groups[g, 2], groups[g, 3]):
                a, b = pairs[p]
                if a != last and not around:
                    # Pairs stand capsule by capsule: one look may spare all those of this one.
                    last = a
                    floor = point_to_segment(centres[outer], placed[a, 0], placed[a, 1])
                    floor -= spheres[outer, 3] + radius[a]
                    far_off = floor >= least and floor - off >= low
                if far_off:
                    continue
                if around:
                    far = segment_to_shape(solids[b], placed[a, 0], placed[a, 1], slope)[0]
                    far -= radius[a] - overlap[p]
                else:
                    far = closest_on_segments(
                        placed[a, 0], placed[a, 1], placed[b, 0], placed[b, 1]
                    )[0]
                    far -= radius[a] + radius[b] - overlap[p]
                if far < least:
                    least, index = far, p
                low = min(low, far - off)
        found[0, k], found[1, k], pair[k] = least, low, index
