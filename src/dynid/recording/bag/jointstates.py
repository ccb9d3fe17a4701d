"""Gather JointState messages into columns, whatever order each message gives the joints."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np

from dynid.core import Array
from dynid.recording.bag.cdr import CdrError, JointState, JointStateDecoder
from dynid.recording.bag.inflate import ZSTD_MAGIC, InflateError, inflate
from dynid.recording.bag.ros1 import Ros1Decoder
from dynid.recording.table import Rows

FIELDS = ("position", "velocity", "effort")
_NAN = float("nan")
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

    count: int = 0
    """Messages seen."""
    damaged: int = 0
    """Messages that could not be decoded."""
    first_damaged: int = 0
    """Number of the first of them."""
    groups: dict[tuple[str, ...], Group] = field(default_factory=dict[tuple[str, ...], Group])
    """Joint names to messages."""
    decoder: JointStateDecoder | Ros1Decoder = field(default_factory=JointStateDecoder)
    """Turns bytes into messages: ROS 1 writes them differently."""

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
            message = self._decoded(data)
        except (CdrError, InflateError):
            self._damage()
            return
        joints = len(message.names)
        if joints == 0 or len(message.position) != joints or len(set(message.names)) != joints:
            self._damage()
            return
        group = self.groups.setdefault(message.names, Group())
        group.number.append(self.count)
        group.stamp.append(message.stamp_ns)
        group.receive.append(min(max(receive_ns, 0), 1 << 62))
        sent = (message.position, message.velocity, message.effort)
        for name, values in zip(FIELDS, sent, strict=True):
            group.columns[name].extend(values if len(values) == joints else [_NAN] * joints)

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

    def _decoded(self, data: bytes) -> JointState:
        try:
            return self.decoder.decode(data)
        except CdrError:
            if self.groups:
                raise
            # An MCAP file may hold what ROS 1 wrote.
            other = Ros1Decoder()
            message = other.decode(data)
            self.decoder = other
            return message

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
