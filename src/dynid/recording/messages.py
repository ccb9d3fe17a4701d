"""Messages out of bytes, by the definitions that bags carry or those of ROS itself.

The decoder is that of rosbags. It compiles definitions to Python code; its grammar admits nothing
but identifiers and literals into that code.

Bags need not contain JointState messages: FrankaState, controller states and drivers' feedback are
recognised by the names of their fields, as the columns of a table are by its header.
"""

from __future__ import annotations

import functools
import re
import struct
from array import array
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dynid.core import Array, RecordError, UnclearRecordError, printable, require
from dynid.recording.bagfiles import Catalog, Message, Topic
from dynid.recording.columns import assign
from dynid.recording.content import ZSTD_MAGIC, inflate
from dynid.recording.headers import NotRecognised, match_headers
from dynid.recording.table import TORQUE_SOURCES, RawTable, ReadOptions

_LONGEST_DEFINITION = 1 << 18
_MOST_KEPT = 200
"""Longer arrays are images and the like: they are passed over."""
_MAX_DEPTH = 16
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
            data: Its bytes, compressed or not; with the encapsulation header where they are CDR.

        Raises:
            MessageError: Bytes that do not fit the definition.
        """
        decode = self._store.deserialize_ros1 if self._ros1 else self._store.deserialize_cdr
        try:
            if data.startswith(ZSTD_MAGIC):
                data = inflate(data, "zstd")
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


def _field_names(message: Decoded) -> list[str]:
    """Paths of the numbers; interfaces that `DynamicJointState` names itself go by those names."""
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


def _joints_beside(
    message: Decoded, names: Sequence[str], columns: Sequence[int]
) -> tuple[str, ...]:
    """The joints' names that stand beside the positions (columns) in a message, if any."""
    scope = names[columns[0]].rpartition(".")[0]
    for prefix in (f"{scope}." if scope else "", ""):
        for key in _JOINT_LISTS:
            listed = message.texts.get(prefix + key, [])
            if len(listed) == len(columns) == len(set(listed)):
                return tuple(listed)
    return ()


Reader = Callable[[Catalog], Iterator[Message]]
"""Yields the messages of a bag that a catalog wants."""
_RECORD = "Record the robot's /joint_states topic."
_CONVERT = (
    " Or, as this bag does not define its messages, on a machine that has them: "
    "ros2 topic echo --csv TOPIC > run.csv, or ros2 bag convert to storage_id: mcap."
)


@dataclass(slots=True)
class Messages:
    """Numbers of messages that have the same fields.

    It keeps numbers only, so an hour at 500 Hz fits in memory.
    """

    number: array[int] = field(default_factory=lambda: array("q"))
    """Message number in the topic, from 1."""
    stamp: array[int] = field(default_factory=lambda: array("q"))
    """Header stamps [ns]."""
    receive: array[int] = field(default_factory=lambda: array("q"))
    """Receive times [ns]."""
    values: array[float] = field(default_factory=lambda: array("d"))
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


