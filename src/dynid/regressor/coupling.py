"""Columns of motors that drive several joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.regressor.blocks import Column, ColumnBlock, Width, smooth_sign, unit
from dynid.regressor.terms import PAPER_WIDTH
from dynid.robot.model import RobotModel


@dataclass(frozen=True, kw_only=True)
class Coupling(ColumnBlock):
    """Friction and inertia of motors that drive several joints (Staubli, ABB wrists).

    Motor m turns at r' dq with r = N[m] / N[m, m]; its inertia, viscous and Coulomb torques act
    on the joints through r (methods.md, BIRDy's TX40).
    """

    width: Width = PAPER_WIDTH

    def columns(self, robot: RobotModel) -> tuple[Column, ...]:
        """See `ColumnBlock`."""
        rows = coupled_motors(robot)
        return tuple(
            Column(f"{symbol}{m + 1}", unit(power, robot.prismatic[m]), m)
            for symbol, power in (("Fcm", 0), ("Fvm", 1), ("Imm", 2))
            for m in rows
        )

    def fill(self, robot: RobotModel, dq: Array, ddq: Array, out: Array) -> None:
        """See `ColumnBlock`."""
        rows = coupled_motors(robot)
        ratio = robot.drives.motor_from_joint
        for k, m in enumerate(rows):
            share = ratio[m] / ratio[m, m]
            speed = share @ dq
            width = self.width[m] if isinstance(self.width, tuple) else self.width
            terms = (smooth_sign(speed, width), speed, share @ ddq)
            for block, term in enumerate(terms):
                out[block * len(rows) + k] = share[:, None] * term


def coupled_motors(robot: RobotModel) -> tuple[int, ...]:
    """Motors whose row of the coupling matrix reaches more than their own joint."""
    if robot.drives.coupling is None:
        return ()
    return tuple(m for m, row in enumerate(robot.drives.coupling) if np.count_nonzero(row) > 1)
