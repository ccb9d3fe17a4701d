"""ROS recordings: the JointState messages of a bag, joints matched by name."""

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.core import Array, RecordError, UnclearRecordError, printable
from dynid.recording import bagfiles
from dynid.recording.content import Budget, first_bytes
from dynid.recording.messages import (
    MessageDecoder,
    MessageError,
    Messages,
    clock_facts,
    read_states,
    stamp_of,
)
from dynid.recording.names import TARGET, places_of
from dynid.recording.table import TORQUE_SOURCES, RawTable, ReadOptions

FIELDS = ("position", "velocity", "effort")
_NAN = float("nan")
_MOST_JOINTS = 1000


@dataclass(slots=True)
class _Collector:
    """The JointState messages of one topic."""

    decoder: MessageDecoder
    count: int = 0
    """Messages seen."""
    damaged: int = 0
    """Messages that could not be decoded."""
    first_damaged: int = 0
    """Number of the first of them."""
    groups: dict[tuple[str, ...], Messages] = field(default_factory=dict[tuple[str, ...], Messages])
    """Joint names to the messages that name them: positions, velocities, efforts."""

    def add(self, receive_ns: int, data: bytes) -> None:
        """Take one message; a damaged one is counted."""
        self.count += 1
        try:
            message = self.decoder.message(data)
            stamp = stamp_of(message.header)
            names = tuple(message.name)
            joints = len(names)
            if not 0 < joints <= _MOST_JOINTS or {len({*names}), len(message.position)} != {joints}:
                raise MessageError("no joints, or not one position each")
        except MessageError:
            self.damaged += 1
            self.first_damaged = self.first_damaged or self.count
            return
        values = [
            item.tolist() if len(item) == joints else [_NAN] * joints
            for item in (getattr(message, name) for name in FIELDS)
        ]
        group = self.groups.setdefault(names, Messages())
        group.add(self.count, stamp, receive_ns, itertools.chain(*values))

    def common_names(self) -> tuple[str, ...]:
        """The joint names of most messages; of equals, those with more joints."""
        return max(self.groups, key=lambda names: (len(self.groups[names].number), len(names)))

    def columns(self, joints: tuple[str, ...]) -> tuple[dict[str, Array], NDArray[np.int64]]:
        """Field to values (N, n) of the messages that have all of `joints`, and their `times`."""
        fits = {names: group for names, group in self.groups.items() if set(joints) <= {*names}}
        if not fits:
            return {}, np.zeros((3, 0), dtype=np.int64)
        times = np.concatenate([group.times for group in fits.values()], axis=1)
        order = np.argsort(times[0], kind="stable")
        values = {
            name: np.concatenate(
                [
                    group.table()[:, [k * len(names) + names.index(joint) for joint in joints]]
                    for names, group in fits.items()
                ]
            )[order]
            for k, name in enumerate(FIELDS)
        }
        return values, times[:, order]


def _choose_topic(topics: Mapping[str, _Collector], joints: int) -> str:
    """The topic that must be the robot's (`joints`, 0 if unknown).

    Raises:
        RecordError: Several could be it, as of two arms.
    """
    standing: dict[str, tuple[bool, ...]] = {}
    for name, item in topics.items():
        # Enough joints, measured not asked for, and the usual name.
        enough = max(map(len, item.groups), default=0) >= max(joints, 1)
        measured = not TARGET & set(re.split(r"[^a-z]+", name.lower()))
        usual = (name == "/joint_states", name.endswith("joint_states"))
        standing[name] = (enough, measured, *usual)
    best = max(topics, key=lambda name: (standing[name], topics[name].count, name))
    many = [name for name, item in topics.items() if 2 * item.count > topics[best].count]
    rivals = sorted(name for name in many if standing[name] == standing[best] and name != best)
    if rivals and standing[best][0]:
        raise UnclearRecordError(
            f"{1 + len(rivals)} topics can be the robot's state",
            value=[best, *rivals],
            next_step=f"Choose one, for example --topic {best}.",
        )
    return best


_SUFFIXES = (".db3", ".mcap", ".bag", ".db3.zstd", ".mcap.zstd")
_DEFAULT = {"q": "position", "qd": "velocity", "effort": "effort"}


