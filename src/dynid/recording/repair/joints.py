"""Repair, first step: the columns become the robot's joints, in its order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dynid.core.errors import RecordError
from dynid.recording.table import RawTable, plain
from dynid.robot.model import RobotModel


def settle_joints(
    table: RawTable, robot: RobotModel | None, joint_order: Sequence[str] | None
) -> RawTable:
    """Check the number of joints and bring the columns into the robot's order.

    Args:
        table: Signals as they came.
        robot: The robot, if known.
        joint_order: Column numbers, base to tip; or the robot's joint names in the order in
            which the file has them.

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
    if robot is not None and joints != robot.joints:
        raise RecordError(
            f"the recording has {joints} joints but {robot.name} has {robot.joints}",
            where=table.source,
            next_step="Choose the columns with --columns, or lock the robot's other joints.",
        )
    if joint_order is not None and tuple(joint_order) != table.joint_names:
        table = _reorder(table, _permutation(joint_order, joints, robot))
    elif robot is not None and table.joint_names:
        table = _by_name(table, robot)
    names = robot.joint_names if robot is not None else table.joint_names
    return replace(table, joint_names=names)


def _permutation(order: Sequence[str], joints: int, robot: RobotModel | None) -> list[int]:
    names = [str(name).strip() for name in order]
    if all(name.isdecimal() for name in names):
        numbers = [int(name) for name in names]
        if sorted(numbers) == list(range(joints)):
            return numbers
    elif robot is not None and sorted(names) == sorted(robot.joint_names):
        return [names.index(name) for name in robot.joint_names]
    raise RecordError(
        "the joint order names something else",
        value=tuple(names),
        limit=(
            f"a permutation of 0 to {joints - 1}"
            + (f", or of {', '.join(robot.joint_names)}" if robot else "")
        ),
    )


def _by_name(table: RawTable, robot: RobotModel) -> RawTable:
    place: list[int] = []
    for name in robot.joint_names:
        found = [k for k, other in enumerate(table.joint_names) if other.endswith(name)]
        if len(found) != 1:
            break
        place.append(found[0])
    if len(set(place)) == robot.joints:
        return _reorder(table, place)
    return table.report(
        "unit_suspect",
        f"the joints are called {plain(', '.join(table.joint_names), 200)} and not "
        f"{plain(', '.join(robot.joint_names), 200)}; they are taken in this order: check it, "
        "or give --joint-order",
    )


def _reorder(table: RawTable, place: list[int]) -> RawTable:
    if place == list(range(len(place))):
        return table
    labels = {
        quantity: tuple(names[k] for k in place) if len(names) == len(place) else names
        for quantity, names in table.labels.items()
    }
    table = replace(
        table, labels=labels, signals={name: v[:, place] for name, v in table.signals.items()}
    )
    return table.note(f"columns put in the joints' order: {place}")
