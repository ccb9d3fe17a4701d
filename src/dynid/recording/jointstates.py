"""ROS recordings: the JointState messages of a bag, joints matched by name."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dynid.core import Array, Finding, RecordError
from dynid.recording.bagfiles import MAGIC as ROS1_MAGIC
from dynid.recording.bagfiles import (
    MCAP_MAGIC,
    Catalog,
    Message,
    Topic,
    db3_messages,
    mcap_messages,
    ros1_messages,
)
from dynid.recording.clocks import clock_of
from dynid.recording.columns import parse_columns
from dynid.recording.content import ZSTD_MAGIC, Budget, InflateError, inflate
from dynid.recording.messages import MessageDecoder, MessageError, read_states, stamp_of
from dynid.recording.names import TARGET, UR_JOINTS, places_of
from dynid.recording.table import RawTable, ReadOptions, Rows, plain

FIELDS = ("position", "velocity", "effort")
_NAN = float("nan")
_MOST_JOINTS = 1000
_LAST = 50
"""Messages by which two topics are compared."""


def _ints() -> array[int]:
    return array("q")


def _columns() -> dict[str, array[float]]:
    return {name: array("d") for name in FIELDS}


@dataclass(slots=True)
class Group:
    """Messages that name the same joints in the same order."""

    number: array[int] = field(default_factory=_ints)
    """Message number in the topic, from 1."""
    stamp: array[int] = field(default_factory=_ints)
    """Header stamps [ns]."""
    receive: array[int] = field(default_factory=_ints)
    """Receive times [ns]."""
    columns: dict[str, array[float]] = field(default_factory=_columns)
    """Field to values, message after message."""


@dataclass(slots=True)
class Collector:
    """The messages of one topic.

    It keeps numbers only, so an hour at 500 Hz fits in memory.
    """

    decoder: MessageDecoder
    count: int = 0
    """Messages seen."""
    damaged: int = 0
    """Messages that could not be decoded."""
    first_damaged: int = 0
    """Number of the first of them."""
    groups: dict[tuple[str, ...], Group] = field(default_factory=dict[tuple[str, ...], Group])
    """Joint names to messages."""

    def add(self, receive_ns: int, data: bytes) -> None:
        """Take one message; a damaged one is counted.

        Args:
            receive_ns: Receive time [ns].
            data: The message's bytes.
        """
        self.count += 1
        try:
            if data.startswith(ZSTD_MAGIC):
                data = inflate(data, "zstd")
            message = self.decoder.message(data)
            stamp = stamp_of(message.header)
        except (MessageError, InflateError):
            self._damage()
            return
        names = tuple(message.name)
        joints = len(names)
        if not 0 < joints <= _MOST_JOINTS or len(set(names)) != joints:
            self._damage()
            return
        if len(message.position) != joints:
            self._damage()
            return
        group = self.groups.setdefault(names, Group())
        group.number.append(self.count)
        group.stamp.append(stamp)
        group.receive.append(min(max(receive_ns, 0), 1 << 62))
        for name in FIELDS:
            values = getattr(message, name)
            group.columns[name].extend(
                values.tolist() if len(values) == joints else [_NAN] * joints
            )

    def says_the_same(self, other: Collector) -> bool:
        """Whether another topic repeats this one's positions, as one that gathers topics does."""
        if not self.groups or not other.groups:
            return True
        one, two = self.common_names(), other.common_names()
        shared = [name for name in one if name in two]
        if not shared:
            return False
        recent = [
            np.array(group.columns["position"][-len(names) * _LAST :]).reshape(-1, len(names))[
                :, [names.index(name) for name in shared]
            ]
            for names, group in ((one, self.groups[one]), (two, other.groups[two]))
        ]
        rows = {tuple(row) for row in recent[1].tolist()}
        return any(tuple(row) in rows for row in recent[0].tolist())

    def _damage(self) -> None:
        self.damaged += 1
        self.first_damaged = self.first_damaged or self.count

    def common_names(self) -> tuple[str, ...]:
        """The joint names of most messages; of equals, those with more joints."""
        return max(self.groups, key=lambda names: (len(self.groups[names].number), len(names)))

    def columns(self, joints: tuple[str, ...]) -> tuple[dict[str, Array], Rows, Rows, Rows]:
        """Values of the messages that have all of `joints`, in the order of arrival.

        Args:
            joints: Joint names in the order wanted.

        Returns:
            Field to (N, n) values, message numbers (N), header stamps and receive times
            (N) [ns].
        """
        parts: list[tuple[Group, list[int], int]] = []
        for names, group in self.groups.items():
            place = {name: k for k, name in enumerate(names)}
            if all(name in place for name in joints):
                parts.append((group, [place[name] for name in joints], len(names)))
        empty = np.zeros(0, dtype=np.int64)
        number = np.concatenate([empty, *(np.array(g.number, np.int64) for g, _, _ in parts)])
        order = np.argsort(number, kind="stable")
        stamp = np.concatenate([empty, *(np.array(g.stamp, np.int64) for g, _, _ in parts)])
        receive = np.concatenate([empty, *(np.array(g.receive, np.int64) for g, _, _ in parts)])
        values = {
            name: np.concatenate(
                [
                    np.zeros((0, len(joints))),
                    *(
                        np.array(g.columns[name]).reshape(-1, width)[:, take]
                        for g, take, width in parts
                    ),
                ]
            )[order]
            for name in FIELDS
        }
        return values, number[order], stamp[order], receive[order]


