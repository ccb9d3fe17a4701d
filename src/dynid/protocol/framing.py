"""Packets of RTDE: a size, a type, a payload, found in a stream of bytes."""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import NamedTuple

from dynid.core.errors import JobError

HEADER = struct.Struct(">HB")
"""Size of the whole packet, these three bytes included, and its type."""
LARGEST = 0xFFFF
"""The largest packet that the size field can name [bytes]."""


class ProtocolError(JobError):
    """The other side sent what is no part of the protocol; the connection is to be closed."""


class Kind(IntEnum):
    """Types of RTDE packets; each is an ASCII letter."""

    TEXT_MESSAGE = ord("M")
    DATA_PACKAGE = ord("U")
    REQUEST_PROTOCOL_VERSION = ord("V")
    GET_URCONTROL_VERSION = ord("v")
    SETUP_OUTPUTS = ord("O")
    SETUP_INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")


KINDS: dict[int, Kind] = {int(kind): kind for kind in Kind}


class Packet(NamedTuple):
    """One packet."""

    kind: Kind
    """What it is."""
    payload: bytes
    """What follows the header."""


class Framer:
    """Finds packets in a stream that arrives in arbitrary pieces.

    It never holds more than one unfinished packet, so its memory is bounded.

    Args:
        largest: The largest packet to accept [bytes].
    """

    def __init__(self, largest: int = LARGEST) -> None:
        self._largest = largest
        self._buffer = b""

    def feed(self, data: bytes) -> list[Packet]:
        """Take bytes; return the packets that they complete, in order.

        Raises:
            ProtocolError: A header that no packet can have; nothing after it can be trusted.
        """
        buffer = self._buffer + data if self._buffer else data
        packets: list[Packet] = []
        start, end = 0, len(buffer)
        while end - start >= HEADER.size:
            size, letter = HEADER.unpack_from(buffer, start)
            kind = KINDS.get(letter)
            if kind is None:
                raise ProtocolError(
                    "these bytes are no RTDE packet: its type is unknown",
                    value=f"type {letter}, size {size}",
                    limit=", ".join(f"{int(k)} '{chr(k)}'" for k in Kind),
                )
            if not HEADER.size <= size <= self._largest:
                raise ProtocolError(
                    f"an RTDE packet of type '{chr(letter)}' has an impossible size",
                    value=f"{size} bytes",
                    limit=f"{HEADER.size} to {self._largest} bytes",
                )
            if end - start < size:
                break
            packets.append(Packet(kind, bytes(buffer[start + HEADER.size : start + size])))
            start += size
        self._buffer = bytes(buffer[start:])
        return packets

    @property
    def pending(self) -> int:
        """Bytes held of a packet that is not complete yet."""
        return len(self._buffer)


def frame(kind: Kind, payload: bytes = b"") -> bytes:
    """One packet as bytes.

    Raises:
        ProtocolError: A payload that the size field cannot name.
    """
    size = HEADER.size + len(payload)
    if size > LARGEST:
        raise ProtocolError("an RTDE packet is too large", value=size, limit=LARGEST)
    return HEADER.pack(size, kind) + payload
