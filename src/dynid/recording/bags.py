"""ROS recordings: one topic of a bag as a table.

Bags need not contain JointState messages: FrankaState, controller states and drivers' feedback are
recognised by the names of their fields, as the columns of a table are by its header.
"""

import re
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, RecordError, UnclearRecordError, printable
from dynid.recording import bagfiles, columns, content, headers
from dynid.recording.bagfiles import Catalog, Topic
from dynid.recording.messages import MessageDecoder, MessageError, Messages
from dynid.recording.names import TARGET
from dynid.recording.table import TORQUE_SOURCES, RawTable, ReadOptions, Rows

_SUFFIXES = (".db3", ".mcap", ".bag", ".db3.zstd", ".mcap.zstd")
_RECORD = "Record the robot's /joint_states topic."
_CONVERT = (
    " Or, as this bag does not define its messages, on a machine that has them: "
    "ros2 topic echo --csv TOPIC > run.csv, or ros2 bag convert to storage_id: mcap."
)

_Names = tuple[str, ...]
"""Of the numbers of a message, in their order; see `Decoded.names`."""


@dataclass(slots=True)
class _Collector:
    """The messages of one topic."""

    decoder: MessageDecoder
    wanted: frozenset[str] | None = None
    """Names of the numbers that are kept; None for all."""
    count: int = 0
    """Messages seen."""
    damaged: int = 0
    """Messages that could not be decoded."""
    first_damaged: int = 0
    """Number of the first of them."""
    groups: dict[_Names, Messages] = field(default_factory=dict[_Names, Messages])
    """The names of their numbers to the messages that have these."""
    _forms: dict[Any, tuple[Messages, list[int]]] = field(default_factory=dict[Any, Any])

    def add(self, receive_ns: int, data: bytes) -> None:
        """Take one message; a damaged one is counted."""
        self.count += 1
        try:
            message = self.decoder.decode(data)
        except MessageError:
            self.damaged += 1
            self.first_damaged = self.first_damaged or self.count
            return
        form = tuple(message.form)
        if form not in self._forms:
            names = message.names()
            kept = [k for k, name in enumerate(names) if not self.wanted or name in self.wanted]
            group = self.groups.setdefault(tuple(names[k] for k in kept), Messages())
            self._forms[form] = group, kept
        group, kept = self._forms[form]
        values = message.values
        if len(kept) < len(values):
            values = [values[k] for k in kept]
        group.add(self.count, message.stamp_ns, receive_ns, values)

    def usual_names(self, joints: int, named: Sequence[str]) -> _Names:
        """The names of most numbers; before them those of so many joints, and with these.

        Raises:
            RecordError: More than half as many are of other joints, as of two arms.
        """

        def standing(names: _Names) -> tuple[bool, bool, int, int]:
            wanted = {*named} <= {*map(_joint, names)}
            own = _positions(names)
            count = own * len(self.groups[names].number)
            return wanted, own >= max(joints, 1), count, len(names)

        best = max(self.groups, key=standing)
        own, (*kind, most, _) = {*map(_joint, best)}, standing(best)
        for names in self.groups:
            others, (*other, count, _) = {*map(_joint, names)}, standing(names)
            if kind == other and 2 * count > most and own.isdisjoint(others):
                raise UnclearRecordError(
                    "messages of one topic are of different joints, as of two arms",
                    value=[printable(", ".join(sorted(both)), 200) for both in (own, others)],
                    next_step="Name those of the robot, base to tip, with --joint-order.",
                )
        return best

    def columns(self, names: Sequence[str], needed: set[str]) -> tuple[Array, Rows]:
        """Numbers (N, k) of the messages that have those needed, and their `times`.

        Others that a message lacks are NaN.
        """
        fits = {own: group for own, group in self.groups.items() if needed <= {*own}}
        parts: list[Array] = []
        for own, group in fits.items():
            place = {name: k for k, name in enumerate(own)}
            table = np.pad(group.table(), ((0, 0), (0, 1)), constant_values=np.nan)
            parts.append(table[:, [place.get(name, -1) for name in names]])
        times = np.concatenate([group.times for group in fits.values()], axis=1)
        # Files of a bag, and chunks of a file, may stand in another order than their messages were
        # sent in; where a clock was set, the order in which they were written is the better one.
        written, received = np.argsort(times[0]), np.lexsort((times[0], times[2]))
        order = min(received, written, key=lambda rows: (np.diff(times[1, rows]) < 0).sum())
        return np.concatenate(parts)[order], times[:, order]


def _positions(names: Sequence[str]) -> int:
    """How many numbers are positions of a JointState."""
    return sum(name.startswith("position[") for name in names)


def _joint(name: str) -> str:
    """The joint in the name of a number; empty for none."""
    inside = name.rpartition("[")[2].strip("]'") if name.endswith("]") else ""
    return "" if inside.isdecimal() else inside


