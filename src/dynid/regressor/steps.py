"""The step of Coulomb friction with a width."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array

Width = float | tuple[float, ...]
"""One width for all joints, or one a joint [rad/s or m/s]; 0 gives the sign."""


def smooth_sign(dq: Array, width: Width) -> Array:
    """tanh(dq / width) for dq (n, N) or (N), the sign where the width is 0."""
    if not isinstance(width, tuple):
        return np.tanh(dq / width) if width > 0 else np.sign(dq)
    out = np.empty_like(dq)
    for j, one in enumerate(width):
        out[j] = smooth_sign(dq[j], one)
    return out


def smooth_slope(dq: Array, width: Width) -> Array:
    """Derivative of `smooth_sign` by dq (n, N) or (N): zero where the width is 0."""
    if not isinstance(width, tuple):
        return (1.0 - np.square(np.tanh(dq / width))) / width if width > 0 else np.zeros_like(dq)
    out = np.empty_like(dq)
    for j, one in enumerate(width):
        out[j] = smooth_slope(dq[j], one)
    return out
