"""The compiled part of `collision`: missing clearances and how they change."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dynid.constraints.arm import collect, place_point
from dynid.constraints.collision_kernels import group_distance, place_capsules, place_shapes
from dynid.constraints.distance import (
    closest_on_segments,
    point_to_segment,
    segment_to_shape,
    signed_distance,
)
from dynid.core.arrays import Array, Indices

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
