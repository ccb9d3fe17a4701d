"""Robots from URDF files: which joints are the arm, and the chain that they form."""

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path

import numpy as np

from dynid.core import Array, RobotError, printable
from dynid.robot import kinematics, model, tables
from dynid.robot.transforms import is_physical, joint_motion, move, to_pseudo_inertia
from dynid.robot.urdf_xml import MOVING, UrdfJoint, UrdfTree, parse_urdf

_GRIPPER = re.compile(r"gripper|finger|jaw|knuckle|claw", re.IGNORECASE)
_WRIST = re.compile(r"roll|pitch|yaw|rot|wrist|twist", re.IGNORECASE)
_NAME_TIP = (
    'Name the tip link of the arm in a robot file, two lines: urdf = "FILE.urdf" and tip = "LINK"'
)
# The usual names of the place where tools are mounted, best first.
_FLANGES = ("tool0", "flange", "ee_link", "end_effector_link", "tcp", "tool_link", "ee")


@dataclass(frozen=True, slots=True, kw_only=True)
class Trunk:
    """The arm within the tree."""

    joints: tuple[str, ...]
    """Moving joints, base to tip."""
    tip: str
    """The link at which the chain ends."""
    locked: dict[str, float]
    """Every other moving joint, and where it is frozen [rad or m]."""
    notes: tuple[str, ...]
    following: Mapping[str, str]
    """Those of them that move with a joint of the arm, and with which."""


def find_trunk(
    tree: UrdfTree, where: str, *, tip: str | None, locked: Mapping[str, float] | None
) -> Trunk:
    """Choose the arm.

    Args:
        tree: The tree.
        where: The file's name, for errors.
        tip: The link to which the chain leads; None to find it.
        locked: Joints to freeze, and where [rad or m].

    Raises:
        RobotError: Unknown tip or joint, no joint left to move (the message lists tips), or a
            floating, planar or mimicking joint within the arm.
    """
    frozen = dict(locked or {})
    for name, value in frozen.items():
        if not math.isfinite(value):
            raise RobotError("a joint is locked at a finite position", where=name, value=value)
        joint = tree.joints.get(name)
        if joint is None or joint.kind not in MOVING:
            moving = [j.name for j in tree.joints.values() if j.kind in MOVING]
            what = "no such joint to lock" if joint is None else "a locked joint does not move"
            raise RobotError(what, where=where, value=name, limit=_listed(moving))
    survey = _Survey(tree, frozen)
    notes: list[str] = []
    path = survey.path_to(tip, where) if tip is not None else survey.main_path(notes, where)
    chosen = [j for j in path if survey.independent(j)]
    if tip is None:
        _drop_gripper(chosen, notes)
    if not chosen:
        tips = survey.tips()
        what = "no chain of moving joints leads from the base" + (" to the tip" if tip else "")
        raise RobotError(
            what if tip or not tips else "several chains of moving joints leave the base",
            where=where,
            value=tip,
            limit=tips or "nothing moves in this file",
            next_step=_NAME_TIP,
        )
    within = path[path.index(chosen[0]) : path.index(chosen[-1])]
    if any(j.kind in ("floating", "planar") for j in within):
        raise RobotError("a floating or planar joint within the arm", where=where)
    names = {j.name for j in chosen}
    for joint in within:
        if joint.mimic and joint.mimic[0] in names and joint.name not in frozen:
            raise RobotError(
                "a joint within the arm moves with another, so that torques and collisions of what "
                "it carries would be wrong",
                where=where,
                value=f"{printable(joint.name)} mimics {printable(joint.mimic[0])}",
                next_step="To take it as fixed all the same, lock it in a robot file: "
                f"[locked] {printable(joint.name)} = 0.0",
            )
    end = tip if tip is not None else survey.flange(chosen[-1].child)
    return Trunk(
        joints=tuple(j.name for j in chosen),
        tip=end,
        locked=_frozen(tree, names, frozen, notes),
        notes=tuple(notes),
        following={
            j.name: j.mimic[0]
            for j in tree.joints.values()
            if j.kind in MOVING and j.mimic and j.mimic[0] in names and j.name not in frozen
        },
    )


def _frozen(
    tree: UrdfTree,
    chosen: set[str],
    asked: dict[str, float],
    notes: list[str],
) -> dict[str, float]:
    rest = [j for j in tree.joints.values() if j.kind in MOVING and j.name not in chosen]
    values = {j.name: asked.get(j.name, _followed(j, asked)) for j in rest}
    if rest:
        notes.append(f"joints frozen: {_listed([f'{k} at {v:g}' for k, v in values.items()])}")
    free = [j.name for j in tree.joints.values() if j.kind in ("floating", "planar")]
    if free:
        notes.append(f"floating or planar joints taken as fixed: {_listed(free)}")
    return values


