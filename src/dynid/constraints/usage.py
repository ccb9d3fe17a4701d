"""How much of every limit a motion uses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

RATIOS = (
    "position", "velocity", "acceleration", "torque",
    "tcp_speed", "elbow_speed", "momentum", "power",
)  # fmt: skip
"""Kinds whose margin is the share of the limit that is left."""
DISTANCES = ("self_collision", "environment")
"""Kinds whose margin is a signed distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Worst:
    """Where a limit is nearest to being broken."""

    margin: float
    """Share of the limit that is left, or signed distance [m]; NaN where not judged."""
    t: float | None = None
    """When [s], or the sample's number where no times are known."""
    what: str = ""
    """The joint or the two bodies."""
    value: float = math.nan
    """The quantity itself [SI]."""
    limit: float = math.nan
    """Its limit [SI]."""
    distance: bool = False
    """Whether it is a distance, which must not fall below its limit."""

    @property
    def room(self) -> float:
        """What is left: the margin, less the clearance of a distance; infinite if not judged."""
        if math.isnan(self.margin):
            return math.inf
        return self.margin - self.limit if self.distance else self.margin

    def to_json(self) -> dict[str, Any]:
        """The form that `--json` prints."""
        key = "bodies" if self.distance else "joint"
        return {
            "t": self.t,
            **({key: self.what} if self.what else {}),
            "value": _known(self.value),
            "limit": _known(self.limit),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Usage:
    """The worst of every kind over samples of a motion."""

    worst: dict[str, Worst]
    """Kind (`RATIOS`, `DISTANCES`) to its worst; kinds that are not judged have margin NaN."""

    @property
    def feasible(self) -> bool:
        """Whether no judged limit is broken at any sample."""
        return all(item.room >= 0 for item in self.worst.values())

    def ratio(self, kind: str) -> float:
        """Value over limit of one of `RATIOS`; NaN where not judged."""
        return 1.0 - self.worst[kind].margin

    def distance(self, kind: str) -> float:
        """Smallest signed distance of one of `DISTANCES` [m]; NaN where not judged."""
        return self.worst[kind].margin

    @property
    def margins(self) -> dict[str, float | None]:
        """The margins as `--json` prints them; null where not judged."""
        return margins_of(self.worst)


def margins_of(worst: dict[str, Worst]) -> dict[str, float | None]:
    """Kind, with its unit where it is a distance, to margin; None where not judged."""
    return {
        f"{kind}_m" if kind in DISTANCES else kind: _known(item.margin)
        for kind, item in worst.items()
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
