"""Packets and messages of RTDE (TCP port 30004), protocols 1 and 2."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from dynid.core import JobError

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


PORT = 30004
"""Where controllers listen."""
PROTOCOLS = (1, 2)
"""Versions of the protocol that exist."""
NAMES_LIMIT = 12_288
"""The longest list of names in a recipe [bytes]. UR's guide says 2048, but its own client asks
URSim for 9174 (Universal_Robots_Client_Library, tests/test_rtde_client.cpp)."""
_U16, _F64, _VERSION = struct.Struct(">H"), struct.Struct(">d"), struct.Struct(">4I")


class MessageLevel(IntEnum):
    """How grave a text message is."""

    EXCEPTION = 0
    ERROR = 1
    WARNING = 2
    INFO = 3


@dataclass(frozen=True, slots=True)
class TextMessage:
    """A message for people."""

    message: str
    """The text."""
    source: str = ""
    """Who says it; lost in protocol 1."""
    level: MessageLevel = MessageLevel.INFO
    """How grave it is."""


def request_protocol(version: int) -> bytes:
    """Client: ask for a version of the protocol."""
    return frame(Kind.REQUEST_PROTOCOL_VERSION, _U16.pack(version))


def request_outputs(names: Sequence[str], frequency: float | None) -> bytes:
    """Client: ask for an output recipe; protocol 2 takes a frequency [Hz], 1 takes None."""
    prefix = b"" if frequency is None else _F64.pack(frequency)
    return frame(Kind.SETUP_OUTPUTS, prefix + ",".join(names).encode())


def request_inputs(names: Sequence[str]) -> bytes:
    """Client: ask for an input recipe."""
    return frame(Kind.SETUP_INPUTS, ",".join(names).encode())


def read_protocol_request(payload: bytes) -> int:
    """Controller: the version that a client asks for."""
    return int(_fixed(_U16, payload, "a request for a protocol version")[0])


def read_output_setup(payload: bytes, protocol: int) -> tuple[tuple[str, ...], float | None]:
    """Controller: the variables that a client asks for, and packages a second (None: protocol 1).

    Raises:
        ProtocolError: No frequency, or names that are no text.
    """
    if protocol == 1:
        return read_names(payload), None
    if len(payload) < _F64.size:
        raise ProtocolError("an output setup of protocol 2 begins with a frequency")
    return read_names(payload[_F64.size :]), float(_F64.unpack_from(payload)[0])


def read_names(payload: bytes) -> tuple[str, ...]:
    """A list of names or types, split at its commas; a comma at the end adds nothing.

    Raises:
        ProtocolError: The list is no ASCII text.
    """
    text = _text(payload)
    return tuple(name.strip() for name in text.split(",") if name.strip())


def answer(kind: Kind, accepted: bool) -> bytes:
    """Controller: yes or no to a protocol version, a start or a pause."""
    return frame(kind, bytes((accepted,)))


def answer_software_version(major: int, minor: int, bugfix: int, build: int) -> bytes:
    """Controller: the version of its software."""
    return frame(Kind.GET_URCONTROL_VERSION, _VERSION.pack(major, minor, bugfix, build))


def answer_setup(kind: Kind, types: Sequence[str], number: int | None) -> bytes:
    """Controller: the types of a recipe, and its number (0: refused; None: protocol 1 outputs)."""
    prefix = b"" if number is None else bytes((number,))
    return frame(kind, prefix + ",".join(types).encode())


def read_answer(payload: bytes) -> bool:
    """Client: whether the controller accepts.

    Raises:
        ProtocolError: An empty answer.
    """
    if not payload:
        raise ProtocolError("the controller's answer is empty")
    return payload[0] == 1


def read_software_version(payload: bytes) -> tuple[int, int, int, int]:
    """Client: major, minor, bugfix and build number of the controller's software."""
    major, minor, bugfix, build = _fixed(_VERSION, payload, "a software version")
    return major, minor, bugfix, build


def read_setup_answer(
    kind: Kind, payload: bytes, protocol: int
) -> tuple[int | None, tuple[str, ...]]:
    """Client: the number of a recipe (None: the answer carries none) and its types.

    Raises:
        ProtocolError: An empty answer, or types that are no text.
    """
    if kind == Kind.SETUP_OUTPUTS and protocol == 1:
        return None, read_names(payload)
    if not payload:
        raise ProtocolError("the controller's answer to a setup is empty")
    return payload[0], read_names(payload[1:])


def text_message(message: TextMessage, protocol: int) -> bytes:
    """A text message; texts are cut at 255 bytes. Clients always use the form of protocol 2."""
    words, source = message.message.encode()[:255], message.source.encode()[:255]
    if protocol == 1:
        return frame(Kind.TEXT_MESSAGE, bytes((message.level,)) + words)
    body = bytes((len(words),)) + words + bytes((len(source),)) + source
    return frame(Kind.TEXT_MESSAGE, body + bytes((message.level,)))


def read_text_message(payload: bytes, protocol: int) -> TextMessage:
    """The text message in a payload; see `text_message`.

    Raises:
        ProtocolError: A payload cut short, or an unknown level.
    """
    try:
        if protocol == 1:
            return TextMessage(_words(payload[1:]), "", MessageLevel(payload[0]))
        length = payload[0]
        words, rest = payload[1 : 1 + length], payload[1 + length :]
        source, level = rest[1 : 1 + rest[0]], rest[1 + rest[0]]
        return TextMessage(_words(words), _words(source), MessageLevel(level))
    except (IndexError, ValueError) as error:
        raise ProtocolError("a text message is cut short or of no known level") from error


def _fixed(layout: struct.Struct, payload: bytes, what: str) -> tuple[int, ...]:
    if len(payload) != layout.size:
        given, size = f"{len(payload)} bytes", f"{layout.size} bytes"
        raise ProtocolError(f"{what} has the wrong size", value=given, limit=size)
    return layout.unpack(payload)


def _words(raw: bytes) -> str:
    return raw.decode(errors="replace")


def _text(raw: bytes) -> str:
    try:
        return raw.decode("ascii")
    except UnicodeDecodeError as error:
        raise ProtocolError("a list of names is no ASCII text", value=raw[:40]) from error
