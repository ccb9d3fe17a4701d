"""Repair: degrees, full turns, and positions that cannot be radians."""

from __future__ import annotations

import math

import numpy as np

from dynid.core import Array, RecordError
from dynid.recording.table import ANGLES, Mask, RawTable
from dynid.robot import RobotModel

_TURN = 2 * math.pi
_USE_DEGREES = "If they are degrees, pass --degrees."
"""Ends the words of this repair, which leaves nothing to check."""


def revolute(joints: int, robot: RobotModel | None) -> Mask:
    """For each joint, whether it turns; every joint does where the robot is unknown."""
    if robot is None:
        return np.ones(joints, dtype=np.bool_)
    return ~np.array(robot.prismatic, dtype=np.bool_)


def convert_degrees(table: RawTable, robot: RobotModel | None, degrees: bool) -> RawTable:
    """Turn degrees into radians where the user says so and the file says nothing.

    Args:
        table: Signals as they came.
        robot: The robot, if known; prismatic joints are never converted.
        degrees: Whether q, qd, qdd and their targets are in degrees.
    """
    if not degrees:
        return table
    turning = revolute(table.joints, robot)
    # What the file says of its units is converted already.
    open_ones = [name for name in table.signals if name in ANGLES and name not in table.said]
    if not open_ones:
        return table.note("--degrees changes nothing: the file says its units itself")
    factor = np.where(turning, math.pi / 180, 1.0)
    reach = float(np.abs(table.signals["q"][:, turning]).max(initial=0.0))
    table = table.with_signals({name: table.signals[name] * factor for name in open_ones})
    if 0 < reach <= _TURN and "q" in open_ones:
        table = table.report(
            "unit_suspect",
            f"positions reach {reach:.3g} in the file and were converted from degrees as asked; "
            "they may have been radians",
        )
    return table


def unwrap_turns(table: RawTable, robot: RobotModel | None) -> RawTable:
    """Take out jumps of whole turns between neighbouring samples, and report them."""
    turning = revolute(table.joints, robot)
    changes: dict[str, Array] = {}
    found: list[str] = []
    for quantity in ("q", "target_q"):
        value = table.signals.get(quantity)
        if value is None or len(value) < 3:
            continue
        steps = np.diff(value, axis=0)
        turns = np.round(steps / _TURN)
        rest = steps - turns * _TURN
        usual = np.quantile(np.abs(rest), 0.999, axis=0)
        # Fast motors turn so far between samples that a turn cannot be told from motion.
        slow = np.quantile(np.abs(steps), 0.98, axis=0) < 1.0
        near = np.abs(rest) <= np.clip(3 * usual, 0.02, 0.6)
        wraps = (np.abs(turns) == 1) & near & (slow & turning)
        if not wraps.any():
            continue
        shift = np.concatenate([np.zeros((1, table.joints)), np.cumsum(turns * wraps, axis=0)])
        changes[quantity] = value - shift * _TURN
        joint = int(np.argmax(wraps.any(axis=0)))
        row = int(np.argmax(wraps[:, joint])) + 1
        found.append(
            f"{table.label(quantity, joint)} jumps by a whole turn at {table.row(row)} "
            f"({int(wraps.sum())} jumps in all)"
        )
    if not found:
        return table
    return table.with_signals(changes).report("unwrapped", f"{'; '.join(found)}; unwrapped")


def shift_turns(table: RawTable, robot: RobotModel | None) -> RawTable:
    """Shift joints by whole turns into the robot's limits: 350 deg is -10 deg elsewhere."""
    if robot is None:
        return table
    lower, upper = robot.limits.lower, robot.limits.upper
    shifted: list[str] = []
    for quantity in ("q", "target_q"):
        if quantity not in table.signals:
            continue
        value = table.signals[quantity]
        low, high = value.min(axis=0), value.max(axis=0)
        turns = np.zeros(table.joints)
        for joint in np.flatnonzero(revolute(table.joints, robot)).tolist():
            if not (np.isfinite(lower[joint]) and np.isfinite(upper[joint])):
                continue
            outside = low[joint] < lower[joint] - 0.05 or high[joint] > upper[joint] + 0.05
            middle = 0.5 * (low[joint] + high[joint] - lower[joint] - upper[joint])
            count = round(middle / _TURN)
            fits = (
                low[joint] - count * _TURN >= lower[joint] - 0.05
                and high[joint] - count * _TURN <= upper[joint] + 0.05
            )
            turns[joint] = count if outside and fits else 0
        if turns.any():
            table = table.with_signals({quantity: value - _TURN * turns})
            shifted += [f"{quantity} of joint {k + 1}" for k in np.flatnonzero(turns)]
    if not shifted:
        return table
    return table.note(f"shifted by whole turns into the limits: {', '.join(shifted)}")


def refuse_degrees(table: RawTable, robot: RobotModel | None) -> RawTable:
    """Refuse positions that no joint can have in radians; report those that are odd.

    Args:
        table: Joint-side signals, already converted where asked.
        robot: The robot, if known.

    Raises:
        RecordError: The robot's limits are exceeded far beyond anything but a wrong unit.
    """
    reach = np.quantile(np.abs(table.signals["q"]), 0.99, axis=0)
    turning = revolute(table.joints, robot)
    if robot is None:
        wide = reach > _TURN + 0.5
        if not wide.any():
            return table
        joint = int(np.argmax(reach))
        return table.report(
            "unit_suspect",
            f"{table.label('q', joint)} reaches {reach[joint]:.4g} rad: degrees (pass --degrees), "
            "or measured on the motor's side (give --robot with its gear ratios)?",
        )
    limits = robot.limits
    bound = np.fmax(np.abs(limits.lower), np.abs(limits.upper))
    known = np.isfinite(bound)
    beyond = turning & known & (reach > 2 * np.where(known, bound, 0.0) + math.pi)
    many_turns = turning & ~known & (reach > 4 * _TURN)
    if beyond.any() or (many_turns.any() and 2 * many_turns.sum() >= turning.sum()):
        joint = int(np.argmax(np.where(beyond if beyond.any() else many_turns, reach, -1.0)))
        raise RecordError(
            f"{table.label('q', joint)} reaches {reach[joint]:.4g}, which cannot be radians",
            where=table.source,
            limit=f"{bound[joint]:.4g} rad" if known[joint] else "a few turns",
            next_step=_USE_DEGREES,
        )
    q = table.signals["q"]
    low = np.nanmax(np.where(np.isnan(limits.lower), -np.inf, limits.lower - q), axis=0)
    high = np.nanmax(np.where(np.isnan(limits.upper), -np.inf, q - limits.upper), axis=0)
    excess = np.maximum(low, high)
    outside = (excess > 0.05) | (many_turns)
    if outside.any():
        excess = np.where(np.isfinite(excess), excess, reach)
        joint = int(np.argmax(np.where(outside, excess, -np.inf)))
        table = table.report(
            "unit_suspect",
            f"{table.label('q', joint)} goes {excess[joint]:.3g} beyond the limits of "
            f"{robot.name} ({int(outside.sum())} joints do): another unit, offset or order?",
        )
    return table
