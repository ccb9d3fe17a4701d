"""Robots from URDF files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import RobotError
from dynid.robot.chain import robot_from_chain
from dynid.robot.files import located, read_limited, shown, shown_path
from dynid.robot.inertia import is_physical, move
from dynid.robot.limits import JointLimits
from dynid.robot.model import RobotModel
from dynid.robot.transforms import joint_motion
from dynid.robot.urdf_tree import UrdfJoint, UrdfTree
from dynid.robot.urdf_trunk import Trunk, find_trunk
from dynid.robot.urdf_xml import parse_urdf

MAX_BYTES = 20_000_000
"""The largest URDF file that is read."""


def load_urdf(
    path: str | Path, *, tip: str | None = None, locked: Mapping[str, float] | None = None
) -> RobotModel:
    """A robot from a URDF file, standing on the floor with its root link as the base.

    Fixed and frozen joints are merged into the links. Meshes, Gazebo and transmission tags are
    not looked at. Links without an `inertial` leave their inertia unknown only if nothing
    else in the same moving body has one.

    Args:
        path: The file.
        tip: The link to which the arm leads; None to follow the trunk of the tree.
        locked: Joints to freeze, and where [rad or m].

    Raises:
        RobotError: The file cannot be read, is not a sound URDF, or has no arm in it.
    """
    file = Path(path)
    return robot_from_urdf(
        read_limited(file, MAX_BYTES),
        where=shown_path(file),
        stem=file.stem,
        tip=tip,
        locked=locked,
    )


def robot_from_urdf(
    data: bytes,
    *,
    where: str = "URDF",
    stem: str = "robot",
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
) -> RobotModel:
    """A robot from URDF text; see `load_urdf`.

    Args:
        data: The text's bytes.
        where: The file's name, for errors.
        stem: The robot's name if the text gives none.
        tip: The link to which the arm leads.
        locked: Joints to freeze, and where [rad or m].

    Raises:
        RobotError: The text is not a sound URDF, or has no arm in it.
    """
    tree = parse_urdf(data, where)
    trunk = find_trunk(tree, where, tip=tip, locked=locked)
    if any(tree.joints[name].kind in ("floating", "planar") for name in _between(tree, trunk)):
        raise RobotError("a floating or planar joint within the arm", where=where)
    poses, carriers = place_links(tree, trunk)
    joints = [tree.joints[name] for name in trunk.joints]
    notes = [*tree.notes, *trunk.notes]
    inertias = _merge(tree, trunk, poses, carriers, notes)
    placements = np.array([poses[joint.parent] @ joint.origin for joint in joints])
    with located(where):
        robot = robot_from_chain(
            name=tree.name or shown(stem),
            joint_names=trunk.joints,
            joint_types=["prismatic" if j.kind == "prismatic" else "revolute" for j in joints],
            placements=placements,
            axes=np.array([joint.axis for joint in joints]),
            flange=poses[trunk.tip],
            notes=tuple(notes),
        )
        lower, upper, velocity, effort = np.array([joint.limits for joint in joints]).T
        unknown = np.full(len(joints), np.nan)
        limits = JointLimits(
            lower=lower, upper=upper, velocity=velocity, acceleration=unknown, torque=effort
        )
        return replace(
            robot, limits=limits, inertias=inertias, locked=trunk.locked, source=f"URDF {where}"
        )


def _between(tree: UrdfTree, trunk: Trunk) -> list[str]:
    """The joints between the first and the last joint of the arm."""
    above = {joint.child: joint for joint in tree.joints.values()}
    names: list[str] = []
    joint = tree.joints[trunk.joints[-1]]
    while joint.name != trunk.joints[0]:
        joint = above[joint.parent]
        names.append(joint.name)
    return names


def place_links(tree: UrdfTree, trunk: Trunk) -> tuple[dict[str, Array], dict[str, int]]:
    """Every link's pose in the joint frame that carries it, and that joint (0 the base)."""
    below: dict[str, list[UrdfJoint]] = {}
    for joint in tree.joints.values():
        below.setdefault(joint.parent, []).append(joint)
    number = {name: k + 1 for k, name in enumerate(trunk.joints)}
    poses, carriers = {tree.root: np.eye(4)}, {tree.root: 0}
    waiting = [tree.root]
    while waiting:
        link = waiting.pop()
        for joint in below.get(link, []):
            if joint.name in number:
                poses[joint.child], carriers[joint.child] = np.eye(4), number[joint.name]
            else:
                held = trunk.locked.get(joint.name, 0.0)
                move_by = joint_motion(joint.axis, joint.kind == "prismatic", held)
                poses[joint.child] = poses[link] @ joint.origin @ move_by
                carriers[joint.child] = carriers[link]
            waiting.append(joint.child)
    return poses, carriers


def _merge(
    tree: UrdfTree,
    trunk: Trunk,
    poses: dict[str, Array],
    carriers: dict[str, int],
    notes: list[str],
) -> Array:
    inertias = np.full((len(trunk.joints), 10), np.nan)
    for link, own in tree.links.items():
        body = carriers[link] - 1
        if own is not None and body >= 0:
            inertias[body] = np.nan_to_num(inertias[body]) + move(own, poses[link])
    for name, row in zip(trunk.joints, inertias, strict=True):
        if np.isnan(row).any():
            notes.append(f"no inertia is given for what joint {shown(name)} moves")
        elif not is_physical(row):
            notes.append(f"the inertia of what joint {shown(name)} moves is not physical")
    return inertias
