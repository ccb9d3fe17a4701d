"""Repair: signals measured on the motor's side become joint signals."""

from __future__ import annotations

import re

import numpy as np

from dynid.core import Array
from dynid.recording.table import ANGLES, RawTable
from dynid.robot import RobotModel


def to_joint_side(table: RawTable, robot: RobotModel | None) -> RawTable:
    """Convert positions and torques that the robot file says are motor values.

    With motor positions q_m = N (q - offset): q = N^-1 q_m + offset, tau = N' tau_m.
    """
    if robot is None:
        return table
    drives = robot.drives
    changes: dict[str, Array] = {}
    if drives.position_side == "motor":
        back = np.linalg.inv(drives.motor_from_joint)
        for name in ANGLES:
            if name not in table.signals:
                continue
            value = table.signals[name] @ back.T
            if drives.offset is not None and name in ("q", "target_q"):
                value = value + drives.offset
            changes[name] = value
    if drives.torque_side == "motor":
        for name in ("effort", "target_moment"):
            if name in table.signals:
                changes[name] = table.signals[name] @ drives.motor_from_joint
    named = [name for name in ("q", "effort") if name in table.signals and name not in changes]
    for name in named:
        if "motor" in re.split(r"[^a-z]+", " ".join(table.labels.get(name, ())).lower()):
            side = "position_side" if name == "q" else "torque_side"
            table = table.report(
                "unit_suspect",
                f"{table.label(name, 0)} says motor and is taken as the joint's: if it is on the "
                f'motor\'s side, write {side} = "motor" and gear_ratio into a robot file',
            )
    if not changes:
        return table
    return table.with_signals(changes).note(
        f"{', '.join(changes)} converted from the motor's to the joint's side"
    )
