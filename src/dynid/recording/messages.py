"""Messages out of bytes, by the definitions that bags carry or those of ROS itself.

The decoder is that of rosbags. It compiles definitions to Python code; its grammar admits nothing
but identifiers and literals into that code.
"""

import functools
import re
import struct
from array import array
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dynid.core import Array, require
from dynid.recording import bagfiles, cells, content

_LONGEST_DEFINITION = 1 << 18
_MOST_KEPT = 200
"""Longer arrays are images and the like: they are passed over."""
_MAX_DEPTH = 16
_JOINT_LISTS = ("joint_names", "name", "names", "joint_name")
_INTERFACES = "interface_names"
_LISTS = frozenset({*_JOINT_LISTS, _INTERFACES})
_BASIC = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")


class MessageError(ValueError):
    """Bytes that do not fit their definition; the message is left out and counted."""


@dataclass(slots=True)
class Decoded:
    """The numbers of one message, and the names of joints among its texts."""

    stamp_ns: int = 0
    """Stamp of its header; 0 where it has none."""
    values: list[float] = field(default_factory=list[float])
    form: list[tuple[str, int | tuple[str, ...]]] = field(
        default_factory=list[tuple[str, int | tuple[str, ...]]]
    )
    """Path and length of its arrays of numbers (`q`, `feedback.positions`), -1 for one number; path
    and words of lists that are called as joint names are."""

    def names(self) -> tuple[str, ...]:
        """The path of each number, by its joint where that is known: `q[elbow_joint]`, `q[0]`."""
        texts = {path: size for path, size in self.form if isinstance(size, tuple)}
        names: list[str] = []
        for path, size in self.form:
            if isinstance(size, tuple):
                continue
            stem, _, last = path.rpartition(".")
            own, outer = texts.get(f"{stem}.{_INTERFACES}", ()), texts.get("joint_names", ())
            place = re.search(r"\[(\d+)\]$", stem)
            if last == "values" and place and int(place[1]) < len(outer) and len(own) == size:
                # `DynamicJointState`: a list of interfaces for each joint.
                names += [_named(item, outer[int(place[1])]) for item in own]
            elif size < 0:
                names.append(path)
            elif listed := _joints_beside(texts, stem, size):
                names += [_named(path, joint) for joint in listed]
            else:
                names += [f"{path}[{k}]" for k in range(size)]
        return tuple(names)


def _named(path: str, joint: str) -> str:
    """The name of a joint's number; joints may be called as units, as `a` and `c` of a gantry."""
    return f"{path}['{joint}']" if cells.is_unit(joint) else f"{path}[{joint}]"


def _joints_beside(texts: Mapping[str, tuple[str, ...]], scope: str, size: int) -> tuple[str, ...]:
    """The joints' names beside an array of numbers, or the only ones in the message."""
    fits = {path: x for path, x in texts.items() if len(x) == size == len({*x}) > 1}
    for prefix in (f"{scope}." if scope else "", ""):
        for key in _JOINT_LISTS:
            if prefix + key in fits:
                return fits[prefix + key]
    return fits.popitem()[1] if len({*fits.values()}) == 1 else ()


class MessageDecoder:
    """Decodes the messages of one topic.

    Args:
        topic: The topic; without a definition its type must be one of ROS itself.

    Raises:
        MessageError: A type that is not known, or a definition that makes no sense.
        MissingExtraError: Without the `ros` extra.
    """

    def __init__(self, topic: bagfiles.Topic) -> None:
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
            data: Its bytes, compressed or not; with the encapsulation header where they are CDR.

        Raises:
            MessageError: Bytes that do not fit the definition.
        """
        decode = self._store.deserialize_ros1 if self._ros1 else self._store.deserialize_cdr
        try:
            if data.startswith(content.ZSTD_MAGIC):
                data = content.inflate(data, "zstd")
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


def _own_store(topic: bagfiles.Topic, kind: str, ros1: bool) -> Any:
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
    store.register({**{name: known[name] for name in _BASIC if name in known}, **types})
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
                into.form.append((inner, numbers.size))
                into.values += numbers.tolist()
        elif isinstance(value, list):
            items = cast("list[Any]", value)
            if all(isinstance(item, str) for item in items):
                if name in _LISTS:
                    into.form.append((inner, tuple(items)))
                continue
            for k, item in enumerate(items[:_MOST_KEPT]):
                _flatten(item, f"{inner}[{k}]", into, depth + 1)
        elif isinstance(value, (float, int)):
            if not isinstance(value, bool):
                into.form.append((inner, -1))
                into.values.append(float(value))
        elif not isinstance(value, str):
            _flatten(value, inner, into, depth + 1)


@dataclass(slots=True)
class Messages:
    """Numbers of messages that have the same fields.

    It keeps numbers only, so an hour at 500 Hz fits in memory.
    """

    number: "array[int]" = field(default_factory=lambda: array("q"))
    """Message number in the topic, from 1."""
    stamp: "array[int]" = field(default_factory=lambda: array("q"))
    """Header stamps [ns]."""
    receive: "array[int]" = field(default_factory=lambda: array("q"))
    """Receive times [ns]."""
    values: "array[float]" = field(default_factory=lambda: array("d"))
    """The fields of a message, message after message."""

    def add(self, number: int, stamp_ns: int, receive_ns: int, values: Iterable[float]) -> None:
        """Take one message."""
        self.number.append(number)
        self.stamp.append(stamp_ns)
        self.receive.append(min(max(receive_ns, 0), 1 << 62))
        self.values.extend(values)

    @property
    def times(self) -> NDArray[np.int64]:
        """(3, N) number, stamp and receive time of each message."""
        return np.array([self.number, self.stamp, self.receive], dtype=np.int64)

    def table(self) -> Array:
        """(N, k) the fields."""
        return np.frombuffer(self.values, dtype=np.float64).reshape(len(self.number), -1)
