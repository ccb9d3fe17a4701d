"""Triangular factors, with types that SciPy does not declare."""

from __future__ import annotations

import numpy as np
from scipy import linalg  # pyright: ignore[reportMissingTypeStubs]

from dynid.core.arrays import Array


def upper_triangle(matrix: Array) -> Array:
    """The square upper triangle R of a QR of (M, k), zero rows added where M < k."""
    width = matrix.shape[1]
    factor: tuple[Array] = linalg.qr(matrix, mode="r", check_finite=False)  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType, reportAssignmentType]
    upper = np.asarray(factor[0], dtype=np.float64)[:width]
    return np.vstack([upper, np.zeros((width - len(upper), width))])


def solve_upper(upper: Array, right: Array) -> Array:
    """Solve R x = b for upper triangular R (k, k) and b (k) or (k, m)."""
    solution: Array = linalg.solve_triangular(upper, right)  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
    return np.asarray(solution, dtype=np.float64)


def inverse_upper(upper: Array) -> Array:
    """The inverse of an upper triangular (k, k) matrix."""
    return solve_upper(upper, np.eye(len(upper)))
