"""Drives: from motor current and motor position to joint torque and joint position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.core.errors import RobotError


@dataclass(frozen=True, slots=True, kw_only=True)
class Drives:
    """Gear ratios, drive gains and transmission coupling.

    The motors turn by `q_motor = N (q - offset)`, so joint torques are `tau = N' tau_motor`
    (power is the same on both sides). Without coupling, N is diagonal: the gear ratios.

    Raises:
        RobotError: Coupling that cannot be inverted, or a gain of zero.
    """

    gain: Array
    """(n) joint torque per motor current [N.m/A], NaN if unknown."""
    gear_ratio: Array
    """(n) motor turns per joint turn, NaN if unknown."""
    coupling: Array | None = None
    """(n, n) N, motor positions per joint positions; None where each motor drives one joint."""
    offset: Array | None = None
    """(n) joint position at motor position zero [rad]; None for zero."""
    position_side: str = "joint"
    """`joint` or `motor`: the side on which this robot's recordings give q, qd, qdd."""
    torque_side: str = "joint"
    """`joint` or `motor`: the side on which this robot's recordings give effort."""

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.gain))
        for name in ("gain", "gear_ratio"):
            value = frozen(getattr(self, name), shape=(n,), name=f"drives {name}", finite=False)
            if (value == 0).any() or np.isinf(value).any():
                raise RobotError(f"drives {name} must be finite and not zero", value=value.tolist())
            object.__setattr__(self, name, value)
        for name in ("position_side", "torque_side"):
            if getattr(self, name) not in ("joint", "motor"):
                raise RobotError(
                    f"drives {name}", value=getattr(self, name), limit="joint or motor"
                )
        if self.offset is not None:
            object.__setattr__(
                self, "offset", frozen(self.offset, shape=(n,), name="drives offset")
            )
        if self.coupling is not None:
            matrix = frozen(self.coupling, shape=(n, n), name="drives coupling")
            object.__setattr__(self, "coupling", matrix)
            if np.linalg.matrix_rank(matrix) < n or (np.diag(matrix) == 0).any():
                raise RobotError("the coupling matrix cannot be inverted or has a zero diagonal")
        uses_motor_side = "motor" in (self.position_side, self.torque_side)
        if uses_motor_side and self.coupling is None and np.isnan(self.gear_ratio).any():
            raise RobotError(
                "recordings on the motor side need gear_ratio or coupling for every joint"
            )

    @property
    def motor_from_joint(self) -> Array:
        """(n, n) N: the coupling, or the diagonal of the gear ratios."""
        return np.diag(self.gear_ratio) if self.coupling is None else self.coupling


def direct_drives(joints: int) -> Drives:
    """Drives of which nothing is known: efforts are joint torques."""
    nan = np.full(joints, np.nan)
    return Drives(gain=nan, gear_ratio=nan)
