"""The messages of RTDE (TCP port 30004), protocols 1 and 2, for client and controller.

All numbers are big-endian. `protocol` is 1 until a client has asked for 2. Facts: Universal
Robots, "Real-Time Data Exchange (RTDE) guide".
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from dynid.protocol.framing import Kind, ProtocolError, frame

PORT = 30004
"""Where controllers listen."""
PROTOCOLS = (1, 2)
"""Versions of the protocol that exist."""
NAMES_LIMIT = 12_288
"""The longest list of names in a recipe [bytes]. UR's guide says 2048, but its own client asks
URSim for 9174 (Universal_Robots_Client_Library, tests/test_rtde_client.cpp)."""
_U16, _F64, _VERSION = struct.Struct(">H"), struct.Struct(">d"), struct.Struct(">4I")


class Level(IntEnum):
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
    level: Level = Level.INFO
    """How grave it is."""


@dataclass(frozen=True, slots=True)
class OutputSetup:
    """What a client asks to be sent."""

    names: tuple[str, ...]
    """Variables, in order."""
    frequency: float | None
    """Packages a second [Hz]; None in protocol 1, which cannot ask."""


def request_protocol(version: int) -> bytes:
    """Client: ask for a version of the protocol."""
    return frame(Kind.REQUEST_PROTOCOL_VERSION, _U16.pack(version))


def request_software_version() -> bytes:
    """Client: ask for the version of the controller's software."""
    return frame(Kind.GET_URCONTROL_VERSION)


def request_outputs(names: Sequence[str], frequency: float | None) -> bytes:
    """Client: ask for an output recipe; protocol 2 takes a frequency [Hz], 1 takes None."""
    prefix = b"" if frequency is None else _F64.pack(frequency)
    return frame(Kind.SETUP_OUTPUTS, prefix + ",".join(names).encode())


def request_inputs(names: Sequence[str]) -> bytes:
    """Client: ask for an input recipe."""
    return frame(Kind.SETUP_INPUTS, ",".join(names).encode())


def request_start() -> bytes:
    """Client: ask for data packages."""
    return frame(Kind.START)


def request_pause() -> bytes:
    """Client: ask for silence."""
    return frame(Kind.PAUSE)


def read_protocol_request(payload: bytes) -> int:
    """Controller: the version that a client asks for."""
    return int(_fixed(_U16, payload, "a request for a protocol version")[0])


def read_output_setup(payload: bytes, protocol: int) -> OutputSetup:
    """Controller: the output recipe that a client asks for.

    Raises:
        ProtocolError: No frequency, or names that are no text.
    """
    if protocol == 1:
        return OutputSetup(read_names(payload), None)
    if len(payload) < _F64.size:
        raise ProtocolError("an output setup of protocol 2 begins with a frequency")
    return OutputSetup(read_names(payload[_F64.size :]), float(_F64.unpack_from(payload)[0]))


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


def text_message(message: TextMessage, protocol: int, *, from_client: bool = False) -> bytes:
    """A text message; texts are cut at 255 bytes. Clients always speak the form of protocol 2."""
    words, source = message.message.encode()[:255], message.source.encode()[:255]
    if protocol == 1 and not from_client:
        return frame(Kind.TEXT_MESSAGE, bytes((message.level,)) + words)
    body = bytes((len(words),)) + words + bytes((len(source),)) + source
    return frame(Kind.TEXT_MESSAGE, body + bytes((message.level,)))


def read_text_message(payload: bytes, protocol: int, *, from_client: bool = False) -> TextMessage:
    """The text message in a payload.

    Raises:
        ProtocolError: A payload cut short, or an unknown level.
    """
    try:
        if protocol == 1 and not from_client:
            return TextMessage(_words(payload[1:]), "", Level(payload[0]))
        length = payload[0]
        words, rest = payload[1 : 1 + length], payload[1 + length :]
        source, level = rest[1 : 1 + rest[0]], rest[1 + rest[0]]
        return TextMessage(_words(words), _words(source), Level(level))
    except (IndexError, ValueError) as error:
        raise ProtocolError("a text message is cut short or of no known level") from error


def _fixed(layout: struct.Struct, payload: bytes, what: str) -> tuple[int, ...]:
    if len(payload) != layout.size:
        raise ProtocolError(
            f"{what} has the wrong size",
            value=f"{len(payload)} bytes",
            limit=f"{layout.size} bytes",
        )
    return layout.unpack(payload)


def _words(raw: bytes) -> str:
    return raw.decode(errors="replace")


def _text(raw: bytes) -> str:
    try:
        return raw.decode("ascii")
    except UnicodeDecodeError as error:
        raise ProtocolError("a list of names is no ASCII text", value=raw[:40]) from error
