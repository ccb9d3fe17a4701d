"""Fifth-order polynomials through a list of poses, at rest in each of them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.trajectory.blends import STEP, three_values
from dynid.trajectory.bounds import MotionLimits
from dynid.trajectory.family import MotionFamily
from dynid.trajectory.fourier import check_period
from dynid.trajectory.quintic import Quintic, rest_to_rest
from dynid.trajectory.sequence import chained
from dynid.trajectory.trajectory import Trajectory


def through_poses(
    poses: ArrayLike,
    limits: MotionLimits,
    *,
    margin: float = 0.5,
    acceleration: ArrayLike | None = None,
) -> Trajectory:
    """The fastest fifth-order polynomials from pose to pose that the limits allow.

    Args:
        poses: (m, n) poses, two or more [rad or m].
        limits: Joint limits; unknown positions count as -pi to pi, other unknowns do not bind.
        margin: Share of the velocity and acceleration limits to use, in (0, 1].
        acceleration: (n) or one number: acceleration limits where `limits` knows none
            [rad/s^2 or m/s^2].

    Raises:
        InputError: Fewer than two poses, a pose outside the position limits, a margin outside
            (0, 1], or no limit that bounds the speed.
    """
    places = frozen(poses, shape=(None, None), name="poses")
    if len(places) < 2:
        raise InputError("a motion needs two poses", value=len(places))
    return chained(
        [
            rest_to_rest(start, goal, limits, margin=margin, acceleration=acceleration)
            for start, goal in itertools.pairwise(places)
        ]
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PosesFamily(MotionFamily):
    """From the offset through free poses, a rest in each, and back, in equal times.

    Raises:
        InputError: A travel time that is not positive, or no free poses.
    """

    name: ClassVar[str] = "poses"
    travel_time: float
    """Time from start to end [s]."""
    poses: int
    """Free poses between the ends."""

    def __post_init__(self) -> None:
        check_period(self.travel_time)
        if self.poses < 1:
            raise InputError("a motion through poses needs one", value=self.poses)

    @property
    def duration(self) -> float:
        """The travel time [s]."""
        return self.travel_time

    @property
    def free_count(self) -> int:
        """One free number a pose, relative to the offset."""
        return self.poses

    def basis(self, t: Array) -> tuple[Array, Array, Array]:
        """A column rises to one towards its pose and falls back to zero towards the next.

        Args:
            t: (N) times within the travel time [s].
        """
        leg = self.travel_time / (self.poses + 1)
        number = np.clip(np.floor(t / leg).astype(np.intp), 0, self.poses)
        place, speed, push = three_values(STEP, np.clip(t / leg - number, 0.0, 1.0))
        columns = np.arange(self.poses)
        rising, falling = columns == number[:, None], columns == number[:, None] - 1
        sign = rising * 1.0 - falling * 1.0
        return (
            sign * place[:, None] + falling,
            sign * (speed / leg)[:, None],
            sign * (push / leg**2)[:, None],
        )

    def trajectory(self, offset: ArrayLike, free: ArrayLike) -> Trajectory:
        """The member with these numbers.

        Args:
            offset: (n) pose at both ends [rad or m].
            free: (n, poses) the poses between, relative to the offset [rad or m].

        Raises:
            InputError: Shapes that disagree, or numbers that are not finite.
        """
        pose = frozen(offset, shape=(None,), name="offset")
        numbers = frozen(free, shape=(len(pose), self.poses), name="free numbers")
        places = np.vstack([pose, pose + numbers.T, pose])
        leg = self.travel_time / (self.poses + 1)
        return chained(
            [
                Quintic(start=start, goal=goal, travel_time=leg)
                for start, goal in itertools.pairwise(places)
            ]
        )
