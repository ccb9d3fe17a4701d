"""Fourier series that start and end every period at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen, read_only
from dynid.core.errors import InputError
from dynid.trajectory.fourier import FourierSeries


def rest_basis(harmonics: int) -> Array:
    """An orthonormal basis of the coefficients with no velocity and acceleration at the ends.

    dq(0) = 0 means sum_l l a_l = 0, and ddq(0) = 0 means sum_l l^2 b_l = 0 (by periodicity also
    at the end). With Z the basis of both null spaces, [a; b] = Z y for free numbers y: the
    conditions hold exactly and an optimiser needs no equality constraints.

    Args:
        harmonics: Number of harmonics H, at least 2.

    Returns:
        (2H, 2H - 2) Z, the a rows first.

    Raises:
        InputError: Fewer than two harmonics.
    """
    if harmonics < 2:
        raise InputError("a motion from rest to rest needs two harmonics", value=harmonics)
    order = np.arange(1.0, harmonics + 1)
    basis = np.zeros((2 * harmonics, 2 * harmonics - 2))
    basis[:harmonics, : harmonics - 1] = _orthogonal_complement(order)
    basis[harmonics:, harmonics - 1 :] = _orthogonal_complement(order**2)
    return read_only(basis)


def held_basis(harmonics: int) -> Array:
    """An orthonormal basis of the coefficients that also start and end at the offset.

    To the conditions of `rest_basis`, q(0) = q0 adds sum_l b_l = 0.

    Args:
        harmonics: Number of harmonics H, at least 3.

    Returns:
        (2H, 2H - 3) basis, the a rows first.

    Raises:
        InputError: Fewer than three harmonics.
    """
    if harmonics < 3:
        raise InputError("a motion held at both ends needs three harmonics", value=harmonics)
    order = np.arange(1.0, harmonics + 1)
    cosines = _orthogonal_complement(order**2)
    # Within the cosines that have no acceleration at the ends, those that add up to zero.
    cosines = cosines @ _orthogonal_complement(cosines.sum(axis=0))
    basis = np.zeros((2 * harmonics, 2 * harmonics - 3))
    basis[:harmonics, : harmonics - 1] = _orthogonal_complement(order)
    basis[harmonics:, harmonics - 1 :] = cosines
    return read_only(basis)


def rest_series(period: float, offset: ArrayLike, free: ArrayLike) -> FourierSeries:
    """The series from the free numbers of each joint.

    Args:
        period: Period [s].
        offset: (n) mean positions [rad or m].
        free: (n, 2H - 2) coordinates in `rest_basis(H)` [rad or m].

    Raises:
        InputError: Shapes that disagree, or a number of columns that is odd or zero.
    """
    numbers = frozen(free, shape=(np.size(offset), None), name="free coefficients")
    columns = numbers.shape[1]
    if columns == 0 or columns % 2:
        raise InputError("each joint needs 2H - 2 free coefficients", value=columns)
    harmonics = columns // 2 + 1
    coefficients = numbers @ rest_basis(harmonics).T
    return FourierSeries(
        period=period,
        offset=frozen(offset, shape=(None,), name="offset"),
        a=coefficients[:, :harmonics],
        b=coefficients[:, harmonics:],
    )


def _orthogonal_complement(direction: Array) -> Array:
    # A Householder reflection takes `direction` to the first axis, so its other columns are an
    # orthonormal basis of the rest: no factorisation whose signs depend on the LAPACK at hand.
    mirror = direction / np.linalg.norm(direction)
    mirror[0] += 1.0 if mirror[0] >= 0.0 else -1.0
    reflection = np.eye(len(mirror)) - 2.0 * np.outer(mirror, mirror) / (mirror @ mirror)
    return reflection[:, 1:]
