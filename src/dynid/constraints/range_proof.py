"""The least distance of two bodies over whole ranges of joints, by branch and bound."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from dynid.constraints.collision import CollisionBodies, gap_of, place_bodies
from dynid.constraints.distance import WORK
from dynid.core import Array, Indices

_MOST_CELLS = 40_000


def least_distance(
    bodies: CollisionBodies, a: int, b: int, lower: Array, upper: Array, sure: float
) -> float:
    """A distance that bodies keep wherever the joints between them stand.

    Args:
        bodies: The bodies.
        a: The inner body, or a half-space.
        b: The outer body.
        lower: (n) lower ends of the joints' ranges [rad or m].
        upper: (n) upper ends.
        sure: The distance to be proven [m].

    Returns:
        At least `sure` if that is proven (branch and bound); else a distance that was seen
        and is smaller, or -inf where the search was cut short.
    """
    pair = np.array([[a, b]], dtype=np.intp)
    rates = bodies.rates(pair, np.maximum(np.abs(lower), np.abs(upper)))[0]
    half = np.where(rates > 0, (upper - lower) / 2, 0.0)
    # A whole turn is all of a joint's range.
    half = np.where(bodies.arm.prismatic, half, np.minimum(half, np.pi))
    middle = (upper + lower) / 2
    return float(
        _least(bodies.arm.joints, bodies.parts, pair, middle, half, rates, sure, _MOST_CELLS)
    )


@njit(cache=True, error_model="numpy")
def _least(
    joints: Array,
    parts: Any,
    pairs: Indices,
    middle: Array,
    half: Array,
    rates: Array,
    sure: float,
    most: int,
) -> float:
    """Branch and bound over the joints that have a rate: see `least_distance`."""
    n = len(middle)
    turn, origin, axis = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
    centres, work, touch = np.empty((len(parts[0]), 3)), np.empty((WORK, 6)), np.empty(3)
    frame = np.empty((4, 3))
    cells, way, (a, b) = np.empty((256, 2, n)), np.zeros(3), pairs[0]
    cells[0, 0], cells[0, 1] = middle, half
    open_, low = 1, np.inf
    for _ in range(most):
        open_ -= 1
        q, wide = cells[open_, 0].copy(), cells[open_, 1].copy()
        slack, widest = 0.0, 0
        for j in range(n):
            slack += rates[j] * wide[j]
            if rates[j] * wide[j] > rates[widest] * wide[widest]:
                widest = j
        place_bodies(joints, parts, q, turn, origin, axis, centres)
        far = gap_of(parts, a, b, turn, origin, centres, sure + slack, way, touch, frame, work)
        if far < sure:
            return far
        if far - slack >= sure:
            low = min(low, far - slack)
            if open_ == 0:
                return low
            continue
        if open_ + 2 > len(cells):
            break
        wide[widest] /= 2
        for side in (-1.0, 1.0):
            cells[open_, 0], cells[open_, 1] = q, wide
            cells[open_, 0, widest] += side * wide[widest]
            open_ += 1
    return -np.inf
