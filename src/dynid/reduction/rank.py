"""Numerical rank, base columns and parameter classes of an observation matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, Mask, read_only
from dynid.core.linalg import solve_upper, upper_triangle

RANK_TOLERANCE = 1e-9
"""Of the largest singular value, columns normalised; the UR5's gap is 1e-2 to 1e-16."""
ZERO_COLUMN = 1e-9
"""Columns below this share of the largest norm are zero."""
CLASS_TOLERANCE = 1e-7
"""A column with less than this of its norm in the null space is identifiable alone."""
NO_SHARE = 1e-9
"""Smaller entries of K, columns normalised, are zero."""
ROUNDING = 1e-12
"""No tolerance may ask for more."""


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

    @property
    def gap(self) -> tuple[float, float]:
        """The singular values, relative to the first, on both sides of the rank."""
        s = self.normalised_singular_values
        after = s[self.rank] / s[0] if self.rank < len(s) else 0.0
        return float(s[self.rank - 1] / s[0]), float(after)


def rank_and_classes(w: Array, tolerance: float = RANK_TOLERANCE) -> Rank:
    """Rank and classes of W (M, p).

    Class by null space V2 and row space V1: column j is unidentifiable if W e_j = 0, alone if
    row j of V2 is zero, combined otherwise (methods.md 1.2).
    """
    scaled, _, zero = _unit_columns(w)
    # The triangle has the same singular values and row space, whatever the number of rows.
    _, s, vt = np.linalg.svd(upper_triangle(scaled))
    rank = int((s > tolerance * s[0]).sum())
    null_norms = np.linalg.norm(vt[rank:], axis=0)
    alone = null_norms < CLASS_TOLERANCE
    return Rank(
        rank=rank,
        normalised_singular_values=read_only(s),
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
    scaled, scale, _ = _unit_columns(w)
    # A dependent column leaves nothing but rounding on the diagonal.
    independent = np.abs(np.diag(upper_triangle(scaled))) > max(tolerance, ROUNDING)
    base, dependent = np.flatnonzero(independent), np.flatnonzero(~independent)
    r = len(base)
    upper = upper_triangle(scaled[:, np.concatenate([base, dependent])])
    k = solve_upper(upper[:r, :r], upper[:r, r:])
    k[np.abs(k) < NO_SHARE] = 0.0
    k = k * (scale[dependent][None, :] / scale[base][:, None])
    return tuple(base.tolist()), tuple(dependent.tolist()), k


def _unit_columns(w: Array) -> tuple[Array, Array, Mask]:
    """W with columns of unit norm or exactly zero; what it was divided by (p); zero columns (p)."""
    norms = np.linalg.norm(w, axis=0)
    zero = norms <= ZERO_COLUMN * norms.max(initial=1e-300)
    scale = np.where(zero, 1.0, norms)
    return np.where(zero, 0.0, w / scale), scale, zero
