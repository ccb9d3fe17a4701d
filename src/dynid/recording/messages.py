"""Messages out of bytes, by the definitions that bags carry or those of ROS itself.

The decoder is that of rosbags. It compiles definitions to Python code; its grammar admits nothing
but identifiers and literals into that code.
"""

from __future__ import annotations

import functools
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dynid.core import require
from dynid.recording.bagfiles import Topic

_LONGEST_DEFINITION = 1 << 18
_MOST_KEPT = 200
"""Longer arrays are images and the like: they are passed over."""
_MAX_DEPTH = 16
_BASIC = (
    "std_msgs/msg/Header",
    "builtin_interfaces/msg/Time",
    "builtin_interfaces/msg/Duration",
)
"""Types that definitions use without giving them."""
_INNER = re.compile(r"(.*)\.values\[(\d+)\]")
_JOINT_LISTS = ("joint_names", "name", "names", "joint_name")


class MessageError(ValueError):
    """Bytes that do not fit their definition; the message is left out and counted."""


@dataclass(slots=True)
class Decoded:
    """The numbers and texts of one message."""

    stamp_ns: int = 0
    """Stamp of its header; 0 where it has none."""
    names: list[str] = field(default_factory=list[str])
    """Paths of its numbers: `q[0]`, `feedback.positions[3]`."""
    values: list[float] = field(default_factory=list[float])
    texts: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    """Path to a list of strings, which may be joint names."""


class MessageDecoder:
    """Decodes the messages of one topic.

    Args:
        topic: The topic; without a definition its type must be one of ROS itself.

    Raises:
        MessageError: A type that is not known, or a definition that makes no sense.
        MissingExtraError: Without the `ros` extra.
    """

    def __init__(self, topic: Topic) -> None:
        self._ros1 = topic.encoding == "ros1"
        parts = topic.kind.split("/")
        self._kind = f"{parts[0]}/msg/{parts[-1]}"
        self._store = _store(self._ros1)
        # A decoder that an error has stopped half-way says so by many kinds of exception.
        try:
            if topic.definition:
                self._store = _own_store(topic, self._kind, self._ros1)
            self._store.get_msgdef(self._kind)
        except Exception as error:
            raise MessageError(f"no definition of {topic.kind}") from error

    def message(self, data: bytes) -> Any:
        """The message as an object of its fields.

        Args:
            data: Its bytes; with the encapsulation header where they are CDR.

        Raises:
            MessageError: Bytes that do not fit the definition.
        """
        decode = self._store.deserialize_ros1 if self._ros1 else self._store.deserialize_cdr
        try:
            return decode(data, self._kind)
        except (
            *(ValueError, struct.error, IndexError, AssertionError, OverflowError, TypeError),
            *(MemoryError, RecursionError, require("rosbags.serde", "ros").SerdeError),
        ) as error:
            raise MessageError("damaged") from error

    def decode(self, data: bytes) -> Decoded:
        """All numbers of a message by their paths; see `message`."""
        found = Decoded()
        message = self.message(data)
        if header := getattr(message, "header", None):
            found.stamp_ns = stamp_of(header)
        _flatten(message, "", found, 0)
        return found


def stamp_of(header: Any) -> int:
    """The stamp of a header [ns].

    Raises:
        MessageError: No header, or a stamp that cannot be.
    """
    stamp = getattr(header, "stamp", None)
    if stamp is None:
        return 0
    if not 0 <= stamp.nanosec < 1_000_000_000:
        raise MessageError("impossible stamp")
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


@functools.cache
def _store(ros1: bool) -> Any:
    """The types of ROS itself."""
    typesys = require("rosbags.typesys", "ros")
    stores = typesys.Stores
    return typesys.get_typestore(stores.ROS1_NOETIC if ros1 else stores.ROS2_HUMBLE)


def _own_store(topic: Topic, kind: str, ros1: bool) -> Any:
    """The types that a topic's definition gives, and those of ROS that it leaves out."""
    if len(topic.definition) > _LONGEST_DEFINITION:
        raise MessageError("the definition is too long")
    typesys = require("rosbags.typesys", "ros")
    if topic.language == "ros2idl":
        types = dict(typesys.get_types_from_idl(topic.definition))
    else:
        # Its separators have 80 signs, whatever a writer made of them.
        text = re.sub(r"^=+[ \t\r]*$", "=" * 80, topic.definition, flags=re.MULTILINE)
        types = dict(typesys.get_types_from_msg(text.replace("\r\n", "\n"), kind))
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    known = _store(ros1).fielddefs
    basic = (
        "std_msgs/msg/Header",
        "builtin_interfaces/msg/Time",
        "builtin_interfaces/msg/Duration",
    )
    store.register({**{name: known[name] for name in basic if name in known}, **types})
    return store


def _flatten(message: Any, path: str, into: Decoded, depth: int) -> None:
    if depth > _MAX_DEPTH:
        raise MessageError("too deep")
    for name in message.__dataclass_fields__:
        value = getattr(message, name)
        inner = f"{path}.{name}" if path else name
        if name == "__msgtype__" or hasattr(value, "frame_id"):
            # What a header holds beside the stamp is nobody's quantity.
            continue
        if isinstance(value, np.ndarray):
            numbers = cast("NDArray[Any]", value)
            # Bytes are images and flags.
            if numbers.size <= _MOST_KEPT and numbers.dtype.kind in "fiu" and numbers.itemsize > 1:
                into.names += [f"{inner}[{k}]" for k in range(numbers.size)]
                into.values += numbers.tolist()
        elif isinstance(value, list):
            items = cast("list[Any]", value)
            if all(isinstance(item, str) for item in items):
                into.texts[inner] = items
                continue
            for k, item in enumerate(items[:_MOST_KEPT]):
                _flatten(item, f"{inner}[{k}]", into, depth + 1)
        elif isinstance(value, str):
            into.texts[inner] = [value]
        elif isinstance(value, (float, int)):
            if not isinstance(value, bool):
                into.names.append(inner)
                into.values.append(float(value))
        else:
            _flatten(value, inner, into, depth + 1)


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
