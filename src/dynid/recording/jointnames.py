"""The robot's joints among the names that a recording has."""

from __future__ import annotations

import re
from collections.abc import Sequence


def places_of(wanted: Sequence[str], names: Sequence[str]) -> list[int]:
    """Where each wanted joint stands among names that may all have one more prefix.

    `panda_joint1` to `panda_joint7` are `joint1` to `joint7`, whatever `panda_finger_joint1`
    is; of `left_joint1` and `right_joint1` nobody can tell.

    Args:
        wanted: The robot's joint names.
        names: The recording's joint names.

    Returns:
        Index of each wanted joint; empty where they are not all there, or there twice.
    """
    joints, there = [plainly(joint) for joint in wanted], [plainly(name) for name in names]
    if not joints or len(set(there)) != len(there):
        return []
    prefixes = [
        {name[: len(name) - len(joint)] for name in there if name.endswith(joint)}
        for joint in joints
    ]
    common = [
        prefix for prefix in sorted(prefixes[0]) if all(prefix in other for other in prefixes)
    ]
    if len(common) != 1 and "" not in common:
        return []
    prefix = common[0]
    return [there.index(prefix + joint) for joint in joints]


def plainly(name: str) -> str:
    """A joint's name in lower case, its words joined by underscores."""
    return re.sub(r"[^a-z0-9]+", "_", name.strip().lower()).strip("_")
