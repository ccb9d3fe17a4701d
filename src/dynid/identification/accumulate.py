"""Triangular factors of each joint's rows, one pass, whatever the record's length."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.core.linalg import upper_triangle
from dynid.identification.problem import IdentificationProblem


def joint_factors(problem: IdentificationProblem, row_weights: Array | None = None) -> Array:
    """R of the QR of [W_j tau_j] for each joint.

    Everything that least squares needs of the data: weights a joint can change afterwards
    without touching it again.

    Args:
        problem: The problem.
        row_weights: (n, N) factor on each row, for robust estimators.

    Returns:
        (n, r + 1, r + 1) upper triangular.
    """
    joints, width = problem.samples.joints, problem.base.rank + 1
    factors = np.zeros((joints, width, width))
    for part, columns, torque in problem.chunks():
        for j in range(joints):
            rows = np.vstack([columns[:, j], torque[j]]).T
            if row_weights is not None:
                rows = rows * row_weights[j, part, None]
            factors[j] = upper_triangle(np.vstack([factors[j], rows]))
    return factors
