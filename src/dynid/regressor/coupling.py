"""Columns of motors that drive several joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.regressor.blocks import Column, ColumnBlock, unit
from dynid.regressor.steps import Width, smooth_sign, smooth_slope
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
        for k, m in enumerate(rows):
            share, width = self._motor(robot, m)
            speed = share @ dq
            terms = (smooth_sign(speed, width), speed, share @ ddq)
            for block, term in enumerate(terms):
                out[block * len(rows) + k] = share[:, None] * term

    def pull(
        self,
        robot: RobotModel,
        dq: Array,
        ddq: Array,
        weights: Array,
        dq_bar: Array,
        ddq_bar: Array,
    ) -> None:
        """See `ColumnBlock`."""
        rows = coupled_motors(robot)
        for k, m in enumerate(rows):
            share, width = self._motor(robot, m)
            coulomb, viscous, inertia = (share @ weights[b * len(rows) + k] for b in range(3))
            speed_bar = coulomb * smooth_slope(share @ dq, width) + viscous
            dq_bar += share[:, None] * speed_bar
            ddq_bar += share[:, None] * inertia

    def _motor(self, robot: RobotModel, motor: int) -> tuple[Array, float]:
        """The motor's turns per joint turn (n), its own joint 1, and its Coulomb width."""
        ratio = robot.drives.motor_from_joint[motor]
        width = self.width[motor] if isinstance(self.width, tuple) else self.width
        return ratio / ratio[motor], width


def coupled_motors(robot: RobotModel) -> tuple[int, ...]:
    """Motors whose row of the coupling matrix reaches more than their own joint."""
    if robot.drives.coupling is None:
        return ()
    return tuple(m for m, row in enumerate(robot.drives.coupling) if np.count_nonzero(row) > 1)