def choose_topic(
    topics: Mapping[str, Collector], wanted: str | None, joints: int, where: str
) -> str:
    """The topic that is asked for, or the one that must be the robot's.

    Args:
        topics: Topics of JointState and their messages.
        wanted: The topic that is asked for, if any.
        joints: Number of the robot's joints; 0 if it is not known.
        where: The bag, for messages.

    Raises:
        RecordError: It is not there, or several could be it, as of two arms.
    """
    if wanted is not None and wanted not in topics:
        raise RecordError(
            "no such JointState topic", where=where, value=wanted, limit=sorted(topics)
        )
    if not topics:
        raise RecordError(
            "the bag has no readable sensor_msgs/JointState message",
            where=where,
            next_step="Record the robot's /joint_states topic.",
        )
    if wanted is not None:
        return wanted
    ranked = sorted(topics, key=lambda name: (*_standing(name, topics[name], joints), name))
    best = ranked[-1]
    first = _standing(best, topics[best], joints)
    rivals = [
        name
        for name in ranked[:-1]
        if _standing(name, topics[name], joints)[:-1] == first[:-1]
        and 2 * topics[name].count > topics[best].count
        and not topics[name].says_the_same(topics[best])
    ]
    if rivals and first[0]:
        raise RecordError(
            f"{1 + len(rivals)} topics can be the robot's state",
            where=where,
            value=[best, *rivals],
            next_step=f"Choose one, for example --topic {best}.",
        )
    return best


def _standing(name: str, collector: Collector, joints: int) -> tuple[bool, bool, bool, bool, int]:
    """Enough joints, measured not asked for, the usual name, and then the most messages."""
    words = set(re.split(r"[^a-z]+", name.lower()))
    most = max((len(names) for names in collector.groups), default=0)
    usual = name.endswith("joint_states")
    return (
        most >= max(joints, 1),
        not words & TARGET,
        name == "/joint_states",
        usual,
        collector.count,
    )


_SUFFIXES = (".db3", ".mcap", ".bag", ".db3.zstd", ".mcap.zstd")
_DEFAULT = {"q": "position", "qd": "velocity", "effort": "effort"}


