"""ROS recordings: `.db3`, `.mcap` and `.bag` files, and bag folders; JointState first of all."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from dynid.core import Finding, RecordError
from dynid.recording.bag.catalog import Catalog, Message, Topic
from dynid.recording.bag.cdr import JointStateDecoder
from dynid.recording.bag.db3 import db3_messages
from dynid.recording.bag.jointstates import FIELDS, Collector
from dynid.recording.bag.mcap import MAGIC, mcap_messages
from dynid.recording.bag.ros1 import MAGIC as ROS1_MAGIC
from dynid.recording.bag.ros1 import Ros1Decoder, ros1_messages
from dynid.recording.bag.stamps import clock_of
from dynid.recording.bag.topics import choose_topic
from dynid.recording.columns import parse_columns
from dynid.recording.jointnames import places_of
from dynid.recording.statebag import read_states
from dynid.recording.table import RawTable, plain
from dynid.recording.vocabulary import UR_JOINTS

_SUFFIXES = (".db3", ".mcap", ".bag", ".db3.zstd", ".mcap.zstd")
_DEFAULT = {"q": "position", "qd": "velocity", "effort": "effort"}


def read_bag(
    paths: Sequence[Path],
    *,
    joints: Sequence[str] = (),
    columns: str | Mapping[str, str] | None = None,
    topic: str | None = None,
    joint_order: Sequence[str] | None = None,
    format: str = "rosbag",
) -> RawTable:
    """Read the JointState messages of one topic, or other messages that the bag defines.

    Stamps are those of the headers; where those are all zero, the receive times. Joints are
    matched by name, so the order in the messages (alphabetical on UR drivers) does not matter.

    Args:
        paths: Storage files of one bag, in time order.
        joints: The robot's joint names, base to tip; empty if the robot is unknown.
        columns: Quantity to `position`, `velocity` or `effort`, where the default
            (q, qd, effort) is wrong: UR drivers send currents as effort.
        topic: The topic, of any type; None for the JointState topic with most messages.
        joint_order: The names to take, base to tip, as the messages give them.
        format: `rosbag` or `mcap`, for the metadata.

    Raises:
        RecordError: No bag, no such topic, no message that has the joints.
        MissingExtraError: A compressed bag without the decompressor.
    """
    where = ", ".join(path.name for path in paths)
    catalog = Catalog()
    topics: dict[str, Collector] = {}
    for name, receive, data in _messages(paths, catalog):
        if name not in topics:
            ros1 = catalog.topics[name].encoding == "ros1"
            topics[name] = Collector(decoder=Ros1Decoder() if ros1 else JointStateDecoder())
        topics[name].add(receive, data)
    findings = catalog.findings
    others = {name: item for name, item in catalog.topics.items() if not item.is_joint_state}
    if others and not _enough(topics, catalog.topics, topic, len(joints)):
        return read_states(
            lambda wish: _messages(paths, wish),
            catalog.topics if topic is not None else others,
            joints=joints,
            columns=columns,
            topic=topic,
            where=where,
            format=format,
        )
    chosen = choose_topic(topics, topic, len(joints), where)
    collector = topics[chosen]
    if not collector.groups:
        raise RecordError(
            "no message can be decoded as JointState",
            where=f"{where} {chosen}",
            value=f"{collector.damaged} damaged messages",
        )
    names, notes = _joints(collector, tuple(joints), joint_order, where)
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
    for quantity, field in mapping.items():
        if field not in FIELDS or quantity == "t":
            raise RecordError(
                f"columns: item '{quantity}={field}' is not in a JointState message", limit=FIELDS
            )
    return RawTable(
        source=where,
        format=format,
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
        if head.startswith(MAGIC):
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
