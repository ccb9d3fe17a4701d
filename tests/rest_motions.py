"""Fourier series of which only the free numbers matter."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dynid.trajectory import FourierFamily, FourierSeries


def rest_series(period: float, offset: ArrayLike, free: ArrayLike) -> FourierSeries:
    """The series of free numbers (n, 2H - 2), at rest at both ends."""
    family = FourierFamily(duration=period, order=np.shape(free)[1] // 2 + 1)
    found = family.trajectory(offset, free)
    assert isinstance(found, FourierSeries)
    return found
