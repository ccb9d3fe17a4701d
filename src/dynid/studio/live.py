"""The limits at one instant, and a recording while it is made.

The page reads the same file that a crash would leave behind, so the recorder neither knows of
the page nor waits for it.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid.constraints import CollisionBodies, JudgedPairs, MotionConstraints, Worst
from dynid.core import Array, RecordError
from dynid.recording import ExperimentRecord, partial_path, recover


@dataclass(frozen=True, slots=True, kw_only=True)
class Near:
    """Two bodies and the way between them."""

    kind: str
    """`self_collision` or `environment`."""
    names: str
    distance: float
    """Between their surfaces [m]."""
    clearance: float
    """The smallest that is allowed to this pair [m]."""
    start: Array
    """(3) on the first body's surface, in the base frame [m]."""
    end: Array
    """(3) on the other's."""


def instant(
    constraints: MotionConstraints, q: Array, dq: Array, ddq: Array
) -> tuple[dict[str, Worst], list[Near]]:
    """Judge (n) positions, velocities, accelerations: limits used, nearest pair of each kind."""
    rows = [np.array(values, dtype=np.float64)[None] for values in (q, dq, ddq)]
    around = constraints.surroundings
    near: list[Near] = []
    if around is not None:
        near = [_near(around.bodies, kind, pairs, rows[0]) for kind, pairs in around.pairs.items()]
    return constraints.usage(*rows).worst, near


def _near(bodies: CollisionBodies, kind: str, pairs: JudgedPairs, q: Array) -> Near:
    row = int(bodies.nearest(q, pairs).pair[0])
    first, second = pairs.bodies[row]
    distance, ends = bodies.closest(q[0], int(first), int(second))
    # The arm first: names stand so.
    start, end = ends[::-1] if kind == "environment" else ends
    return Near(
        kind=kind,
        names=pairs.names[row],
        distance=distance,
        clearance=float(pairs.required[row]),
        start=start,
        end=end,
    )


_EVERY_S = 0.3
_BUSY = 20.0
"""Reading takes one part in so many of the time at most."""


class TailReader:
    """Reads now and then the recording that is going to be a Parquet file at a path."""

    def __init__(self, path: Path) -> None:
        self._path = partial_path(path)
        self._next = 0.0
        self._size = 0

    def read(self, now: float) -> ExperimentRecord | None:
        """What there is at a time of a clock that only goes forward [s].

        None where there is nothing new, or it is too early to look.
        """
        if now < self._next:
            return None
        self._next = now + _EVERY_S
        try:
            size = self._path.stat().st_size
            if size == self._size:
                return None
            began = time.perf_counter()
            record = recover(self._path, finished=True)
        except (OSError, RecordError):
            # Not begun, two rows too few, or finished between two looks.
            return None
        self._size = size
        self._next = now + max(_EVERY_S, _BUSY * (time.perf_counter() - began))
        return record
