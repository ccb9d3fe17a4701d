"""Bags of other messages than JointState: any whose definition the bag carries.

FrankaState, controller states, drivers' feedback: the names of their fields say what they are,
as the header of a table does.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from dynid.core import RecordError
from dynid.recording.bagfiles import Catalog, Message, Topic
from dynid.recording.clocks import clock_of, stamps_of
from dynid.recording.columns import assign
from dynid.recording.content import ZSTD_MAGIC, InflateError, inflate
from dynid.recording.headers import NotRecognised, match_headers
from dynid.recording.messages import (
    Decoded,
    MessageDecoder,
    MessageError,
    field_names,
    joints_beside,
)
from dynid.recording.table import TORQUE_SOURCES, RawTable, ReadOptions, plain

Reader = Callable[[Catalog], Iterator[Message]]
"""Yields the messages of a bag that a catalog wants."""
_RECORD = "Record the robot's /joint_states topic."
_CONVERT = (
    " Or, as this bag does not define its messages, on a machine that has them: "
    "ros2 topic echo --csv TOPIC > run.csv, or ros2 bag convert to storage_id: mcap."
)


@dataclass(slots=True)
class _Rows:
    """What the messages of one topic hold."""

    decoder: MessageDecoder
    first: Decoded | None = None
    count: int = 0
    damaged: int = 0
    other: int = 0
    """Messages with other fields than the first."""
    number: array[int] = field(default_factory=lambda: array("q"))
    stamp: array[int] = field(default_factory=lambda: array("q"))
    receive: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))

    def add(self, receive_ns: int, data: bytes, keep: Sequence[int] | None) -> None:
        """Take one message; without `keep` only the first is decoded."""
        self.count += 1
        if keep is None and self.first is not None:
            return
        try:
            if data.startswith(ZSTD_MAGIC):
                data = inflate(data, "zstd")
            message = self.decoder.decode(data)
        except (MessageError, InflateError):
            self.damaged += 1
            return
        if self.first is None:
            self.first = message
        if keep is None:
            return
        if message.names != self.first.names or message.texts != self.first.texts:
            self.other += 1
            return
        self.number.append(self.count)
        self.stamp.append(message.stamp_ns)
        self.receive.append(min(max(receive_ns, 0), 1 << 62))
        self.values.extend(message.values[k] for k in keep)


def read_states(
    read: Reader,
    topics: Mapping[str, Topic],
    options: ReadOptions,
    *,
    where: str,
) -> RawTable:
    """Read the messages of one topic by the names of their fields.

    Args:
        read: Yields messages.
        topics: All topics of the bag.
        options: Columns say quantity to field (`effort=tau_J`); None to go by the names. The
            topic; None for the only one whose names say positions.
        where: The bag, for messages.

    Raises:
        RecordError: No topic has positions, several have, or their messages are not defined.
    """
    joints, columns, topic = options.joints, options.columns, options.topic
    chosen = _choose(read, topics, topic, joints, where)
    first = _first_of(read, [chosen])[chosen.name]
    names = field_names(first)
    found = assign(names, columns, len(names), f"{where} {chosen.name}", joints)
    user_clock = found.clocks if columns is not None else ()
    taken = sorted(
        {k for cols in found.columns.values() for k in cols}
        | {k for clock in user_clock for k in clock.columns}
    )
    rows = _Rows(MessageDecoder(chosen), first=first)
    catalog = Catalog(wanted=lambda item: item.name == chosen.name)
    for _, receive, data in read(catalog):
        rows.add(receive, data, taken)
    if not rows.number:
        raise RecordError(
            "no message can be decoded",
            where=f"{where} {chosen.name}",
            value=f"{rows.damaged} damaged messages",
        )
    place = {column: k for k, column in enumerate(taken)}
    values = np.array(rows.values).reshape(-1, len(taken))
    clock, ticks = clock_of(np.array(rows.stamp, np.int64), np.array(rows.receive, np.int64))
    stamps = stamps_of(user_clock, lambda k: values[:, place[k]])
    table = RawTable(
        source=where,
        format=options.format,
        rows=np.array(rows.number, dtype=np.int64),
        row_word="message",
        signals=found.signals(lambda k: values[:, place[k]]),
        t=(ticks - ticks[0]).astype(np.float64) * 1e-9 if stamps.t is None else stamps.t,
        time_scale=1.0 if stamps.t is None else stamps.scale,
        t0=f"{ticks[0] // 1_000_000_000}.{ticks[0] % 1_000_000_000:09d}"
        if stamps.t is None
        else stamps.t0,
        clock=clock if stamps.t is None else "recorded",
        labels={q: tuple(names[k] for k in cols) for q, cols in found.columns.items()},
        said=found.said,
        joint_names=found.joint_names or joints_beside(first, names, found.columns["q"]),
        notices=(*catalog.findings, *found.notices),
        notes=(*found.notes, f"topic {plain(chosen.name)} ({plain(chosen.kind)})"),
        dropped=rows.damaged + rows.other,
        extra={"topic": chosen.name},
    )
    if rows.damaged:
        table = table.report(
            "corrupt_rows", f"{rows.damaged} of {rows.count} messages cannot be decoded"
        )
    if rows.other:
        table = table.report(
            "dropped_rows", f"{rows.other} of {rows.count} messages have other fields or joints"
        )
    return table


def _choose(
    read: Reader,
    topics: Mapping[str, Topic],
    wanted: str | None,
    joints: Sequence[str],
    where: str,
) -> Topic:
    """The topic that is asked for, or the only one that has positions; best with torques."""
    if wanted is not None and wanted not in topics:
        raise RecordError("no such topic", where=where, value=wanted, limit=sorted(topics))
    asked = [topics[wanted]] if wanted is not None else list(topics.values())
    samples = _first_of(read, asked)
    full: list[Topic] = []
    some: list[Topic] = []
    unclear: list[RecordError] = []
    for item in asked:
        if item.name not in samples:
            continue
        if wanted is not None:
            return item
        try:
            match = match_headers(field_names(samples[item.name]), f"{where} {item.name}", joints)
        except NotRecognised:
            continue
        except RecordError as error:
            unclear.append(error)
            continue
        torque = any(name in match.columns for name in TORQUE_SOURCES)
        (full if torque else some).append(item)
    fits = full or some
    if len(fits) == 1:
        return fits[0]
    described = [f"{item.name} ({item.kind})" for item in fits or topics.values()][:20]
    if fits:
        raise RecordError(
            f"{len(fits)} topics can be the robot's state",
            where=where,
            value=described,
            next_step=f"Say which, for example --topic {fits[0].name}.",
        )
    if unclear:
        # A topic of the right kind, of which more has to be said.
        raise unclear[0]
    bare = [item for item in asked if not item.definition and not item.is_joint_state]
    raise RecordError(
        "the bag has no readable sensor_msgs/JointState topic, nor another with positions",
        where=where,
        value=described,
        next_step=_RECORD + (_CONVERT if bare else ""),
    )


def _first_of(read: Reader, topics: Sequence[Topic]) -> dict[str, Decoded]:
    """The first good message of each topic that can be decoded."""
    rows: dict[str, _Rows] = {}
    for item in topics:
        with suppress(MessageError):
            rows[item.name] = _Rows(MessageDecoder(item))
    missing = set(rows)
    for name, receive, data in read(Catalog(wanted=lambda item: item.name in rows)):
        rows[name].add(receive, data, None)
        if rows[name].first is not None:
            missing.discard(name)
        if not missing:
            break
    return {name: item.first for name, item in rows.items() if item.first is not None}
