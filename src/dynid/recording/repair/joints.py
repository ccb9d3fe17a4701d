"""Repair, first step: the columns become the robot's joints, in its order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from dynid.core import RecordError
from dynid.recording.families import spelled
from dynid.recording.jointnames import places_of, plainly
from dynid.recording.table import RawTable, plain
from dynid.recording.vocabulary import UR_JOINTS
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
        raise RecordError("positions q are missing", where=table.source)
    joints = table.joints
    if joints == 0 or table.samples == 0:
        raise RecordError("there are no samples", where=table.source)
    for quantity, values in table.signals.items():
        if values.shape != (table.samples, joints):
            raise RecordError(
                f"{quantity} has {values.shape[-1]} columns but q has {joints}",
                where=table.source,
                next_step="Give each quantity one column a joint.",
            )
    ordered = joint_order is not None and tuple(joint_order) != table.joint_names
    if joint_order is not None and ordered:
        table = _reorder(table, _permutation(joint_order, joints, robot, table.joint_names))
    elif robot is not None and joints > robot.joints:
        table = _without_others(table, robot)
    joints = table.joints
    if robot is not None and joints != robot.joints:
        raise RecordError(
            f"the recording has {joints} joints but {robot.name} has {robot.joints}",
            where=table.source,
            value=plain(", ".join(table.joint_names), 200) or None,
            next_step=_first_columns(table, robot.joints)
            if joints > robot.joints
            else "Give the robot that was recorded, or a robot file that locks the other joints.",
        )
    if robot is not None and table.joint_names and not ordered:
        table = _by_name(table, robot)
    names = robot.joint_names if robot is not None else table.joint_names
    return replace(table, joint_names=names)


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
            + (f", or of {plain(', '.join(own), 200)}" if own else "")
        ),
    )


def _by_name(table: RawTable, robot: RobotModel) -> RawTable:
    place = places_of(robot.joint_names, table.joint_names)
    if place:
        return _reorder(table, place)
    # A robot file may call its joints differently from the driver.
    known = places_of(UR_JOINTS, table.joint_names) or _numbered(table.joint_names)
    ordered = _reorder(table, known) if known else table
    return ordered.report(
        "unit_suspect",
        f"the joints are called {plain(', '.join(table.joint_names), 200)} and not "
        f"{plain(', '.join(robot.joint_names), 200)}; they are taken "
        + ("by their own names or numbers" if known else "in this order")
        + ": check it, or give --joint-order",
    )


def _numbered(names: Sequence[str]) -> list[int]:
    """The order of names that differ by their last number only (`joint10` after `joint2`)."""
    parts = [re.fullmatch(r"(.*?)(\d+)(\D*)", plainly(name)) for name in names]
    stems = {(part.group(1), part.group(3)) for part in parts if part}
    if len(stems) != 1 or not all(parts):
        return []
    return sorted(range(len(names)), key=lambda k: int(parts[k].group(2)) if parts[k] else 0)  # pyright: ignore[reportOptionalMemberAccess]


def _without_others(table: RawTable, robot: RobotModel) -> RawTable:
    """Only the robot's joints, where the file names more (a gripper's fingers)."""
    place = places_of(robot.joint_names, table.joint_names)
    if not place:
        return table
    others = [name for k, name in enumerate(table.joint_names) if k not in place]
    table = _reorder(table, place)
    return table.note(f"left out, as no joints of the robot: {plain(', '.join(others), 200)}")


def _first_columns(table: RawTable, joints: int) -> str:
    """What to type to take the first columns of each quantity."""
    if table.joint_names:
        return (
            f"Name the {joints} joints of the robot, base to tip, with --joint-order, for example "
            f"--joint-order {plain(','.join(table.joint_names[:joints]), 300)}"
        )
    if not table.columns:
        return "Choose the columns with --columns, or lock the robot's other joints."
    time = {"t": list(table.clock_columns)} if table.clock_columns else {}
    first = {name: columns[:joints] for name, columns in table.columns.items()}
    kept = {name: first[name] for name in ("q", "qd", "current", "effort") if name in first}
    return (
        f"If the robot's joints come first, type --columns {spelled({**time, **kept})}; "
        "otherwise choose others."
    )


def _reorder(table: RawTable, place: list[int]) -> RawTable:
    if place == list(range(table.joints)):
        return table
    labels = {
        quantity: tuple(names[k] for k in place) if len(names) == table.joints else names
        for quantity, names in table.labels.items()
    }
    names = table.joint_names
    columns = {
        quantity: [numbers[k] for k in place] if len(numbers) == table.joints else numbers
        for quantity, numbers in table.columns.items()
    }
    table = replace(
        table,
        columns=columns,
        labels=labels,
        joint_names=tuple(names[k] for k in place) if names else (),
        signals={name: v[:, place] for name, v in table.signals.items()},
    )
    return table.note(f"columns put in the joints' order: {place}")
