"""What the fields of a message are called, and the joint names that it carries."""

from __future__ import annotations

import re
from collections.abc import Sequence

from dynid.recording.bag.generic import Decoded

_INNER = re.compile(r"(.*)\.values\[(\d+)\]")
_JOINT_LISTS = ("joint_names", "name", "names", "joint_name")


def field_names(message: Decoded) -> list[str]:
    """Paths of the numbers; interfaces that a message names itself go by those names.

    Args:
        message: A message of `control_msgs/DynamicJointState`, or any other.
    """
    names: list[str] = []
    listed = [message.texts[key] for key in _JOINT_LISTS if key in message.texts]
    outer = listed[0] if listed else []
    for name in message.names:
        match = _INNER.fullmatch(name)
        own = message.texts.get(f"{match.group(1)}.interface_names", []) if match else []
        if match and (index := re.search(r"\[(\d+)\]$", match.group(1))):
            joint, item = int(index.group(1)), int(match.group(2))
            if joint < len(outer) and item < len(own):
                names.append(f"{outer[joint]}/{own[item]}")
                continue
        names.append(name)
    return names


def joints_beside(
    message: Decoded, names: Sequence[str], columns: Sequence[int]
) -> tuple[str, ...]:
    """The joints' names that stand beside the positions in a message, if any.

    Args:
        message: The message.
        names: Its fields.
        columns: Those of the positions.
    """
    scope = names[columns[0]].rpartition(".")[0]
    for prefix in (f"{scope}." if scope else "", ""):
        for key in _JOINT_LISTS:
            listed = message.texts.get(prefix + key, [])
            if len(listed) == len(columns) == len(set(listed)):
                return tuple(listed)
    return ()
