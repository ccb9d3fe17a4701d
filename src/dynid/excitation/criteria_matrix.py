"""Eigenvalues and inverses of Gram matrices that may be nearly singular."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array

SPREAD = 1e-7
"""Below this ratio of the extreme eigenvalues, rounding shows in the smallest one."""
SINGULAR = 1e-13
"""A column of which this share is independent of those before it is a combination of them."""


def eigenvalues(matrix: Array) -> Array | None:
    """(b) eigenvalues of a Gram matrix, smallest first; None if it is singular."""
    if not _is_usable(matrix):
        return None
    values = np.asarray(np.linalg.eigvalsh(matrix), dtype=np.float64)
    if values[0] > SPREAD * values[-1]:
        return values
    factor = _factor(matrix)
    if factor is None:
        return None
    # Singular values of the triangle keep the digits that squaring loses.
    singular = np.linalg.svd(factor, compute_uv=False)[::-1]
    return np.asarray(np.square(singular), dtype=np.float64)


def eigenvectors(matrix: Array) -> tuple[Array, Array] | None:
    """Eigenvalues (b), smallest first, and vectors in columns (b, b); None if it is singular."""
    if not _is_usable(matrix):
        return None
    values, vectors = np.linalg.eigh(matrix)
    if values[0] > SPREAD * values[-1]:
        return values, vectors
    factor = _factor(matrix)
    if factor is None:
        return None
    left, singular, _ = np.linalg.svd(factor)
    return np.square(singular[::-1]), left[:, ::-1]


def normalised(matrix: Array) -> tuple[Array, Array] | None:
    """The Gram matrix of the columns scaled to unit norm, and the norms (b); None if one is 0."""
    if not _is_usable(matrix):
        return None
    norms = np.sqrt(np.diag(matrix))
    return matrix / norms[:, None] / norms, norms


def inverse(matrix: Array) -> tuple[Array, float] | None:
    """The inverse (b, b) and the logarithm of the determinant; None if it is singular."""
    unit = normalised(matrix)
    factor = None if unit is None else _factor(unit[0])
    if unit is None or factor is None:
        return None
    whole = np.linalg.inv(unit[0])
    log_det = 2.0 * float(np.log(np.diag(factor)).sum() + np.log(unit[1]).sum())
    return (whole + whole.T) / 2 / unit[1][:, None] / unit[1], log_det


def _is_usable(matrix: Array) -> bool:
    return bool(np.isfinite(matrix).all()) and bool((np.diag(matrix) > 0).all())


def _factor(matrix: Array) -> Array | None:
    """The lower Cholesky factor; None if a column is a combination of those before it."""
    try:
        factor = np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    left = np.square(np.diag(factor)) > SINGULAR * np.diag(matrix)
    return factor if left.all() else None