def read_bag(paths: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read the JointState messages of one topic, or other messages that the bag defines.

    Stamps are those of the headers; where those are all zero, the receive times. Joints are
    matched by name, so the order in the messages (alphabetical on UR drivers) does not matter.

    Args:
        paths: Storage files of one bag, in time order.
        options: Columns say quantity to `position`, `velocity` or `effort`, where the default
            (q, qd, effort) is wrong: UR drivers send currents as effort. The topic may be of
            any type; None for the JointState topic with most messages. The joint order names
            those to take, base to tip, as the messages give them.
        budget: Bounds what is read.

    Raises:
        RecordError: No bag, no such topic, no message that has the joints.
        MissingExtraError: Without the `ros` extra.
    """
    joints, columns, topic = options.joints, options.columns, options.topic
    where = ", ".join(path.name for path in paths)
    catalog = Catalog()
    topics: dict[str, Collector] = {}
    for name, receive, data in _messages(paths, catalog):
        if name not in topics:
            # What a JointState is needs no bag to say.
            plain_topic = replace(catalog.topics[name], definition="")
            topics[name] = Collector(MessageDecoder(plain_topic))
        topics[name].add(receive, data)
    findings = catalog.findings
    others = {name: item for name, item in catalog.topics.items() if not item.is_joint_state}
    if others and not _enough(topics, catalog.topics, topic, len(joints)):
        return read_states(
            lambda wish: _messages(paths, wish),
            catalog.topics if topic is not None else others,
            options,
            where=where,
        )
    chosen = choose_topic(topics, topic, len(joints), where)
    collector = topics[chosen]
    if not collector.groups:
        raise RecordError(
            "no message can be decoded as JointState",
            where=f"{where} {chosen}",
            value=f"{collector.damaged} damaged messages",
        )
    names, notes = _joints(collector, tuple(joints), options.joint_order, where)
    if len(topics) > 1:
        notes.append(f"topic {plain(chosen)} of {plain(', '.join(sorted(topics)), 300)}")
    values, numbers, stamps, receive = collector.columns(names)
    if len(numbers) == 0:
        raise RecordError(
            "no message has all the joints",
            where=f"{where} {chosen}",
            value=collector.common_names(),
            limit=names,
        )
    if collector.damaged:
        findings.append(
            Finding(
                "corrupt_rows",
                f"{collector.damaged} of {collector.count} messages cannot be decoded; first: "
                f"message {collector.first_damaged}",
            )
        )
    lacking = collector.count - collector.damaged - len(numbers)
    if lacking:
        findings.append(
            Finding(
                "dropped_rows", f"{lacking} of {collector.count} messages lack one of the joints"
            )
        )
    clock, ticks = clock_of(stamps, receive)
    mapping = parse_columns(columns) if columns is not None else _DEFAULT
    for quantity, name in mapping.items():
        if name not in FIELDS or quantity == "t":
            raise RecordError(
                f"columns: item '{quantity}={name}' is not in a JointState message", limit=FIELDS
            )
    return RawTable(
        source=where,
        format=options.format,
        rows=numbers,
        row_word="message",
        signals={
            quantity: values[field]
            for quantity, field in mapping.items()
            if quantity == "q" or not np.isnan(values[field]).all()
        },
        t=(ticks - ticks[0]).astype(np.float64) * 1e-9,
        time_scale=1.0,
        t0=f"{ticks[0] // 1_000_000_000}.{ticks[0] % 1_000_000_000:09d}",
        clock=clock,
        labels={
            quantity: tuple(f"{field} of {name}" for name in names)
            for quantity, field in mapping.items()
        },
        joint_names=names,
        notices=tuple(findings),
        notes=tuple(notes),
        dropped=collector.damaged + lacking,
        extra={"topic": chosen},
    )


def _messages(paths: Sequence[Path], catalog: Catalog) -> Iterator[Message]:
    """The messages that a catalog wants, of all files of a bag."""
    for path in paths:
        with path.open("rb") as stream:
            head = stream.read(16)
        if head.startswith(MCAP_MAGIC):
            yield from mcap_messages(path, catalog)
        elif head.startswith(ROS1_MAGIC):
            yield from ros1_messages(path, catalog)
        else:
            yield from db3_messages(path, catalog)


def _enough(
    found: Mapping[str, Collector], topics: Mapping[str, Topic], wanted: str | None, joints: int
) -> bool:
    """Whether JointState messages are asked for, or there and have the robot's joints."""
    if wanted is not None:
        return wanted not in topics or topics[wanted].is_joint_state
    sizes = [len(names) for collector in found.values() for names in collector.groups]
    return max(sizes, default=0) >= max(joints, 1)


def bag_files(folder: Path) -> list[Path]:
    """The storage files of a bag folder, in the order of their numbers; none in any other."""
    files = [path for path in folder.iterdir() if path.name.endswith(_SUFFIXES)]
    return sorted(files, key=lambda path: (len(path.name), path.name))


def _joints(
    collector: Collector, robot: tuple[str, ...], order: Sequence[str] | None, where: str
) -> tuple[tuple[str, ...], list[str]]:
    """The joint names to take, base to tip."""
    common = collector.common_names()
    if order is not None:
        # With numbers the common order is kept here and permuted with all other formats.
        if all(name.isdecimal() for name in order):
            return common, []
        missing = [name for name in order if all(name not in names for names in collector.groups)]
        if missing:
            raise RecordError(
                "the messages have no such joints", where=where, value=missing, limit=common
            )
        return tuple(order), []
    notes: list[str] = []
    for names in (common, *collector.groups):
        for wanted in (robot, UR_JOINTS):
            matched = _matched(wanted, names)
            # Without a robot the whole message is taken, so the order must cover all of it.
            if matched and (wanted == robot or len(names) == len(matched)):
                if matched != names[: len(matched)]:
                    order_text = plain(", ".join(matched), 300)
                    notes.append(f"joints taken by name, in the order {order_text}")
                return matched, notes
    return common, notes


def _matched(wanted: tuple[str, ...], names: tuple[str, ...]) -> tuple[str, ...]:
    """The message's names for the wanted joints: the same, or the same behind one prefix."""
    return tuple(names[k] for k in places_of(wanted, names))
