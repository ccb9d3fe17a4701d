"""Repair: the columns become the robot's joints, in its order, on the joint's side, in radians."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.core import Array, Mask, RecordError, UnclearRecordError, printable
from dynid.recording.cells import factor_of
from dynid.recording.names import UR_JOINTS, parse_name, places_of, said_of_others
from dynid.recording.table import ANGLES, RawTable
from dynid.robot import RobotModel


def settle_joints(
    table: RawTable, robot: RobotModel | None, joint_order: Sequence[str] | None
) -> RawTable:
    """Check the number of joints and bring the columns into the robot's order.

    Args:
        table: Signals as they came.
        robot: The robot, if known.
        joint_order: Column numbers, base to tip; or the robot's joint names in the order in
            which the file has them; or the file's own names, base to tip.

    Raises:
        RecordError: Another number of joints than the robot's, or an order that is none.
    """
    if "q" not in table.signals:
        raise RecordError("positions q are missing")
    joints = table.joints
    if joints == 0 or table.samples == 0:
        raise RecordError("there are no samples")
    for quantity, values in table.signals.items():
        if values.shape != (table.samples, joints):
            raise RecordError(
                f"{quantity} has {values.shape[-1]} columns but q has {joints}"
                if values.shape[-1] != joints
                else f"{quantity} has {len(values)} rows but q has {table.samples}",
                next_step="Give each quantity one column a joint, and as many rows as q.",
            )
    ordered = joint_order is not None and tuple(joint_order) != table.joint_names
    if joint_order is not None and ordered:
        table = _reorder(table, _permutation(joint_order, joints, robot, table.joint_names))
    elif robot is not None and joints > robot.joints:
        # The file names more, as of a gripper's fingers.
        place = places_of(robot.joint_names, table.joint_names)
        others = [name for k, name in enumerate(table.joint_names) if k not in place]
        if place:
            said = f"left out, as no joints of the robot: {printable(', '.join(others), 200)}"
            table = _reorder(table, place).note(said)
    joints = table.joints
    if robot is not None and joints != robot.joints:
        raise (UnclearRecordError if joints > robot.joints else RecordError)(
            f"the recording has {joints} joints but {robot.name} has {robot.joints}",
            value=printable(", ".join(table.joint_names), 200) or None,
            next_step=_first_columns(table, robot.joints)
            if joints > robot.joints
            else "Give the robot that was recorded, or a robot file that locks the other joints.",
        )
    if robot is not None and table.joint_names and not ordered:
        table = _by_name(table, robot, given=joint_order is not None)
    if robot is not None:
        return replace(table, joint_names=robot.joint_names)
    place = () if joint_order is not None else places_of(UR_JOINTS, table.joint_names)
    return _reorder(table, place) if len(place) == joints else table


def _permutation(
    order: Sequence[str], joints: int, robot: RobotModel | None, own: tuple[str, ...]
) -> list[int]:
    names = [str(name).strip() for name in order]
    if all(name.isdecimal() for name in names):
        numbers = [int(name) for name in names]
        if sorted(numbers) == list(range(joints)):
            return numbers
    elif robot is not None and sorted(names) == sorted(robot.joint_names):
        return [names.index(name) for name in robot.joint_names]
    elif names and set(names) <= set(own) and len(set(names)) == len(names):
        return [own.index(name) for name in names]
    raise RecordError(
        "the joint order names something else",
        value=tuple(names),
        limit=(
            f"a permutation of 0 to {joints - 1}"
            + (f", or of {', '.join(robot.joint_names)}" if robot else "")
            + (f", or of {printable(', '.join(own), 200)}" if own else "")
        ),
    )


def _by_name(table: RawTable, robot: RobotModel, *, given: bool) -> RawTable:
    place = places_of(robot.joint_names, table.joint_names)
    if place or given:
        return _reorder(table, place) if place else table
    # A robot file may call its joints differently from the driver.
    known = places_of(UR_JOINTS, table.joint_names) or _numbered(table.joint_names)
    ordered = _reorder(table, known) if known else table
    taken = "by their own names or numbers" if known else "in this order"
    text = said_of_others(table.joint_names, robot.joint_names, taken)
    return ordered.report("unit_suspect", text)


def _numbered(names: Sequence[str]) -> list[int]:
    """The order of names that all have a number (`joint10` after `joint2`)."""
    numbers = [number for name in names if (number := parse_name(name).index) is not None]
    if len({*numbers}) < len(names):
        return []
    return sorted(range(len(names)), key=lambda k: numbers[k])


def _first_columns(table: RawTable, joints: int) -> str:
    """What to type to take the first columns of each quantity."""
    if table.joint_names:
        return (
            f"Name the {joints} joints of the robot, base to tip, with --joint-order, for example "
            f"--joint-order {printable(','.join(table.joint_names[:joints]), 300)}"
        )
    return "Choose the columns with --columns, or lock the robot's other joints."


def _reorder(table: RawTable, place: Sequence[int]) -> RawTable:
    if list(place) == list(range(table.joints)):
        return table
    whole = {name for name, numbers in table.columns.items() if len(numbers) == table.joints}
    named = {name for name, labels in table.labels.items() if len(labels) == table.joints}
    table = replace(
        table,
        columns={**table.columns, **{q: [table.columns[q][k] for k in place] for q in whole}},
        labels={**table.labels, **{q: tuple(table.labels[q][k] for k in place) for q in named}},
        joint_names=tuple(table.joint_names[k] for k in place) if table.joint_names else (),
        signals={name: v[:, list(place)] for name, v in table.signals.items()},
    )
    return table.note(f"columns put in the joints' order: {list(place)}")


def to_joint_side(table: RawTable, robot: RobotModel | None) -> RawTable:
    """Convert positions and torques that the robot file says are motor values.

    With motor positions q_m = N (q - offset): q = N^-1 q_m + offset, tau = N' tau_m.
    """
    if robot is None:
        return table
    drives = robot.drives
    changes: dict[str, Array] = {}
    for name, value in table.signals.items():
        if name in ANGLES and drives.position_side == "motor":
            changes[name] = value @ np.linalg.inv(drives.motor_from_joint).T
            if drives.offset is not None and name in ("q", "target_q"):
                changes[name] += drives.offset
        elif name in ("effort", "target_moment") and drives.torque_side == "motor":
            changes[name] = value @ drives.motor_from_joint
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


_TURN = 2 * np.pi
_USE_DEGREES = "If they are degrees, pass --degrees."


def revolute(joints: int, robot: RobotModel | None) -> Mask:
    """For each joint, whether it turns; every joint does where the robot is unknown."""
    if robot is None:
        return np.ones(joints, dtype=np.bool_)
    return ~np.array(robot.prismatic, dtype=np.bool_)


def convert_degrees(table: RawTable, robot: RobotModel | None, degrees: bool) -> RawTable:
    """Turn degrees into radians where the user says so and the file says nothing.

    Prismatic joints are never converted.
    """
    if not degrees:
        return table
    turning = revolute(table.joints, robot)
    # What the file says of its units is converted already.
    open_ones = [name for name in table.signals if name in ANGLES and name not in table.said]
    if not open_ones:
        return table.note("--degrees changes nothing: the file says its units itself")
    factor = np.where(turning, np.pi / 180, 1.0)
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
        jump = f"{table.label(quantity, joint)} jumps by a whole turn at {table.row(row)}"
        found.append(f"{jump} ({int(wraps.sum())} jumps in all)")
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
        low: Array = value.min(axis=0)
        high: Array = value.max(axis=0)
        outside = (low < lower - 0.05) | (high > upper + 0.05)
        bounded = np.isfinite(lower) & np.isfinite(upper) & revolute(table.joints, robot)
        middle: Array = np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0)
        count: Array = np.rint(0.5 * (low + high - middle) / _TURN)
        fits = (low - count * _TURN >= lower - 0.05) & (high - count * _TURN <= upper + 0.05)
        turns: Array = np.where(bounded & outside & fits, count, 0.0)
        if turns.any():
            table = table.with_signals({quantity: value - _TURN * turns})
            shifted += [f"{quantity} of joint {k + 1}" for k in np.flatnonzero(turns)]
    if not shifted:
        return table
    return table.note(f"shifted by whole turns into the limits: {', '.join(shifted)}")


def refuse_degrees(table: RawTable, robot: RobotModel | None) -> RawTable:
    """Refuse positions that no joint can have in radians; report those that are odd.

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
            f"{table.label('q', joint)} reaches {reach[joint]:.4g} rad: probably degrees (pass "
            "--degrees), or measured on the motor's side (give --robot with its gear ratios)",
        )
    table = _report_other_kinds(table, robot)
    limits = robot.limits
    bound = np.fmax(np.abs(limits.lower), np.abs(limits.upper))
    known = np.isfinite(bound)
    beyond = turning & known & (reach > 2 * np.where(known, bound, 0.0) + np.pi)
    many_turns = turning & ~known & (reach > 4 * _TURN)
    if beyond.any() or (many_turns.any() and 2 * many_turns.sum() >= turning.sum()):
        joint = int(np.argmax(np.where(beyond if beyond.any() else many_turns, reach, -1.0)))
        raise UnclearRecordError(
            f"{table.label('q', joint)} reaches {reach[joint]:.4g}, which cannot be radians",
            limit=f"{bound[joint]:.4g} rad" if known[joint] else "a few turns",
            next_step=_USE_DEGREES,
        )
    too_far = ~turning & (bound > 0) & (reach > 20 * bound)
    if too_far.any():
        joint = int(np.argmax(too_far))
        raise RecordError(
            f"{table.label('q', joint)} reaches {reach[joint]:.4g}, which cannot be metres",
            limit=f"{bound[joint]:.4g} m",
            next_step=f"If they are millimetres, name the column so, as in q{joint + 1} [mm].",
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
            f"{robot.name} ({int(outside.sum())} joints do): check units, offsets and joint order",
        )
    return table


_LENGTHS = re.compile(r"(m|mm|cm|um)(?![a-z])", re.IGNORECASE)


def _report_other_kinds(table: RawTable, robot: RobotModel) -> RawTable:
    """Report columns that were converted from angles where the joint slides, or from lengths."""
    if robot.drives.position_side == "motor":
        return table
    for quantity in [name for name in table.signals if name in ANGLES]:
        labels = zip(table.labels.get(quantity, ()), robot.prismatic, strict=False)
        for joint, (label, slides) in enumerate(labels):
            unit = parse_name(label, robot.joint_names).unit
            changed = factor_of(quantity, unit) not in (None, 1.0)
            if changed and slides != bool(_LENGTHS.match(unit)):
                table = table.report(
                    "unit_suspect",
                    f"{table.label(quantity, joint)} was converted from {printable(unit, 20)}, "
                    f"but the joint {'slides' if slides else 'turns'}: check the unit",
                    (joint,),
                )
    return table