def clock_facts(times: NDArray[np.int64]) -> dict[str, Any]:
    """Rows and time of a raw table, from the `times` of messages (3, N).

    Drivers leave headers empty: then the times of arrival are the clock.
    """
    stamps = times[1]
    empty = (stamps <= 0).mean() > 0.5 or np.unique(stamps).size <= max(1, len(stamps) // 10)
    clock, ticks = ("receive", times[2]) if empty else ("header", stamps)
    return {
        "rows": times[0],
        "row_word": "message",
        "t": (ticks - ticks[0]).astype(np.float64) * 1e-9,
        "time_scale": 1.0,
        "t0": f"{ticks[0] // 1_000_000_000}.{ticks[0] % 1_000_000_000:09d}",
        "clock": clock,
    }


def read_states(read: Reader, topics: Mapping[str, Topic], options: ReadOptions) -> RawTable:
    """Read the messages of one topic by the names of their fields.

    Columns say quantity to field (`effort=tau_J`).

    Raises:
        RecordError: No topic has positions, several have, or their messages are not defined.
    """
    joints, columns, topic = options.joints, options.columns, options.topic
    chosen, first = _choose(read, topics, topic, joints)
    names = _field_names(first)
    with _of_topic(chosen):
        found = assign(names, columns, len(names), joints)
    if columns is None:
        # The messages' own stamps are the clock.
        found = replace(found, clocks=())
    taken = sorted(
        {k for cols in found.columns.values() for k in cols}
        | {k for clock in found.clocks for k in clock.columns}
    )
    decoder, messages = MessageDecoder(chosen), Messages()
    catalog = Catalog(wanted=lambda item: item.name == chosen.name)
    count = damaged = other = 0
    for count, (_, receive, data) in enumerate(read(catalog), 1):
        try:
            message = decoder.decode(data)
        except MessageError:
            damaged += 1
            continue
        if message.names != first.names or message.texts != first.texts:
            other += 1
            continue
        messages.add(count, message.stamp_ns, receive, (message.values[k] for k in taken))
    if not messages.number:
        raise RecordError(
            f"no message of {chosen.name} can be decoded", value=f"{damaged} damaged messages"
        )
    place = {column: k for k, column in enumerate(taken)}
    values = messages.table()
    facts = clock_facts(messages.times)
    table = found.table(
        names,
        lambda k: values[:, place[k]],
        rows=facts["rows"],
        row_word="message",
        dropped=damaged + other,
        extra={"topic": chosen.name},
    )
    if table.t is None:
        table = replace(table, **facts)
    table = replace(
        table,
        columns={},
        joint_names=table.joint_names or _joints_beside(first, names, found.columns["q"]),
        notices=(*catalog.findings, *table.notices),
    ).note(f"topic {printable(chosen.name)} ({printable(chosen.kind)})")
    if damaged:
        table = table.report("corrupt_rows", f"{damaged} of {count} messages cannot be decoded")
    if other:
        table = table.report(
            "dropped_rows", f"{other} of {count} messages have other fields or joints"
        )
    return table


@contextmanager
def _of_topic(topic: Topic) -> Generator[None]:
    """The topic in the words of an error; where it is, the file tells."""
    try:
        yield
    except RecordError as error:
        raise error.changed(what=f"topic {printable(topic.name)}: {error.what}") from error


def _choose(
    read: Reader, topics: Mapping[str, Topic], wanted: str | None, joints: Sequence[str]
) -> tuple[Topic, Decoded]:
    """The topic that is asked for, or the only one that has positions, and its first message."""
    if wanted is not None and wanted not in topics:
        raise RecordError("no such topic", value=wanted, limit=sorted(topics))
    asked = [topics[wanted]] if wanted is not None else list(topics.values())
    samples = _first_of(read, asked)
    full: list[Topic] = []
    some: list[Topic] = []
    unclear: list[RecordError] = []
    for item in asked:
        if item.name not in samples:
            continue
        if wanted is not None:
            return item, samples[item.name]
        try:
            with _of_topic(item):
                match = match_headers(_field_names(samples[item.name]), joints)
        except NotRecognised:
            continue
        except RecordError as error:
            unclear.append(error)
            continue
        torque = any(name in match.columns for name in TORQUE_SOURCES)
        (full if torque else some).append(item)
    fits = full or some
    if len(fits) == 1:
        return fits[0], samples[fits[0].name]
    described = [f"{item.name} ({item.kind})" for item in fits or topics.values()][:20]
    if fits:
        raise UnclearRecordError(
            f"{len(fits)} topics can be the robot's state",
            value=described,
            next_step=f"Choose one, for example --topic {fits[0].name}.",
        )
    if unclear:
        # A topic of the right kind, of which more has to be said.
        raise unclear[0]
    bare = [item for item in asked if not item.definition and not item.is_joint_state]
    raise RecordError(
        "the bag has no readable sensor_msgs/JointState topic, nor another with positions",
        value=described or None,
        next_step=_RECORD + (_CONVERT if bare else ""),
    )


def _first_of(read: Reader, topics: Sequence[Topic]) -> dict[str, Decoded]:
    """The first good message of each topic that can be decoded."""
    decoders: dict[str, MessageDecoder] = {}
    for item in topics:
        with suppress(MessageError):
            decoders[item.name] = MessageDecoder(item)
    found: dict[str, Decoded] = {}
    for name, _, data in read(Catalog(wanted=lambda item: item.name in decoders)):
        if name not in found:
            with suppress(MessageError):
                found[name] = decoders[name].decode(data)
            if len(found) == len(decoders):
                break
    return found