def _choose_topic(topics: Mapping[str, _Collector], joints: int) -> str:
    """The JointState topic that must be the robot's (`joints`, 0 if unknown).

    Raises:
        RecordError: Several could be it, as of two arms.
    """
    standing: dict[str, tuple[bool, ...]] = {}
    for name, item in topics.items():
        # Enough joints, measured not asked for, and the usual name.
        enough = max(map(_positions, item.groups), default=0) >= max(joints, 1)
        measured = not TARGET & set(re.split(r"[^a-z]+", name.lower()))
        usual = (name == "/joint_states", name.endswith("joint_states"))
        standing[name] = (enough, measured, *usual)
    best = max(topics, key=lambda name: (standing[name], topics[name].count, name))
    many = [name for name, item in topics.items() if 2 * item.count > topics[best].count]
    rivals = sorted(name for name in many if standing[name] == standing[best] and name != best)
    if rivals and standing[best][0]:
        raise _unclear([best, *rivals], best)
    return best


def _choose_by_fields(
    paths: Sequence[Path], topics: Sequence[Topic], joints: Sequence[str], *, given: bool
) -> tuple[Topic, _Names]:
    """The topic that is given, or the only one with positions, and torques where some have.

    Raises:
        RecordError: No topic has positions, or several have.
    """
    full: list[tuple[Topic, _Names]] = []
    some: list[tuple[Topic, _Names]] = []
    unclear: list[RecordError] = []
    for item, first in _first_of(paths, topics):
        if given:
            return item, first
        try:
            with _of_topic(item):
                match = headers.match_headers(first, joints)
        except headers.NotRecognised:
            continue
        except RecordError as error:
            unclear.append(error)
            continue
        torque = any(name in match.columns for name in TORQUE_SOURCES)
        (full if torque else some).append((item, first))
    fits = full or some
    if len(fits) == 1:
        return fits[0]
    rivals = [item for item, _ in fits]
    described = [f"{item.name} ({item.kind})" for item in rivals or topics][:20]
    if rivals:
        raise _unclear(described, rivals[0].name)
    if unclear:
        # A topic of the right kind, of which more has to be said.
        raise unclear[0]
    bare = [item for item in topics if not item.definition and not item.is_joint_state]
    raise RecordError(
        "the bag has no readable sensor_msgs/JointState topic, nor another with positions",
        value=described or None,
        next_step=_RECORD + (_CONVERT if bare else ""),
    )


def _unclear(topics: list[str], first: str) -> RecordError:
    what = f"{len(topics)} topics can be the robot's state"
    step = f"Choose one, for example --topic {first}."
    return UnclearRecordError(what, value=topics, next_step=step)


def _first_of(paths: Sequence[Path], topics: Sequence[Topic]) -> list[tuple[Topic, _Names]]:
    """The topics that can be decoded, each with the names in its first good message."""
    decoders: dict[str, MessageDecoder] = {}
    for item in topics:
        with suppress(MessageError):
            decoders[item.name] = MessageDecoder(item)
    found: dict[str, _Names] = {}
    for name, _, data in _messages(paths, Catalog(wanted=lambda item: item.name in decoders)):
        if name not in found:
            with suppress(MessageError):
                found[name] = decoders[name].decode(data).names()
            if len(found) == len(decoders):
                break
    return [(item, found[item.name]) for item in topics if item.name in found]


@contextmanager
def _of_topic(topic: Topic) -> Generator[None]:
    """The topic in the words of an error; where it is, the file tells."""
    try:
        yield
    except RecordError as error:
        raise error.changed(what=f"topic {printable(topic.name)}: {error.what}") from error


def _collect(
    paths: Sequence[Path],
    catalog: Catalog,
    decoder_of: Callable[[Topic], MessageDecoder],
    wanted: frozenset[str] | None = None,
) -> dict[str, _Collector]:
    """The messages of each topic that a catalog wants."""
    topics: dict[str, _Collector] = {}
    for name, receive, data in _messages(paths, catalog):
        if name not in topics:
            topics[name] = _Collector(decoder_of(catalog.topics[name]), wanted)
        topics[name].add(receive, data)
    return topics