def _followed(joint: UrdfJoint, asked: dict[str, float]) -> float:
    if joint.mimic is None:
        return 0.0
    other, multiplier, offset = joint.mimic
    return multiplier * asked.get(other, 0.0) + offset


def _drop_gripper(chosen: list[UrdfJoint], notes: list[str]) -> None:
    kept = len(chosen)
    while (
        kept and _GRIPPER.search(chosen[kept - 1].name) and not _WRIST.search(chosen[kept - 1].name)
    ):
        kept -= 1
    if 0 < kept < len(chosen):
        names = [j.name for j in chosen[kept:]]
        notes.append(f"taken as a gripper by name, not as part of the arm: {_listed(names)}")
        del chosen[kept:]


class _Survey:
    """The tree with, for every joint, how much moves from there on."""

    def __init__(self, tree: UrdfTree, frozen: dict[str, float]) -> None:
        self._tree = tree
        self._frozen = frozen
        self._below: dict[str, list[UrdfJoint]] = {name: [] for name in tree.links}
        self._above: dict[str, UrdfJoint] = {}
        for joint in tree.joints.values():
            self._below[joint.parent].append(joint)
            self._above[joint.child] = joint
        self._moving: dict[str, int] = {}
        self._independent: dict[str, int] = {}
        for joint in reversed(tree.downward()):
            below = self._below[joint.child]
            self._moving[joint.name] = self._moves(joint) + sum(self._moving[j.name] for j in below)
            self._independent[joint.name] = self.independent(joint) + sum(
                self._independent[j.name] for j in below
            )

    def independent(self, joint: UrdfJoint) -> bool:
        """Whether the joint moves by itself."""
        return self._moves(joint) and joint.mimic is None

    def main_path(self, notes: list[str], where: str, start: str | None = None) -> list[UrdfJoint]:
        """The way from a link (the root) along which the arm goes.

        Raises:
            RobotError: Beyond a branch more joints move than before it: wheels or a torso, no arm.
        """
        path: list[UrdfJoint] = []
        link = self._tree.root if start is None else start
        while ways := [j for j in self._below[link] if self._moving[j.name]]:
            mains = [j for j in ways if self._independent[j.name]]
            if len(ways) > 1:
                if len(mains) != 1 or self._independent[mains[0].name] < 2:
                    before = sum(self.independent(j) for j in path)
                    beyond = max(self._independent[j.name] for j in ways)
                    if start is None and 0 < before < beyond:
                        raise RobotError(
                            f"which chain is the arm? At link {printable(link)} the chain branches:"
                            f" {before} moving joints lead there, {beyond} go on",
                            where=where,
                            limit=self.tips(),
                            next_step=_NAME_TIP,
                        )
                    more = any(self._independent[j.name] > 3 for j in ways)
                    step = f"; to go on, name a tip: {self.tips()}" if more and not start else ""
                    notes.append(
                        f"the chain ends where it branches, at link {printable(link)}{step}"
                    )
                    break
                notes.append(f"mimicking branches at link {printable(link)} are not followed")
            if not mains:
                break
            path.append(mains[0])
            link = mains[0].child
        return path

    def path_to(self, tip: str, where: str) -> list[UrdfJoint]:
        """The way from the root to a link."""
        if tip not in self._tree.links:
            near = difflib.get_close_matches(tip, self._tree.links, n=3)
            step = f"Did you mean {' or '.join(printable(n) for n in near)}?" if near else None
            raise RobotError(
                "no such tip link", where=where, value=tip, limit=self.tips(), next_step=step
            )
        path: list[UrdfJoint] = []
        while tip in self._above:
            path.append(self._above[tip])
            tip = self._above[tip].parent
        return path[::-1]

    def tips(self) -> str:
        """Where arms may end, longest first."""
        ends: dict[str, int] = {}
        waiting = [self._tree.root]
        while waiting:
            start = waiting.pop()
            path = self.main_path([], "", start)
            chosen = [j for j in path if self.independent(j)]
            if chosen:
                ends.setdefault(self.flange(chosen[-1].child), len(chosen))
            link = path[-1].child if path else start
            for joint in self._below[link]:
                if self._independent[joint.name] > self.independent(joint):
                    waiting.append(joint.child)
                elif self.independent(joint):
                    ends.setdefault(self.flange(joint.child), 1)
        ordered = sorted(ends, key=lambda name: -ends[name])
        return _listed(ordered, 8)

    def flange(self, link: str) -> str:
        """The link fixed to `link` where tools are mounted, or its only neighbour, or itself."""
        fixed: list[str] = []
        waiting = [link]
        while waiting:
            current = waiting.pop()
            rigid = [j for j in self._below[current] if not self._moves(j)]
            waiting += [j.child for j in rigid]
            fixed += [j.child for j in rigid]
        for ending in _FLANGES:
            for name in fixed:
                if name.lower().endswith(ending):
                    return name
        direct = [j.child for j in self._below[link] if not self._moves(j)]
        return direct[0] if len(direct) == 1 else link

    def _moves(self, joint: UrdfJoint) -> bool:
        return joint.kind in MOVING and joint.name not in self._frozen


