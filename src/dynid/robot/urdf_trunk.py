"""Which joints of a URDF tree are the arm.

From the root the arm follows the one way on which something moves. Where several ways move
(a hand), the arm ends and what lies beyond is frozen at zero; ways that only mimic (a parallel
linkage) do not end it if two or more joints follow on the main way. Joints at the end whose
name says that they belong to a gripper are frozen too. A named tip overrides all this.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from dynid.core.errors import RobotError
from dynid.robot.files import shown
from dynid.robot.urdf_tree import MOVING, UrdfJoint, UrdfTree

_GRIPPER = re.compile(r"gripper|finger|jaw|knuckle|claw", re.IGNORECASE)
_WRIST = re.compile(r"roll|pitch|yaw|rot|wrist|twist", re.IGNORECASE)
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


def find_trunk(
    tree: UrdfTree, where: str, *, tip: str | None = None, locked: Mapping[str, float] | None = None
) -> Trunk:
    """Choose the arm.

    Args:
        tree: The tree.
        where: The file's name, for errors.
        tip: The link to which the chain leads; None to find it.
        locked: Joints to freeze, and where [rad or m].

    Raises:
        RobotError: Unknown tip or joint, or no joint left to move; the message lists tips.
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
    path = survey.path_to(tip, where) if tip is not None else survey.main_path(notes)
    chosen = [j for j in path if survey.independent(j)]
    if tip is None:
        _drop_gripper(chosen, notes)
    if not chosen:
        raise RobotError(
            "no chain of moving joints leads from the base" + (" to the tip" if tip else ""),
            where=where,
            value=tip,
            limit=survey.tips(),
            next_step='Name the tip link of the arm: tip = "..." in a robot file',
        )
    end = tip if tip is not None else survey.flange(chosen[-1].child)
    return Trunk(
        joints=tuple(j.name for j in chosen),
        tip=end,
        locked=_frozen(tree, {j.name for j in chosen}, frozen, path, notes),
        notes=tuple(notes),
    )


def _frozen(
    tree: UrdfTree,
    chosen: set[str],
    asked: dict[str, float],
    path: list[UrdfJoint],
    notes: list[str],
) -> dict[str, float]:
    rest = [j for j in tree.joints.values() if j.kind in MOVING and j.name not in chosen]
    values = {j.name: asked.get(j.name, _followed(j, asked)) for j in rest}
    for joint in rest:
        if joint.mimic and joint.name not in asked and joint in path:
            notes.append(
                f"joint {shown(joint.name)} mimics {shown(joint.mimic[0])} within the arm;"
                f" it is frozen at {values[joint.name]:g}, which is only right if it is passive"
            )
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
        for joint in reversed(self._down(tree.root)):
            below = self._below[joint.child]
            self._moving[joint.name] = self._moves(joint) + sum(self._moving[j.name] for j in below)
            self._independent[joint.name] = self.independent(joint) + sum(
                self._independent[j.name] for j in below
            )

    def independent(self, joint: UrdfJoint) -> bool:
        """Whether the joint moves by itself."""
        return self._moves(joint) and joint.mimic is None

    def main_path(self, notes: list[str], start: str | None = None) -> list[UrdfJoint]:
        """The way from a link (the root) along which the arm goes."""
        path: list[UrdfJoint] = []
        link = self._tree.root if start is None else start
        while ways := [j for j in self._below[link] if self._moving[j.name]]:
            mains = [j for j in ways if self._independent[j.name]]
            if len(ways) > 1:
                if len(mains) != 1 or self._independent[mains[0].name] < 2:
                    more = any(self._independent[j.name] > 3 for j in ways)
                    step = f"; to go on, name a tip: {self.tips()}" if more and not start else ""
                    notes.append(f"the chain ends where it branches, at link {shown(link)}{step}")
                    break
                notes.append(f"mimicking branches at link {shown(link)} are not followed")
            if not mains:
                break
            path.append(mains[0])
            link = mains[0].child
        return path

    def path_to(self, tip: str, where: str) -> list[UrdfJoint]:
        """The way from the root to a link."""
        if tip not in self._tree.links:
            near = difflib.get_close_matches(tip, self._tree.links, n=3)
            step = f"Did you mean {' or '.join(shown(n) for n in near)}?" if near else None
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
            path = self.main_path([], start)
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
        return _listed(ordered, 8) or "nothing moves in this file"

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

    def _down(self, root: str) -> list[UrdfJoint]:
        """All joints, parents before children."""
        order: list[UrdfJoint] = []
        waiting = [root]
        while waiting:
            below = self._below[waiting.pop()]
            order += below
            waiting += [j.child for j in below]
        return order


def _listed(names: list[str], most: int = 12) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(shown(name, 60) for name in names[:most]) + more
