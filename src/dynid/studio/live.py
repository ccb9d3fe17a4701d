"""The limits at one instant, and the last seconds of a recording while it is made.

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
from dynid.robot import joint_poses


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Instant:
    """What is true now."""

    poses: Array
    """(n, 4, 4) joint frames in the base frame [m]."""
    worst: dict[str, Worst]
    """Kind of limit to its use."""
    near: tuple[Near, ...]
    """The nearest pair of each kind of distance."""


def instant(constraints: MotionConstraints, q: Array, dq: Array, ddq: Array) -> Instant:
    """Judge one instant: (n) positions, velocities and accelerations."""
    rows = [np.array(values, dtype=np.float64)[None] for values in (q, dq, ddq)]
    around = constraints.surroundings
    near: list[Near] = []
    if around is not None:
        near = [_near(around.bodies, kind, pairs, rows[0]) for kind, pairs in around.pairs.items()]
    worst = constraints.usage(*rows).worst
    return Instant(poses=joint_poses(constraints.robot, q), worst=worst, near=tuple(near))


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


SHOWN_S = 10.0
"""What the page draws [s]."""
POINTS = 400
_EVERY_S = 0.3
_BUSY = 20.0
"""Reading takes one part in so many of the time at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tail:
    """The newest samples."""

    t: Array
    """(N) seconds of the recording."""
    signals: dict[str, Array]
    """Quantity to (N, n) values."""
    samples: int
    """In the whole recording so far."""


class TailReader:
    """Reads a recording in progress now and then.

    Args:
        path: The Parquet file that is going to be made.
    """

    def __init__(self, path: Path) -> None:
        self._path = partial_path(path)
        self._next = 0.0
        self._size = 0

    def read(self, now: float) -> Tail | None:
        """The newest samples; None where there are no new ones, or it is too early to look.

        Args:
            now: Time of a clock that only goes forward [s].
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
        return tail_of(record)


def tail_of(record: ExperimentRecord, seconds: float = SHOWN_S, points: int = POINTS) -> Tail:
    """The end of a recording [s], thinned to what a small plot can show, the newest one kept."""
    stamps: Array = record.t - record.t[0]
    first = int(np.searchsorted(stamps, float(stamps[-1]) - seconds))
    step = max(1, -(-(len(stamps) - first) // points))
    last = len(stamps) - 1
    chosen = np.arange(last - (last - first) // step * step, last + 1, step)
    return Tail(
        t=stamps[chosen],
        signals={name: values[chosen] for name, values in record.signals.items()},
        samples=record.samples,
    )
