"""What a recording shows that identification must know: standstill, clipping, odd torques."""

from __future__ import annotations

import numpy as np

from dynid.core import Array
from dynid.recording.table import Mask, RawTable, rows_with
from dynid.robot import RobotModel

_LONG_REST = 1.0
"""Standstill at an end that is worth a word [s]."""
_FAR_BEYOND, _FAR_BELOW = 3.0, 0.06
"""Shares of the torque limits that no motion exceeds, and that any motion does."""


def report_rest(table: RawTable) -> RawTable:
    """Report long standstill at the start and end; the rows are kept."""
    if table.t is None or table.samples < 10:
        return table
    moving = _moving(table.t, table.signals["q"])
    if not moving.any():
        return table.report("at_rest", "the robot does not move in this recording")
    start = float(table.t[int(np.argmax(moving))] - table.t[0])
    end = float(table.t[-1] - table.t[len(moving) - 1 - int(np.argmax(moving[::-1]))])
    parts = [
        f"{seconds:.2g} s at the {where}"
        for seconds, where in ((start, "start"), (end, "end"))
        if seconds > _LONG_REST
    ]
    if not parts:
        return table
    return table.report("at_rest", f"the robot stands still for {' and '.join(parts)}")


def _moving(t: Array, q: Array) -> Mask:
    """Rows around which some joint moves by more than its noise."""
    span = max(1, min(len(t) // 4, int(0.1 / max(float(np.median(np.diff(t))), 1e-6))))
    shift = np.abs(q[span:] - q[:-span])
    fastest = float(shift.max(initial=0.0))
    active = rows_with(shift > max(1e-4, 0.005 * fastest))
    mask = np.zeros(len(t), dtype=np.bool_)
    mask[span // 2 : span // 2 + len(active)] = active
    return mask


def report_saturation(table: RawTable) -> RawTable:
    """Report torques and currents that are clipped, or do not change at all."""
    if table.t is None or table.samples < 50:
        return table
    moving = _moving(table.t, table.signals["q"])
    for quantity in ("effort", "current"):
        value = table.signals.get(quantity)
        if value is None:
            continue
        for joint in range(table.joints):
            column = value[:, joint]
            low, high = float(column.min()), float(column.max())
            if low == high:
                if moving.any():
                    table = table.report(
                        "saturated", f"{table.label(quantity, joint)} is {low:.4g} on every row"
                    )
                continue
            clipped = (_at_extreme(column, high) | _at_extreme(column, low)) & moving
            # Clipped values pile up at the limit; a coarse but true peak has neighbours.
            shoulder = 0.03 * (high - low)
            near = ((column >= high - shoulder) | (column <= low + shoulder)) & ~clipped & moving
            if clipped.sum() >= max(10, 0.005 * table.samples, near.sum()):
                peak = high if abs(high) >= abs(low) else low
                table = table.report(
                    "saturated",
                    f"{table.label(quantity, joint)} stands at its extreme ({peak:.4g}) on "
                    f"{int(clipped.sum())} rows of the motion: clipped?",
                )
    return table


def _at_extreme(column: Array, extreme: float) -> Mask:
    """Rows in runs of at least three at the extreme value."""
    at = column == extreme
    run = at.copy()
    run[2:] &= at[1:-1] & at[:-2]
    run[:2] = False
    return run


def report_odd_torques(table: RawTable, robot: RobotModel | None) -> RawTable:
    """Report torques that are far beyond the robot's, and efforts that may be motor currents."""
    if robot is None or np.isnan(robot.limits.torque).all():
        return table
    gains = {"effort": np.ones(robot.joints), "current": np.abs(robot.drives.gain)}
    for quantity, gain in gains.items():
        if quantity not in table.signals or np.isnan(gain).any():
            continue
        share = np.quantile(np.abs(table.signals[quantity]), 0.98, axis=0) * gain
        share = share / robot.limits.torque
        if float(np.nanmax(share)) > _FAR_BEYOND:
            joint = int(np.nanargmax(share))
            table = table.report(
                "unit_suspect",
                f"{table.label(quantity, joint)} stands for {share[joint]:.3g} times the torque "
                "limit: another unit (mA, mN.m, percent), or on the motor's side?",
            )
        # UR drivers send motor currents in A as effort.
        alone = quantity == "effort" and "current" not in table.signals
        small = float(np.nanmax(share)) <= _FAR_BELOW and not np.isnan(robot.drives.gain).any()
        if alone and small:
            table = table.report(
                "unit_suspect",
                f"efforts stay below {100 * float(np.nanmax(share)):.2g} % of the torque limits: "
                "they may be motor currents in A (map them as current, or pass --gains)",
            )
    return table
