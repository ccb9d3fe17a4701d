"""A joint motion: positions, velocities and accelerations over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, frozen


@dataclass(frozen=True, slots=True, kw_only=True)
class JointMotion:
    """Samples of a motion.

    Raises:
        InputError: Shapes that disagree, or numbers that are not finite.
    """

    t: Array
    """(N) time [s]."""
    q: Array
    """(N, n) positions [rad or m]."""
    dq: Array
    """(N, n) velocities [rad/s or m/s]."""
    ddq: Array
    """(N, n) accelerations [rad/s^2 or m/s^2]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", frozen(self.t, shape=(None,), name="t"))
        object.__setattr__(self, "q", frozen(self.q, shape=(len(self.t), None), name="q"))
        for name in ("dq", "ddq"):
            value = frozen(getattr(self, name), shape=self.q.shape, name=name)
            object.__setattr__(self, name, value)


def still_outside(times: Array, inside: Array, q: Array, dq: Array, ddq: Array) -> JointMotion:
    """A motion that stands at its ends before it begins and after it is over.

    Args:
        times: (N) times that were asked for [s].
        inside: (N) the same, held within the motion [s].
        q: (N, n) positions at `inside` [rad or m].
        dq: (N, n) velocities there.
        ddq: (N, n) accelerations there.
    """
    outside = (times != inside)[:, None]
    return JointMotion(t=times, q=q, dq=np.where(outside, 0.0, dq), ddq=np.where(outside, 0.0, ddq))
