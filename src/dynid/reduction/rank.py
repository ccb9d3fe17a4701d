"""Numerical rank, base columns and parameter classes of an observation matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.core.linalg import solve_upper, upper_triangle

RANK_TOLERANCE = 1e-9
"""Of the largest singular value, columns normalised; the UR5's gap is 1e-2 to 1e-16."""
CLASS_TOLERANCE = 1e-7


@dataclass(frozen=True, slots=True, kw_only=True)
class Rank:
    """Rank and classes that do not depend on the choice of base columns."""

    rank: int
    normalised_singular_values: Array
    """(p) singular values with columns scaled to unit norm."""
    alone: tuple[int, ...]
    """Columns in the row space: identifiable alone."""
    combined: tuple[int, ...]
    """Identifiable only together with others."""
    unidentifiable: tuple[int, ...]
    """Zero columns."""


def rank_and_classes(w: Array, tolerance: float = RANK_TOLERANCE) -> Rank:
    """Rank and classes of W (M, p) with M >= p.

    Class by null space V2 and row space V1: column j is unidentifiable if W e_j = 0, alone if
    row j of V2 is zero, combined otherwise (methods.md 1.2).
    """
    norms = np.linalg.norm(w, axis=0)
    zero = norms <= tolerance * norms.max(initial=1e-300)
    scaled = w / np.where(zero, 1.0, norms)
    scaled[:, zero] = 0.0
    _, s, vt = np.linalg.svd(scaled, full_matrices=True)
    rank = int((s > tolerance * s[0]).sum())
    null_norms = np.linalg.norm(vt[rank:], axis=0)
    alone = (null_norms < CLASS_TOLERANCE) & ~zero
    return Rank(
        rank=rank,
        normalised_singular_values=s,
        alone=tuple(np.flatnonzero(alone).tolist()),
        combined=tuple(np.flatnonzero(~alone & ~zero).tolist()),
        unidentifiable=tuple(np.flatnonzero(zero).tolist()),
    )


def regrouping(
    w: Array, tolerance: float = RANK_TOLERANCE
) -> tuple[tuple[int, ...], tuple[int, ...], Array]:
    """First-come base columns and how the others regroup into them (Gautier 1991).

    Args:
        w: (M, p) observation matrix.
        tolerance: On |R_jj| of the column-normalised QR.

    Returns:
        Base columns (r), dependent columns (p - r), K (r, p - r) with W2 = W1 K.
    """
    norms = np.linalg.norm(w, axis=0)
    scale = np.where(norms > tolerance * norms.max(initial=1e-300), norms, 1.0)
    diagonal = np.abs(np.diag(upper_triangle(w / scale)))
    # A dependent column leaves rounding only; the first zero columns are below it too.
    independent = diagonal > max(tolerance, 1e-12)
    base, dependent = np.flatnonzero(independent), np.flatnonzero(~independent)
    r = len(base)
    upper = upper_triangle((w / scale)[:, np.concatenate([base, dependent])])
    k = solve_upper(upper[:r, :r], upper[:r, r:])
    k[np.abs(k) < CLASS_TOLERANCE * 1e-2] = 0.0
    k = k * (scale[dependent][None, :] / scale[base][:, None])
    return tuple(base.tolist()), tuple(dependent.tolist()), k
