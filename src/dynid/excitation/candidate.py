"""A motion that an optimiser found, before it is certified."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from dynid.core.arrays import Array

TOLERABLE = 1e-4
"""A violation on the search grid that tightened limits are made for: it counts as none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """Numbers of a motion and what they are worth."""

    x: Array
    """(n, 1 + k) offset and free numbers of each joint [rad or m]."""
    objective: float
    """The criterion as optimisers see it, on the full grid."""
    violation: float
    """How much the tightened limits are broken on the search grid; 0 where they are not."""

    @property
    def key(self) -> tuple[float, float]:
        """For comparison, smaller is better: feasible first, then the criterion."""
        broken = self.violation if self.violation > TOLERABLE else 0.0
        return (broken, self.objective)


Stop = Callable[[], bool]
"""True when the time is over."""
Found = Callable[[Candidate], None]
"""Told each candidate as soon as it is there."""
