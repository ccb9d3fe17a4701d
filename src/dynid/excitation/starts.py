"""Random starts: shapes whose velocities are white, scaled onto the limits."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.excitation.region import MotionRegion


def shape_basis(region: MotionRegion) -> Array:
    """(k, k) L with y = L z: independent standard normal z give velocities of one variance.

    In these coordinates no harmonic, and no spline knot, stands out before the search begins.
    """
    speed = region.columns[1][:, 1:]
    gram = speed.T @ speed / len(speed)
    # The ridge keeps numbers that hardly move the arm from being drawn very large.
    gram += 1e-6 * np.trace(gram) / len(gram) * np.eye(len(gram))
    factor = np.asarray(np.linalg.cholesky(gram), dtype=np.float64)
    return np.asarray(np.linalg.inv(factor).T, dtype=np.float64)


def random_numbers(
    region: MotionRegion, count: int, random: np.random.Generator, *, fill: float
) -> Array:
    """(count, n, 1 + k) random motions inside the region.

    Args:
        region: The bounds.
        count: How many.
        random: Where the numbers come from.
        fill: Share of each joint's tightest bound that is used, in (0, 1].
    """
    width = region.columns[0].shape[1]
    joints = len(region.middle)
    free = random.standard_normal((count, joints, width - 1)) @ shape_basis(region).T
    return region.onto_limits(free, random.uniform(size=(count, joints)), fill)
