"""Speeds of points of the arm, its linear momentum, and how they change."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from dynid.constraints.arm import ArmGeometry, place_joints, place_point, samples_of
from dynid.core.arrays import Array, Indices


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingPoints:
    """Points on links whose weighted velocities are summed.

    One point of weight 1 gives its velocity; the centres of mass, weighted with the masses,
    give the momentum.
    """

    arm: ArmGeometry
    link: Indices
    """(M) the link of each point."""
    points: Array
    """(M, 3) in the links' joint frames [m]."""
    weights: Array
    """(M)"""

    def norms(self, q: Array, dq: Array) -> Array:
        """Length (N) of the sum at q, dq (N, n) [m/s or kg.m/s]."""
        found = np.empty(len(q))
        slopes = np.zeros((2, 1, 1))
        _norms(*self._arrays(), samples_of(q), samples_of(dq), -1.0, found, slopes)
        return found

    def violation(self, q: Array, dq: Array, limit: float) -> tuple[float, Array, Array]:
        """Sum over samples of (length / limit - 1)^2 where that is positive.

        Returns:
            The sum and its derivatives (N, n) with respect to q and dq.
        """
        found = np.empty(len(q))
        slopes = np.zeros((2, *q.shape))
        total = _norms(*self._arrays(), samples_of(q), samples_of(dq), limit, found, slopes)
        return float(total), slopes[0], slopes[1]

    def reach(self, travel: Array) -> Array:
        """(n) bounds of |d sum / d dq_k|; see `ArmGeometry.reach`."""
        total = np.zeros(self.arm.count)
        for link, point, weight in zip(self.link, self.points, self.weights, strict=True):
            total += abs(float(weight)) * self.arm.reach(int(link), point, travel)
        return total

    def _arrays(self) -> tuple[Array, Indices, Indices, Array, Array]:
        arm = self.arm
        return arm.joints, arm.prismatic, self.link, self.points, self.weights


@njit(cache=True, error_model="numpy")
def _norms(
    joints: Array,
    prismatic: Indices,
    link: Indices,
    points: Array,
    weights: Array,
    q: Array,
    dq: Array,
    limit: float,
    found: Array,
    slopes: Array,
) -> float:
    n = q.shape[1]
    turn, origin, axis = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
    column, before = np.empty((n, len(link), 3)), np.empty((n + 1, len(link), 3))
    place, spin, whole = np.empty(3), np.empty((n + 1, 3)), np.empty(3)
    total = 0.0
    for k in range(len(q)):
        place_joints(joints, q[k], turn, origin, axis)
        spin[0] = 0.0
        for i in range(n):
            turns = 0.0 if prismatic[i] else dq[k, i]
            for r in range(3):
                spin[i + 1, r] = spin[i, r] + turns * axis[i, r]
        whole[:] = 0.0
        for m in range(len(link)):
            place_point(turn[link[m]], origin[link[m]], points[m], place)
            before[0, m] = 0.0
            for i in range(link[m]):
                if prismatic[i]:
                    column[i, m] = axis[i]
                else:
                    x = place[0] - origin[i + 1, 0]
                    y = place[1] - origin[i + 1, 1]
                    z = place[2] - origin[i + 1, 2]
                    column[i, m, 0] = axis[i, 1] * z - axis[i, 2] * y
                    column[i, m, 1] = axis[i, 2] * x - axis[i, 0] * z
                    column[i, m, 2] = axis[i, 0] * y - axis[i, 1] * x
                for r in range(3):
                    before[i + 1, m, r] = before[i, m, r] + dq[k, i] * column[i, m, r]
            for r in range(3):
                whole[r] += weights[m] * before[link[m], m, r]
        size = math.sqrt(whole[0] ** 2 + whole[1] ** 2 + whole[2] ** 2)
        found[k] = size
        if limit <= 0.0 or size <= limit:
            continue
        over = size / limit - 1.0
        total += over * over
        scale = 2.0 * over / limit / size
        for m in range(len(link)):
            by = scale * weights[m]
            speed = before[link[m], m]
            for i in range(link[m]):
                c = column[i, m]
                # The column turns with the joints before it; those after it turn with joint i.
                d0 = spin[i, 1] * c[2] - spin[i, 2] * c[1]
                d1 = spin[i, 2] * c[0] - spin[i, 0] * c[2]
                d2 = spin[i, 0] * c[1] - spin[i, 1] * c[0]
                if not prismatic[i]:
                    v0 = speed[0] - before[i, m, 0]
                    v1 = speed[1] - before[i, m, 1]
                    v2 = speed[2] - before[i, m, 2]
                    d0 += axis[i, 1] * v2 - axis[i, 2] * v1
                    d1 += axis[i, 2] * v0 - axis[i, 0] * v2
                    d2 += axis[i, 0] * v1 - axis[i, 1] * v0
                slopes[0, k, i] += by * (whole[0] * d0 + whole[1] * d1 + whole[2] * d2)
                slopes[1, k, i] += by * (whole[0] * c[0] + whole[1] * c[1] + whole[2] * c[2])
    return total
