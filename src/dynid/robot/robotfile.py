"""Robot files: TOML with kinematics, mounting, limits, drives and what else is published.

    name, source, joint_names, frames          texts
    urdf, tip, [locked]                        kinematics from a URDF beside the file, or
    [dh] convention, a, d, alpha, theta, joint_types, sign        from a DH table, or
    [[joint]] name, type, xyz, rpy, axis                          joint by joint
    [base] xyz, rpy    [flange] xyz, rpy       around a DH table or joint rows
    [urdf_frames] xyz, rpy                     where the `urdf` frames stand in the joint frames
    [mount] kind | gravity
    [limits] lower, upper, velocity, acceleration, torque
    [safety] tcp_speed, elbow_speed, momentum, power, elbow       elbow: a joint's name
    [drives] gain, gear_ratio, coupling, offset, position_side, torque_side
    [inertia] frames, mass, com, tensor        tensor: Jxx Jyy Jzz Jyz Jxz Jxy about the com
    [[counterbalance]] joint, outer, inner, rest_length, offset, piston_area, gas_work, gas_volume
    [[capsule]] name, link, frames, start, end, radius            link: `base` or a joint
    [collision] note                           what a verdict should say of the capsules
        apart                                  pairs of links that cannot meet
        overlap, overlap_by                    pairs whose capsules may overlap, and how far

Units are SI; nan stands for an unknown number, and what is not published is left out. Every
table takes `source` and `KEY_source`. Keys that are not listed here are errors.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import RobotError
from dynid.robot.chain import MAX_JOINTS, robot_from_chain
from dynid.robot.dh import CONVENTIONS, robot_from_dh
from dynid.robot.files import is_there, located, shown_path
from dynid.robot.model import FRAMES, RobotModel
from dynid.robot.robotfile_parts import (
    read_capsules,
    read_collision,
    read_counterbalances,
    read_drives,
    read_inertias,
    read_limits,
    read_mount,
    read_safety,
)
from dynid.robot.tables import Table, locked_joints, parse_toml, tables
from dynid.robot.transforms import from_xyz_rpy
from dynid.robot.urdf import load_urdf
from dynid.robot.urdf_capsules import with_collision_geometry

MAX_BYTES = 1_000_000
"""The largest robot file that is read."""

_TOP = (
    "name", "joint_names", "frames", "urdf", "tip", "locked", "dh", "joint", "base", "flange",
    "urdf_frames", "mount", "limits", "safety", "drives", "inertia", "counterbalance", "capsule",
    "collision",
)  # fmt: skip
_TYPES = ("revolute", "prismatic")


def robot_from_toml(data: bytes, path: Path, *, collision: bool = False) -> RobotModel:
    """A robot from the text of a robot file.

    Args:
        data: The text's bytes.
        path: Where the text is from: names the robot if it has no name, and is where a
            relative `urdf` path starts.
        collision: Whether to read a URDF's collision geometry where there is no `capsule`.

    Raises:
        RobotError: Anything that is not a sound robot file; names table and key.
    """
    with located(shown_path(path)):
        top = Table(parse_toml(data), "", "", _TOP)
        robot = _kinematics(top, path)
        sources = [robot.source] if robot.source else []
        changes: dict[str, Any] = {}
        for name, read in (
            ("mount", read_mount),
            ("limits", read_limits),
            ("safety", read_safety),
            ("drives", read_drives),
            ("inertia", read_inertias),
            ("counterbalance", read_counterbalances),
            ("capsule", read_capsules),
            ("collision", read_collision),
        ):
            if name in top:
                with located(name):
                    found, texts = read(top.raw(name), robot)
                changes |= found
                sources += texts
        if "name" in top:
            changes["name"] = top.text("name")
        if "frames" in top:
            changes["default_frames"] = top.text("frames", FRAMES)
        robot = replace(robot, **changes, source="; ".join(top.sources("") + sources))
        if collision and "urdf" in top:
            tip = top.text("tip") if "tip" in top else None
            robot = with_collision_geometry(robot, path.parent / top.text("urdf"), tip=tip)
        return robot


def _kinematics(top: Table, path: Path) -> RobotModel:
    kinds = [key for key in ("urdf", "dh", "joint") if key in top]
    if len(kinds) != 1:
        raise RobotError(
            "the kinematics come from exactly one of urdf, [dh] and [[joint]]",
            value=" and ".join(kinds) or "none",
        )
    misplaced = ("base", "flange", "urdf_frames") if kinds == ["urdf"] else ("tip", "locked")
    for key in misplaced:
        if key in top:
            raise RobotError(f"'{key}' does not go with {kinds[0]}")
    if kinds == ["urdf"]:
        robot = _from_urdf(top, path)
    else:
        robot = _from_dh(top, path) if kinds == ["dh"] else _from_joints(top, path)
    if "joint_names" in top:
        robot = replace(robot, joint_names=top.texts("joint_names", robot.joints))
    if "urdf_frames" in top:
        table = Table(top.raw("urdf_frames"), "urdf_frames", "", ("xyz", "rpy"))
        xyz, rpy = (table.rows(key, robot.joints, 3) for key in ("xyz", "rpy"))
        placed = [from_xyz_rpy(a, b) for a, b in zip(xyz.tolist(), rpy.tolist(), strict=True)]
        frames = {**robot.parameter_frames, "urdf": np.array(placed)}
        sources = [robot.source, *table.sources("urdf_frames")]
        robot = replace(robot, parameter_frames=frames, source="; ".join(filter(None, sources)))
    return robot


def _from_urdf(top: Table, path: Path) -> RobotModel:
    file = path.parent / top.text("urdf")
    if not is_there(file):
        raise RobotError(
            "no such URDF file; the path starts where the robot file is",
            where="urdf",
            value=top.text("urdf"),
            next_step=f"Looked in {shown_path(path.parent.absolute())}",
        )
    tip = top.text("tip") if "tip" in top else None
    locked = locked_joints(top.raw("locked")) if "locked" in top else None
    return load_urdf(file, tip=tip, locked=locked)


def _from_dh(top: Table, path: Path) -> RobotModel:
    keys = ("convention", "a", "d", "alpha", "theta", "joint_types", "sign")
    table = Table(top.raw("dh"), "dh", "", keys)
    a = table.numbers("a")
    n = len(a)
    robot = robot_from_dh(
        a=a,
        d=table.numbers("d", n),
        alpha=table.numbers("alpha", n),
        theta=table.numbers("theta", n) if "theta" in table else None,
        convention=table.text("convention", CONVENTIONS),
        joint_types=table.texts("joint_types", n) if "joint_types" in table else None,
        sign=table.numbers("sign", n) if "sign" in table else None,
        base=_pose(top, "base"),
        flange=_pose(top, "flange"),
        name=path.stem,
    )
    return replace(robot, source="; ".join(table.sources("dh")))


def _from_joints(top: Table, path: Path) -> RobotModel:
    rows = tables(top.raw("joint"), "joint", "", ("name", "type", "xyz", "rpy", "axis"))
    if not 0 < len(rows) <= MAX_JOINTS:
        raise RobotError("number of [[joint]] rows", value=len(rows), limit=MAX_JOINTS)
    placements = np.array([_row_pose(row) for row in rows])
    base = _pose(top, "base")
    if base is not None:
        placements[0] = base @ placements[0]
    robot = robot_from_chain(
        placements=placements,
        axes=np.array([_axis(row) for row in rows]),
        joint_names=[row.text("name") for row in rows],
        joint_types=[row.text("type", _TYPES) if "type" in row else _TYPES[0] for row in rows],
        flange=_pose(top, "flange"),
        name=path.stem,
    )
    sources = [text for row in rows for text in row.sources("joint")]
    return replace(robot, source="; ".join(sources))


def _pose(top: Table, key: str) -> Array | None:
    if key not in top:
        return None
    return _row_pose(Table(top.raw(key), key, "", ("xyz", "rpy")))


def _row_pose(row: Table) -> Array:
    zero = np.zeros(3)
    xyz = row.numbers("xyz", 3) if "xyz" in row else zero
    rpy = row.numbers("rpy", 3) if "rpy" in row else zero
    return from_xyz_rpy(xyz.tolist(), rpy.tolist())


def _axis(row: Table) -> Array:
    if "axis" not in row:
        return np.array([0.0, 0.0, 1.0])
    axis = row.numbers("axis", 3)
    length = float(np.linalg.norm(axis))
    if not length > 1e-6:
        raise RobotError("the axis has no length", where=row.where, value=axis.tolist())
    return axis / length
