"""The messages of port 30001, laid out as UR's client library and python-urx read them.

Universal_Robots_Client_Library, src/primary/robot_message/*.cpp, with the messages recorded from
real controllers in tests/test_primary_parser.cpp; python-urx, urx/ursecmon.py, for popups.
"""

from __future__ import annotations

import re
import struct

from dynid.protocol import SafetyMode
from dynid.simulation.controller.machine_core import Message, MessageKind

_ROBOT_MESSAGE = 20
_TEXT, _POPUP, _VERSION, _SAFETY_MODE, _ERROR_CODE, _KEY, _EXCEPTION = 0, 2, 3, 5, 6, 7, 10
_FROM_CONTROLLER, _FROM_PROGRAM = -2, -3
_PROJECT = b"URControl"
_BUILD_DATE = b"01-01-2024, 00:00:00"
_CODE = re.compile(r"C(\d+)(?:A(\d+))?:?\s*")
_VIOLATION = 3
_LONGEST_TITLE = 255


def version_message(version: tuple[int, int, int, int], timestamp: float) -> bytes:
    """What a client of 30001 or 30002 reads first.

    Args:
        version: Major, minor, bugfix and build number.
        timestamp: Controller time [s].
    """
    body = _short(_PROJECT) + struct.pack(">BBii", *version) + _BUILD_DATE
    return _message(_VERSION, _FROM_CONTROLLER, body, timestamp)


def packets(message: Message) -> bytes:
    """What clients of 30001 read of something that the controller has said."""
    words, at = message.text.encode(), message.timestamp
    match message.kind:
        case MessageKind.KEY:
            body = struct.pack(">ii", 0, 0) + _short(message.title.encode()) + words
            return _message(_KEY, _FROM_CONTROLLER, body, at)
        case MessageKind.POPUP:
            return _message(_POPUP, _FROM_PROGRAM, _popup(message), at)
        case MessageKind.STOP:
            return _stop(message)
        case MessageKind.EXCEPTION:
            place = struct.pack(">ii", message.line, 1)
            said = place + (message.title.encode() or words)
            exception = _message(_EXCEPTION, _FROM_PROGRAM, said, at)
            # The controller's own words name the error; ours say what to do.
            return exception + _message(_TEXT, _FROM_PROGRAM, words, at)
        case MessageKind.NOTE:
            return b""
        case MessageKind.TEXT:
            return _message(_TEXT, _FROM_PROGRAM, words, at)


def _popup(message: Message) -> bytes:
    """Number, type asked for, warning, error, blocking, title and text."""
    number = round(1e6 * message.timestamp) & 0xFFFFFFFF
    flags = (message.level == 2, message.level < 2, message.blocking)
    head = struct.pack(">IB???", number, 0, *flags)
    return head + _short(message.title.encode()) + message.text.encode()


def _stop(message: Message) -> bytes:
    """The error code of a stop, then the new safety mode."""
    found = _CODE.match(message.text)
    code, argument = (int(number or 0) for number in found.groups()) if found else (0, 0)
    report = struct.pack(">iiiII", code, argument, _VIOLATION, 0, 0) + message.text.encode()
    entered = SafetyMode.FAULT if message.level == 0 else SafetyMode.PROTECTIVE_STOP
    mode = struct.pack(">iiBII", code, argument, int(entered), 0, 0)
    return _message(_ERROR_CODE, _FROM_CONTROLLER, report, message.timestamp) + _message(
        _SAFETY_MODE, _FROM_CONTROLLER, mode, message.timestamp
    )


def _short(text: bytes) -> bytes:
    return bytes((len(text[:_LONGEST_TITLE]),)) + text[:_LONGEST_TITLE]


def _message(kind: int, source: int, body: bytes, timestamp: float) -> bytes:
    head = struct.pack(">Qbb", round(1e6 * timestamp), source, kind)
    return struct.pack(">iB", 5 + len(head) + len(body), _ROBOT_MESSAGE) + head + body
