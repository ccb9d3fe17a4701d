"""Read-only arrays with checked shapes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.core.errors import InputError

Array = NDArray[np.float64]
"""A float64 array; shape and unit stand in each field's docstring."""
Indices = NDArray[np.intp]
"""An array of indices."""
Mask = NDArray[np.bool_]
"""An array of truth values."""


def frozen(
    values: ArrayLike, *, shape: tuple[int | None, ...], name: str, finite: bool = True
) -> Array:
    """A read-only float64 copy of `values`.

    Args:
        values: Anything array-like.
        shape: Expected shape; None lets an axis have any length.
        name: The name used in the error.
        finite: Refuse NaN and infinity.

    Raises:
        InputError: Wrong shape, not numeric, or not finite.
    """
    try:
        array = np.array(values, dtype=np.float64, copy=True)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be numbers", value=values) from error
    fits = array.ndim == len(shape) and all(
        want is None or want == got for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise InputError(f"{name} has the wrong shape", value=array.shape, limit=shape)
    if finite and not np.isfinite(array).all():
        first = tuple(int(k) for k in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{name} is not finite at index {first}", value=float(array[first]))
    array.setflags(write=False)
    return array


def read_only(array: Array) -> Array:
    """The same array, marked read-only without a copy."""
    array.setflags(write=False)
    return array