def read_bag(paths: list[Path], options: ReadOptions, budget: content.Budget) -> RawTable:
    """Read the messages of one topic: JointState, or others that the bag defines; see `Reader`.

    Stamps are those of the headers; where those are all zero, the receive times. Joints are
    matched by name, so the order in the messages (alphabetical on UR drivers) does not matter.
    Columns say quantity to field, where the names are wrong: UR drivers send currents as effort
    (`q=position,current=effort`). The joint order names those to take, base to tip, as the messages
    give them. Files of one bag come in time order.

    Raises:
        RecordError: No bag, no such topic, several that can be meant, no message with positions.
        MissingExtraError: Without the `ros` extra.
    """
    joints, topic = options.joints, options.topic
    catalog = Catalog()
    # What a JointState is needs no bag to say.
    topics = _collect(paths, catalog, lambda item: MessageDecoder(replace(item, definition="")))
    known = catalog.topics
    others = {name: item for name, item in known.items() if not item.is_joint_state}
    if catalog.findings and not topics and not others:
        cause = catalog.findings[0].text.partition(";")[0]
        raise RecordError("no message in it can be read", value=cause)
    if topic is not None and topic not in known:
        raise RecordError("no such topic", value=topic, limit=sorted(known))
    widths = [_positions(names) for item in topics.values() for names in item.groups]
    enough = not others or max(widths, default=0) >= max(len(joints), 1)
    states = topic in topics if topic is not None else bool(topics) and enough
    if states:
        chosen = known[topic or _choose_topic(topics, len(joints))]
        collector = topics[chosen.name]
        if not collector.groups:
            said = f"{collector.damaged} damaged messages"
            raise RecordError(f"no message of {chosen.name} can be decoded", value=said)
        order = [name for name in options.joint_order or () if not name.isdecimal()]
        names = collector.usual_names(len(joints), order or joints)
        if any(map(_joint, names)):
            # An array that is not as long as the names says nothing of the joints.
            names = tuple(name if _joint(name) else "" for name in names)
    else:
        asked = [known[topic]] if topic is not None else list(others.values())
        chosen, names = _choose_by_fields(paths, asked, joints, given=topic is not None)
        collector = None
    with _of_topic(chosen):
        found = columns.assign(names, options.columns, len(names), joints)
    if options.columns is None:
        # The messages' own stamps are the clock.
        found = replace(found, clocks=())
        if states and not {*TORQUE_SOURCES} & {*found.columns}:
            raise _no_efforts(chosen, known)
    clocks = {k for clock in found.clocks for k in clock.columns}
    taken = sorted(clocks.union(*found.columns.values()))
    kept = [names[k] for k in taken]
    if collector is None:
        catalog = Catalog(wanted=lambda item: item.name == chosen.name)
        collector = _collect(paths, catalog, MessageDecoder, frozenset(kept))[chosen.name]
    values, times = collector.columns(kept, {names[k] for k in found.columns["q"]})
    place = {column: k for k, column in enumerate(taken)}
    lacking = collector.count - collector.damaged - len(values)
    table = found.table(
        names,
        lambda k: values[:, place[k]],
        rows=times[0],
        row_word="message",
        dropped=collector.damaged + lacking,
        extra={"topic": chosen.name},
    )
    if table.t is None:
        table = replace(table, **_clock_facts(times))
    own = tuple(_joint(names[k]) for k in found.columns["q"])
    named = own if all(own) else table.joint_names
    notices = (*catalog.findings, *table.notices)
    table = replace(table, columns={}, joint_names=named, notices=notices)
    if len(known) > 1:
        table = table.note(f"topic {printable(chosen.name)} ({printable(chosen.kind)})")
    if collector.damaged:
        table = table.report(
            "corrupt_rows",
            f"{collector.damaged} of {collector.count} messages cannot be decoded; first: message "
            f"{collector.first_damaged}",
        )
    if lacking:
        text = f"{lacking} of {collector.count} messages have other fields or joints"
        table = table.report("dropped_rows", text)
    return table


def _no_efforts(chosen: Topic, topics: Mapping[str, Topic]) -> RecordError:
    rest = sorted(f"{x.name} ({x.kind})" for x in topics.values() if x.name != chosen.name)
    others = printable(", ".join(rest[:10]), 500)
    return (UnclearRecordError if rest else RecordError)(
        f"there is neither current nor effort: no message of {printable(chosen.name)} has efforts",
        next_step="Record the topic that has them"
        + (f", or choose it with --topic, of {others}." if rest else "."),
    )


def _clock_facts(times: Rows) -> dict[str, Any]:
    """Time of a raw table, from the `times` of messages (3, N).

    Drivers leave headers empty: then the times of arrival are the clock.
    """
    stamps = times[1]
    empty = (stamps <= 0).mean() > 0.5 or np.unique(stamps).size <= max(1, len(stamps) // 10)
    clock, ticks = ("receive", times[2]) if empty else ("header", stamps)
    return {
        "t": (ticks - ticks[0]).astype(np.float64) * 1e-9,
        "time_scale": 1.0,
        "t0": f"{ticks[0] // 1_000_000_000}.{ticks[0] % 1_000_000_000:09d}",
        "clock": clock,
    }


def _messages(paths: Sequence[Path], catalog: Catalog) -> Iterator[bagfiles.Message]:
    """The messages that a catalog wants, of all files of a bag."""
    for path in paths:
        head = content.first_bytes(path, 16)
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
