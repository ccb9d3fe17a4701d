"""Distances between the arm's bodies and from them to the scene, and how they change."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from dynid.constraints.arm import (
    ArmGeometry,
    collect,
    place_joints,
    place_point,
    samples_of,
)
from dynid.constraints.distance import closest_on_segments, segment_to_shape, signed_distance
from dynid.core.arrays import Array, Indices

LENGTH = 0.1
"""The distance that counts as much as a limit exceeded by its whole value [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bodies:
    """Capsules on the links, shapes in the base frame, and the pairs that are judged."""

    arm: ArmGeometry
    link: Indices
    """(C) the link of each capsule, 0 the base."""
    ends: Array
    """(C, 2, 3) ends of the segments in the joint frames of their links [m]."""
    radius: Array
    """(C) [m]"""
    shapes: Array
    """(S, 16) packed shapes."""
    pairs: Indices
    """(P, 2) capsules that must not meet."""
    meetings: Indices
    """(E, 2) capsule and shape that must not meet."""

    def distances(self, q: Array) -> tuple[Array, Array]:
        """Signed distances of all pairs.

        Args:
            q: (N, n) positions [rad or m].

        Returns:
            (N, P) between capsules and (N, E) from capsules to shapes [m]. Capsules that
            intersect deeper than to their middle lines keep their least value.
        """
        own = np.empty((len(q), len(self.pairs)))
        around = np.empty((len(q), len(self.meetings)))
        _distances(*self._arrays(), samples_of(q), own, around)
        return own, around

    def violation(self, q: Array, own: float, around: float) -> tuple[float, Array]:
        """Sum of squared shortfalls of the clearances, in units of `LENGTH`.

        Args:
            q: (N, n) positions [rad or m].
            own: Smallest allowed distance between capsules [m].
            around: Smallest allowed distance to shapes [m].

        Returns:
            The sum over samples and pairs, and its derivative (N, n).
        """
        slope = np.zeros(q.shape)
        args = self._arrays()
        total = _violation(*args, self.arm.prismatic, samples_of(q), own, around, slope)
        return float(total), slope

    def _arrays(self) -> tuple[Array, Indices, Array, Array, Array, Indices, Indices]:
        return (
            self.arm.joints,
            self.link,
            self.ends,
            self.radius,
            self.shapes,
            self.pairs,
            self.meetings,
        )


@njit(cache=True, error_model="numpy")
def _place(
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
def _distances(
    joints: Array,
    link: Indices,
    ends: Array,
    radius: Array,
    shapes: Array,
    pairs: Indices,
    meetings: Indices,
    q: Array,
    own: Array,
    around: Array,
) -> None:
    n = q.shape[1]
    turn, origin, axis = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
    placed, slope = np.empty((len(link), 2, 3)), np.empty(3)
    for k in range(len(q)):
        _place(joints, link, ends, q[k], turn, origin, axis, placed)
        for p in range(len(pairs)):
            a, b = pairs[p]
            far = closest_on_segments(placed[a, 0], placed[a, 1], placed[b, 0], placed[b, 1])[0]
            own[k, p] = far - radius[a] - radius[b]
        for p in range(len(meetings)):
            a, s = meetings[p]
            far = segment_to_shape(shapes[s], placed[a, 0], placed[a, 1], slope)[0]
            around[k, p] = far - radius[a]


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
def _violation(
    joints: Array,
    link: Indices,
    ends: Array,
    radius: Array,
    shapes: Array,
    pairs: Indices,
    meetings: Indices,
    prismatic: Indices,
    q: Array,
    own: float,
    around: float,
    out: Array,
) -> float:
    n = q.shape[1]
    turn, origin, axis = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
    placed, way = np.empty((len(link), 2, 3)), np.empty(3)
    force, moment = np.empty((n + 1, 3)), np.empty((n + 1, 3))
    half = np.empty(len(link))
    for c in range(len(link)):
        total = 0.0
        for r in range(3):
            total += (ends[c, 1, r] - ends[c, 0, r]) ** 2
        half[c] = 0.5 * math.sqrt(total)
    total = 0.0
    for k in range(len(q)):
        _place(joints, link, ends, q[k], turn, origin, axis, placed)
        force[:] = 0.0
        moment[:] = 0.0
        hit = False
        for p in range(len(pairs)):
            a, b = pairs[p]
            touch = float(radius[a] + radius[b] + own)
            room, apart = touch + half[a] + half[b], 0.0
            for r in range(3):
                apart += (
                    0.5 * (placed[a, 0, r] + placed[a, 1, r] - placed[b, 0, r] - placed[b, 1, r])
                ) ** 2
            if apart >= room * room:
                continue
            far, s, t = closest_on_segments(placed[a, 0], placed[a, 1], placed[b, 0], placed[b, 1])
            if far >= touch:
                continue
            short = (touch - far) / LENGTH
            total += short * short
            if far <= 0.0:
                continue
            hit = True
            by = -2.0 * short / LENGTH / far
            x0 = placed[a, 0, 0] + s * (placed[a, 1, 0] - placed[a, 0, 0])
            x1 = placed[a, 0, 1] + s * (placed[a, 1, 1] - placed[a, 0, 1])
            x2 = placed[a, 0, 2] + s * (placed[a, 1, 2] - placed[a, 0, 2])
            y0 = placed[b, 0, 0] + t * (placed[b, 1, 0] - placed[b, 0, 0])
            y1 = placed[b, 0, 1] + t * (placed[b, 1, 1] - placed[b, 0, 1])
            y2 = placed[b, 0, 2] + t * (placed[b, 1, 2] - placed[b, 0, 2])
            way[0], way[1], way[2] = x0 - y0, x1 - y1, x2 - y2
            _push(force[link[a]], moment[link[a]], x0, x1, x2, way, by)
            _push(force[link[b]], moment[link[b]], y0, y1, y2, way, -by)
        for p in range(len(meetings)):
            a, shape = meetings[p]
            touch = float(radius[a] + around)
            x0 = 0.5 * (placed[a, 0, 0] + placed[a, 1, 0])
            x1 = 0.5 * (placed[a, 0, 1] + placed[a, 1, 1])
            x2 = 0.5 * (placed[a, 0, 2] + placed[a, 1, 2])
            if signed_distance(shapes[shape], x0, x1, x2, way) >= touch + half[a]:
                continue
            far, t = segment_to_shape(shapes[shape], placed[a, 0], placed[a, 1], way)
            if far >= touch:
                continue
            hit = True
            short = (touch - far) / LENGTH
            total += short * short
            x0 = placed[a, 0, 0] + t * (placed[a, 1, 0] - placed[a, 0, 0])
            x1 = placed[a, 0, 1] + t * (placed[a, 1, 1] - placed[a, 0, 1])
            x2 = placed[a, 0, 2] + t * (placed[a, 1, 2] - placed[a, 0, 2])
            _push(force[link[a]], moment[link[a]], x0, x1, x2, way, -2.0 * short / LENGTH)
        if hit:
            collect(origin, axis, prismatic, force, moment, out[k])
    return total
