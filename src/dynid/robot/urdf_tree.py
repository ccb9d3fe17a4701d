"""A URDF as checked values: links, joints, and that they form one tree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from dynid.core.arrays import Array
from dynid.core.errors import RobotError
from dynid.robot.files import shown

MOVING = ("revolute", "continuous", "prismatic")
FIXED = ("fixed", "floating", "planar")


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfJoint:
    """One joint as the file has it."""

    name: str
    kind: str
    """One of `MOVING` or `FIXED`."""
    parent: str
    child: str
    origin: Array
    """(4, 4) in the parent link's frame [m]."""
    axis: Array
    """(3) unit axis in the joint frame."""
    limits: tuple[float, float, float, float]
    """Lower, upper [rad or m], velocity, effort; NaN where unknown."""
    mimic: tuple[str, float, float] | None = None
    """The joint it follows, multiplier and offset: q = multiplier * q_other + offset."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfTree:
    """A robot as the file has it."""

    name: str
    root: str
    links: dict[str, Array | None]
    """Link to its ten parameters in the link frame, None where the file gives none."""
    joints: dict[str, UrdfJoint]
    notes: tuple[str, ...]


def check_tree(links: dict[str, Array | None], joints: dict[str, UrdfJoint], where: str) -> str:
    """The root of the tree that links and joints form.

    Raises:
        RobotError: They form none: two parents, several roots, or a loop.
    """
    above: dict[str, str] = {}
    for joint in joints.values():
        if joint.child in above:
            raise RobotError("a link has two parent joints", where=where, value=joint.child)
        above[joint.child] = joint.parent
    roots = [name for name in links if name not in above]
    if len(roots) != 1:
        raise RobotError(
            "the links do not form one tree: there must be one link without a parent joint",
            where=where,
            value=[shown(name, 40) for name in roots[:6]] or "none (a loop)",
        )
    # One root and one parent each: whatever is not reached from the root is a loop.
    reached = set(_reached(roots[0], joints))
    if len(reached) != len(links):
        lost = next(name for name in links if name not in reached)
        raise RobotError("joints form a loop", where=where, value=lost)
    return roots[0]


def _reached(root: str, joints: dict[str, UrdfJoint]) -> Iterator[str]:
    below: dict[str, list[str]] = {}
    for joint in joints.values():
        below.setdefault(joint.parent, []).append(joint.child)
    waiting = [root]
    while waiting:
        link = waiting.pop()
        yield link
        waiting += below.get(link, [])