def read_bag(paths: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read the JointState messages of one topic, or other messages that the bag defines.

    Stamps are those of the headers; where those are all zero, the receive times. Joints are
    matched by name, so the order in the messages (alphabetical on UR drivers) does not matter.
    Columns say quantity to `position`, `velocity` or `effort`, where the default (q, qd, effort)
    is wrong: UR drivers send currents as effort. The joint order names those to take, base to tip,
    as the messages give them. Files of one bag come in time order.

    Raises:
        RecordError: No bag, no such topic, no message that has the joints.
        MissingExtraError: Without the `ros` extra.
    """
    joints, columns, topic = options.joints, options.columns, options.topic
    catalog = bagfiles.Catalog()
    topics: dict[str, _Collector] = {}
    for name, receive, data in _messages(paths, catalog):
        if name not in topics:
            # What a JointState is needs no bag to say.
            plain_topic = replace(catalog.topics[name], definition="")
            topics[name] = _Collector(MessageDecoder(plain_topic))
        topics[name].add(receive, data)
    others = {name: item for name, item in catalog.topics.items() if not item.is_joint_state}
    if catalog.findings and not topics and not others:
        cause = catalog.findings[0].text.partition(";")[0]
        raise RecordError("no message in it can be read", value=cause)
    if topic is not None:
        states = topic in topics
    else:
        sizes = [len(names) for collector in topics.values() for names in collector.groups]
        states = bool(topics) and (not others or max(sizes, default=0) >= max(len(joints), 1))
    if not states:
        named = others if topic is None else catalog.topics
        return read_states(lambda wish: _messages(paths, wish), named, options)
    chosen = topic or _choose_topic(topics, len(joints))
    collector = topics[chosen]
    if not collector.groups:
        raise RecordError(
            f"no message of {chosen} can be decoded as JointState",
            value=f"{collector.damaged} damaged messages",
        )
    names = _joints(collector, joints, options.joint_order)
    note = f"topic {printable(chosen)} of {printable(', '.join(sorted(topics)), 300)}"
    values, times = collector.columns(names)
    if not values:
        raise RecordError(
            f"no message of {chosen} has all the joints",
            value=collector.common_names(),
            limit=names,
        )
    if collector.damaged:
        catalog.report(
            "corrupt_rows",
            f"{collector.damaged} of {collector.count} messages cannot be decoded; first: "
            f"message {collector.first_damaged}",
        )
    lacking = collector.count - collector.damaged - times.shape[1]
    if lacking:
        catalog.report(
            "dropped_rows", f"{lacking} of {collector.count} messages lack one of the joints"
        )
    mapping = _DEFAULT if columns is None else columns
    for quantity, name in mapping.items():
        if name not in FIELDS or quantity == "t":
            raise RecordError(
                f"columns: item '{quantity}={name}' is not in a JointState message", limit=FIELDS
            )
    signals = {
        quantity: values[field]
        for quantity, field in mapping.items()
        if quantity == "q" or not np.isnan(values[field]).all()
    }
    if not {*TORQUE_SOURCES} & {*signals} and {*TORQUE_SOURCES} & {*mapping}:
        rest = [f"{item.name} ({item.kind})" for item in catalog.topics.values()]
        rest = sorted(text for text in rest if text.partition(" ")[0] != chosen)[:10]
        others = printable(", ".join(rest), 500)
        raise (UnclearRecordError if rest else RecordError)(
            f"there is neither current nor effort: no message of {chosen} has efforts",
            next_step="Record the topic that has them"
            + (f", or choose it with --topic, of {others}." if rest else "."),
        )
    return RawTable(
        **clock_facts(times),
        signals=signals,
        labels={
            quantity: tuple(f"{field} of {name}" for name in names)
            for quantity, field in mapping.items()
        },
        joint_names=names,
        notices=tuple(catalog.findings),
        notes=(note,) if len(topics) > 1 else (),
        dropped=collector.damaged + lacking,
        extra={"topic": chosen},
    )


def _messages(paths: Sequence[Path], catalog: bagfiles.Catalog) -> Iterator[bagfiles.Message]:
    """The messages that a catalog wants, of all files of a bag."""
    for path in paths:
        head = first_bytes(path, 16)
        if head.startswith(bagfiles.MCAP_MAGIC):
            yield from bagfiles.mcap_messages(path, catalog)
        elif head.startswith(bagfiles.ROS1_MAGIC):
            yield from bagfiles.ros1_messages(path, catalog)
        else:
            yield from bagfiles.db3_messages(path, catalog)


def bag_files(folder: Path) -> list[Path]:
    """The storage files of a bag folder, in the order of their numbers; none in any other."""
    files = [path for path in folder.iterdir() if path.name.endswith(_SUFFIXES)]
    return sorted(files, key=lambda path: (len(path.name), path.name))


def _joints(
    collector: _Collector, robot: tuple[str, ...], order: Sequence[str] | None
) -> tuple[str, ...]:
    """The joint names to take: those asked for, the robot's, or those of most messages."""
    common = collector.common_names()
    if order is not None:
        # With numbers the common order is kept here and permuted with all other formats.
        if all(name.isdecimal() for name in order):
            return common
        missing = [name for name in order if all(name not in names for names in collector.groups)]
        if missing:
            raise RecordError("the messages have no such joints", value=missing, limit=common)
        return tuple(order)
    for names in (common, *collector.groups):
        # The same names, or the same behind one prefix.
        if place := places_of(robot, names):
            return tuple(names[k] for k in place)
    return common
