"""What can be played: a designed motion, or what a recording saw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dynid.core.arrays import Array
from dynid.recording.record import ExperimentRecord
from dynid.trajectory.trajectory import Trajectory

REST = "nothing moves"
"""Name of the motion that is none."""


class Playable(Protocol):
    """A motion with a name and an end."""

    @property
    def name(self) -> str:
        """What the page calls it."""
        ...

    @property
    def duration(self) -> float:
        """When it ends [s]."""
        ...

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations (n) at a time [s]."""
        ...


@dataclass(frozen=True, slots=True)
class PlayedTrajectory:
    """A trajectory; the certificate is about it."""

    name: str
    trajectory: Trajectory

    @property
    def duration(self) -> float:
        """Its own [s]."""
        return self.trajectory.duration

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """See `Playable.at`."""
        motion = self.trajectory.evaluate(np.array([t]))
        return motion.q[0], motion.dq[0], motion.ddq[0]


class PlayedRecord:
    """What was measured, between the samples in a straight line.

    Velocities are the measured ones where there are any; accelerations are their differences,
    rough as the encoders are.

    Args:
        name: What the page calls it.
        record: The recording, with `q`.
    """

    def __init__(self, name: str, record: ExperimentRecord) -> None:
        self.name = name
        self._t: Array = record.t - record.t[0]
        self._q = record.signals["q"]
        measured = record.signals.get("qd")
        self._dq = np.gradient(self._q, self._t, axis=0) if measured is None else measured
        self._ddq = np.gradient(self._dq, self._t, axis=0)

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self._t[-1])

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """See `Playable.at`."""
        after = int(np.clip(np.searchsorted(self._t, t), 1, len(self._t) - 1))
        low, high = self._t[after - 1], self._t[after]
        share = float(np.clip((t - low) / (high - low), 0.0, 1.0))
        q, dq, ddq = (
            (1.0 - share) * values[after - 1] + share * values[after]
            for values in (self._q, self._dq, self._ddq)
        )
        return q, dq, ddq


@dataclass(frozen=True, slots=True)
class Held:
    """A pose that somebody holds by hand."""

    q: Array
    """(n) [rad or m]"""
    name: str = REST
    duration: float = 1.0

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """The pose, at rest."""
        rest = np.zeros(len(self.q))
        return self.q, rest, rest
