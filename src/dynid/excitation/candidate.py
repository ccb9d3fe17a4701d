"""A motion that an optimiser found, before it is certified."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from dynid.core.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """Numbers of a motion and what they are worth."""

    x: Array
    """(n, 1 + k) offset and free numbers of each joint [rad or m]."""
    objective: float
    """The criterion as optimisers see it, on the full grid."""
    violation: float
    """How much limits are broken at the samples that were looked at; 0 where they are not."""

    @property
    def key(self) -> tuple[float, float]:
        """For comparison, smaller is better: feasible first, then the criterion."""
        return (self.violation, self.objective)


Stop = Callable[[], bool]
"""True when the time is over."""
Found = Callable[[Candidate], None]
"""Told each candidate as soon as it is there."""
