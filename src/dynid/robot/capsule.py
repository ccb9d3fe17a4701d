"""Self-collision shapes: capsules fixed in links."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dynid.core.arrays import Array, frozen
from dynid.core.errors import RobotError


@dataclass(frozen=True, slots=True, kw_only=True)
class Capsule:
    """All points within a radius of a segment (a sphere where the two ends coincide).

    Raises:
        RobotError: A negative link, or a radius that is not positive and finite.
        InputError: Ends that are not three finite numbers.
    """

    name: str
    link: int
    """0 for the base, i for the link that joint i moves."""
    start: Array
    """(3) one end of the segment in the joint frame of the link [m]."""
    end: Array
    """(3) the other end [m]."""
    radius: float
    """[m]"""

    def __post_init__(self) -> None:
        for name in ("start", "end"):
            value = frozen(getattr(self, name), shape=(3,), name=f"capsule {name}")
            object.__setattr__(self, name, value)
        if self.link < 0:
            raise RobotError("a capsule's link counts from 0, the base", value=self.link)
        if not math.isfinite(self.radius) or self.radius <= 0:
            raise RobotError("a capsule needs a positive radius", value=self.radius)