def _listed(names: list[str], most: int = 12) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(printable(name, 60) for name in names[:most]) + more


REPEATED = 3
"""Links with the same tensor from which it is a placeholder: that of a ball, or of a body centred
on its joint."""
MAX_BYTES = 20_000_000
"""The largest URDF file that is read."""


def robot_from_urdf(
    data: bytes,
    *,
    where: str = "URDF",
    file: Path | None = None,
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
) -> model.RobotModel:
    """A robot from URDF text, standing on the floor with its root link as the base.

    Fixed and frozen joints are merged into the links. Meshes, Gazebo and transmission tags are
    not looked at. Links without an `inertial` leave their inertia unknown only if nothing
    else in the same moving body has one; placeholders (see `REPEATED`) are unknown as well.

    Args:
        data: The text's bytes.
        where: The file's name, for errors.
        file: The text's file, which names the robot if the text does not.
        tip: The link to which the arm leads; None to follow the trunk of the tree.
        locked: Joints to freeze, and where [rad or m].

    Raises:
        RobotError: The text is not a sound URDF, or has no arm in it.
    """
    tree = parse_urdf(data, where)
    trunk = find_trunk(tree, where, tip=tip, locked=locked)
    poses, carriers = place_links(tree, trunk.joints, trunk.locked)
    joints = [tree.joints[name] for name in trunk.joints]
    notes = [*tree.notes, *trunk.notes]
    inertias = _merge(tree, trunk, poses, carriers, notes)
    wrong: list[str] = []
    if trunk.following:
        told = _listed([f"{name} with {leader}" for name, leader in trunk.following.items()])
        wrong.append(
            "frozen although they move with a joint of the arm, so that torques and collisions of "
            f"what they carry would be wrong: {told} ([locked] in a robot file takes them as fixed)"
        )
    placements = np.array([poses[joint.parent] @ joint.origin for joint in joints])
    with tables.located(where):
        robot = kinematics.robot_from_chain(
            name=tree.name or printable(file.stem if file else "robot"),
            joint_names=trunk.joints,
            joint_types=["prismatic" if j.kind == "prismatic" else "revolute" for j in joints],
            placements=placements,
            axes=np.array([joint.axis for joint in joints]),
            flange=poses[trunk.tip],
            notes=(*notes, *wrong),
        )
        lower, upper, velocity, effort = np.array([joint.limits for joint in joints]).T
        unknown = np.full(len(joints), np.nan)
        limits = model.JointLimits(
            lower=lower, upper=upper, velocity=velocity, acceleration=unknown, torque=effort
        )
        return replace(
            robot,
            limits=limits,
            inertias=inertias,
            body_notes=tuple(wrong),
            locked=trunk.locked,
            source=f"URDF {where}",
            urdf=str(file.absolute()) if file else "",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfLink:
    """One link of a URDF, and what moves it."""

    name: str
    joint: int
    """0 for the base, i for what joint i of the robot moves."""
    frame: Array
    """(4, 4) the link's frame in that joint's frame [m]."""
    hinged: bool
    """Whether a joint that the robot has frozen lies between the two, as for a finger."""
    inertia: Array | None
    """(10) parameters about the link's own frame; None where the file gives none."""


def urdf_links(robot: model.RobotModel, file: Path) -> list[UrdfLink]:
    """All links of a robot's URDF, parents before children.

    Raises:
        RobotError: The file cannot be read, is not a sound URDF, or is of an arm with other joints
            or lengths.
    """
    where = tables.shown_path(file)
    tree = parse_urdf(tables.read_limited(file, MAX_BYTES), where)
    lost = [name for name in robot.joint_names if name not in tree.joints]
    if lost:
        raise RobotError(
            "the file has not all joints of the robot",
            where=where,
            value=_listed(lost),
            limit=_listed(list(tree.joints)),
            next_step="Give the URDF of the robot that was identified.",
        )
    poses, carriers = place_links(tree, robot.joint_names, robot.locked)
    hinged = {tree.root: False}
    for joint in tree.downward():
        loose = joint.kind != "fixed" or hinged[joint.parent]
        hinged[joint.child] = loose and joint.name not in robot.joint_names
    for k, name in enumerate(robot.joint_names):
        joint = tree.joints[name]
        same = (
            carriers[joint.parent] == k
            and np.allclose(poses[joint.parent] @ joint.origin, robot.placements[k], atol=1e-9)
            and np.allclose(joint.axis, robot.axes[k], atol=1e-9)
        )
        if not same:
            raise RobotError(
                "the joint stands elsewhere than that of the robot that was identified",
                where=where,
                value=printable(name),
                next_step="Give the URDF of that robot, or identify again with this one.",
            )
    return [
        UrdfLink(
            name=name,
            joint=carriers[name],
            frame=poses[name],
            hinged=hinged[name],
            inertia=tree.links[name],
        )
        for name in [tree.root, *(joint.child for joint in tree.downward())]
    ]


def place_links(
    tree: UrdfTree, joints: Sequence[str], locked: Mapping[str, float]
) -> tuple[dict[str, Array], dict[str, int]]:
    """Every link's pose in the frame of the joint that carries it, and that joint (0 the base)."""
    number = {name: k + 1 for k, name in enumerate(joints)}
    poses, carriers = {tree.root: np.eye(4)}, {tree.root: 0}
    for joint in tree.downward():
        if joint.name in number:
            poses[joint.child], carriers[joint.child] = np.eye(4), number[joint.name]
        else:
            held = locked.get(joint.name, 0.0)
            move_by = joint_motion(joint.axis, joint.kind == "prismatic", held)
            poses[joint.child] = poses[joint.parent] @ joint.origin @ move_by
            carriers[joint.child] = carriers[joint.parent]
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
    unknown = [bool(np.isnan(row).any()) for row in inertias]
    wrong = [not (bare or is_physical(row)) for bare, row in zip(unknown, inertias, strict=True)]
    for which, told in (
        (unknown, "the URDF has no inertia of links moved by"),
        (wrong, "an inertia is not physically consistent: links moved by"),
    ):
        if any(which):
            notes.append(f"{told} {_listed(list(compress(trunk.joints, which)))}")
    if np.fmax.reduce(inertias[:, 0]) == 0:
        inertias[:] = np.nan
        notes.append("no link that moves has a mass: all are taken as unknown")
    swung: dict[str, str] = {}
    for joint in tree.downward():
        leader = trunk.following.get(joint.name, swung.get(joint.parent))
        if leader is not None:
            swung[joint.child] = leader
            own = tree.links[joint.child]
            if own is not None and own[0] > 0:
                # Where its mass is when the arm moves is not known.
                inertias[trunk.joints.index(leader)] = np.nan
    links = [tree.links[tree.joints[name].child] for name in trunk.joints]
    # A dummy that the true link is fixed to says nothing about that link.
    main = [
        None if own is None or own[0] < row[0] / 2 else own
        for own, row in zip(links, inertias, strict=True)
    ]
    copied = _copied(main)
    for body, first in copied.items():
        inertias[body, first:] = np.nan
    if copied:
        notes.append(
            f"an inertia that is the same on {REPEATED} links or more is a placeholder, taken as "
            f"unknown: links moved by {_listed([trunk.joints[body] for body in copied])}"
        )
    return inertias


def _copied(links: Sequence[Array | None]) -> dict[int, int]:
    """Links whose inertia is a placeholder, and from which parameter on: the masses may be true."""
    alike: dict[tuple[float, ...], dict[int, float]] = {}
    for k, own in enumerate(links):
        if own is None or own[0] <= 0:
            continue
        centre = own[1:4] / own[0]
        second = to_pseudo_inertia(own)[:3, :3] - own[0] * np.outer(centre, centre)
        size = float(np.trace(second))
        ball = np.allclose(second, np.eye(3) * size / 3, atol=1e-6 * abs(size))
        if ball or not centre.any():
            key = tuple(float(f"{x:.6g}") for x in second[np.tril_indices(3)] + 1e-6 * size)
            alike.setdefault(key, {})[k] = float(own[0])
    copied: dict[int, int] = {}
    for masses in alike.values():
        if len(masses) >= REPEATED:
            every = list(masses.values())
            copied |= {k: 0 if every.count(m) >= REPEATED else 4 for k, m in masses.items()}
    return copied
