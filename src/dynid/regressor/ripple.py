"""Torque ripple of gears: periodic in the joint's position, many times a turn.

The wave generator of a strain-wave gear meets the spline twice a turn of the motor; its errors
show in the torque hundreds of times a turn of the joint. What the structure makes of them
depends on how fast they pass.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError

MOST_POWERS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Gear:
    """What one gear's ripple looks like: waves a turn and how they change with speed.

    Raises:
        InputError: A negative joint, no waves, numbers that are not positive and finite.
    """

    joint: int
    """The joint whose position it follows, from 0."""
    waves: tuple[float, ...]
    """Periods a turn of the joint."""
    speed: float
    """Highest speed that was seen [rad/s]: beyond it the ripple stays as it is."""
    powers: int
    """Powers of the speed, from 0, that the size of each wave is made of."""

    def __post_init__(self) -> None:
        numbers = (*self.waves, self.speed)
        good = all(math.isfinite(x) and x > 0 for x in numbers)
        if self.joint < 0 or not self.waves or not good or not 1 <= self.powers <= MOST_POWERS:
            raise InputError("a gear's ripple cannot be read", value=self)

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return 2 * len(self.waves) * self.powers

    def columns(self, q: Array, dq: Array) -> Array:
        """(size, N) what the coefficients multiply.

        For each wave and each power of the speed from 0: the cosine, the sine.

        Args:
            q: (N) positions of the gear's joint [rad].
            dq: (N) its velocities [rad/s].
        """
        share = np.clip(dq / self.speed, -1.0, 1.0)
        scales = [share**power for power in range(self.powers)]
        return np.array(
            [
                scale * wave
                for number in self.waves
                for scale in scales
                for wave in (np.cos(number * q), np.sin(number * q))
            ]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueRipple:
    """The ripple in one joint's torque: of its own gear, and of others that shake the arm.

    The coefficients come from an earlier fit and are part of the column's shape.

    Raises:
        InputError: A negative joint, no gears, coefficients that do not fit or are not finite.
    """

    joint: int
    """From 0."""
    gears: tuple[Gear, ...]
    coefficients: tuple[float, ...]
    """Those of each gear, one after the other [N.m]."""

    def __post_init__(self) -> None:
        wanted = sum(gear.size for gear in self.gears)
        finite = all(math.isfinite(x) for x in self.coefficients)
        if self.joint < 0 or not self.gears or len(self.coefficients) != wanted or not finite:
            raise InputError(
                "torque ripple cannot be read",
                value=f"joint {self.joint + 1}, {len(self.coefficients)} coefficients",
                limit=f"{wanted} finite ones",
            )

    def torque(self, q: Array, dq: Array) -> Array:
        """(N) the ripple [N.m] at positions and velocities (n, N) of all joints."""
        columns = [gear.columns(q[gear.joint], dq[gear.joint]) for gear in self.gears]
        total = np.array(self.coefficients) @ np.concatenate(columns)
        return np.asarray(total, dtype=np.float64)

    def describe(self) -> str:
        """In words."""
        gears = ", ".join(
            f"{' '.join(f'{wave:.4g}' for wave in gear.waves)} waves a turn of joint "
            f"{gear.joint + 1}"
            for gear in self.gears
        )
        return f"torque ripple of joint {self.joint + 1}: {gears}"

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        gears = [
            {**asdict(gear), "joint": gear.joint + 1, "waves": list(gear.waves)}
            for gear in self.gears
        ]
        return {
            "joint": self.joint + 1,
            "gears": gears,
            "coefficients": list(self.coefficients),
        }


def ripples_from_json(data: Sequence[Mapping[str, Any]] | None) -> tuple[TorqueRipple, ...]:
    """The inverse of `TorqueRipple.to_json` for each of several."""
    return tuple(
        TorqueRipple(
            joint=int(one["joint"]) - 1,
            gears=tuple(
                Gear(
                    joint=int(gear["joint"]) - 1,
                    waves=tuple(float(x) for x in gear["waves"]),
                    speed=float(gear["speed"]),
                    powers=int(gear["powers"]),
                )
                for gear in one["gears"]
            ),
            coefficients=tuple(float(x) for x in one["coefficients"]),
        )
        for one in data or ()
    )
