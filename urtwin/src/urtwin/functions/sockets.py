"""Built-ins for sockets: a program talks to the machine of a driver.

What is not there within the time asked for is answered as the script manual says: an empty
text, or zero as the count. Other threads run while one waits, also when that one is in a
critical section: UR's drivers count on it (their servo thread goes on between two commands).
"""

import math
import struct
from collections.abc import Callable, Generator, Sequence
from typing import Any, TypeVar

from urtwin.core import Core
from urtwin.network import Link
from urtwin.urscript import BACK, LISTENING, MAX_LENGTH, Value, number, shown, truth, whole

T = TypeVar("T")
Waiting = Generator[str | None, None, T]
_NAME, _TIMEOUT_S, _CONNECT_S = "socket_0", 2.0, 2.0
_OPENING_S = 0.01
"""How long it takes to connect, at least: a driver accepts each socket in a thread of its own, and
what it sends before that thread was there is lost."""
_MOST = 255
_INT = 4
_ESCAPES = (("\\n", "\n"), ("\\r", "\r"), ("\\t", "\t"))
_READS = 16
"""Answers of sockets in a control cycle; a program with more to read goes on in the next one, so
that commands that have piled up are no endless loop."""


def _open(core: Core, address: Value, port: Value, socket_name: Value = _NAME) -> Waiting[bool]:
    link = core.network.open(shown(socket_name), shown(address), int(number(port)))
    if not isinstance(link, Link):
        core.say(f"socket_open: {link}", level=2)
        yield LISTENING
        yield BACK
        return False
    name = shown(socket_name)
    least = math.ceil(_OPENING_S / core.arm.cycle)
    done = yield from _until(core, name, _CONNECT_S, lambda found: found.open or None, least)
    if done is None:
        core.network.close(name)
    return done is not None


def _until(
    core: Core, socket: Value, timeout: Value, take: Callable[[Link], T | None], least: int = 0
) -> Waiting[T | None]:
    """What a socket gives, once it does; None when the time is over or the socket closed.

    The time is counted in control cycles, but for those that are caught up: nobody could have
    answered between them.
    """
    name, wait = shown(socket), number(timeout)
    cycles = wait / core.arm.cycle if wait > 0 else math.inf
    waited, asked = 0, False
    while True:
        link = core.network.link(name)
        found = None if link is None or waited < least else take(link)
        over = link is None or not (link.open or link.opening) or waited >= cycles
        if found is not None or (over and asked):
            break
        core.network.listening = asked = True
        yield LISTENING
        waited += not core.network.late
    if asked:
        yield BACK
    core.network.reads += 1
    if core.network.reads > _READS:
        yield
    return found


def _count(value: Value) -> int:
    return whole("how many to read", value, 1, _MOST)


def _found(count: int, values: Sequence[float] | None) -> Value:
    """How many numbers there are, and they; none of them unless all are there."""
    return [0] + [math.nan] * count if values is None else [count, *values]


def _read_binary_integer(
    core: Core, number: Value, socket_name: Value = _NAME, timeout: Value = _TIMEOUT_S
) -> Waiting[Value]:
    count = _count(number)
    raw = yield from _until(core, socket_name, timeout, lambda link: link.take(count * _INT))
    return _found(count, None if raw is None else struct.unpack(f">{count}i", raw))


def _read_byte_list(
    core: Core, number: Value, socket_name: Value = _NAME, timeout: Value = _TIMEOUT_S
) -> Waiting[Value]:
    count = _count(number)
    raw = yield from _until(core, socket_name, timeout, lambda link: link.take(count))
    return _found(count, raw)


def _read_ascii_float(
    core: Core, number: Value, socket_name: Value = _NAME, timeout: Value = _TIMEOUT_S
) -> Waiting[Value]:
    count = _count(number)

    def take(link: Link) -> Value:
        end = link.data.find(b")")
        if end < 0:
            return None
        text = bytes(link.data[:end]).rpartition(b"(")[2]
        del link.data[: end + 1]
        try:
            floats = [float(part) for part in text.split(b",")]
        except ValueError:
            floats = []
        return _found(count, floats if len(floats) == count else None)

    found = yield from _until(core, socket_name, timeout, take)
    return _found(count, None) if found is None else found


def _marker(word: Value, escaped: Value) -> bytes:
    text = shown(word)
    for written, meant in _ESCAPES if truth(escaped) else ():
        text = text.replace(written, meant)
    return text.encode()


def _read_string(
    core: Core,
    socket_name: Value = _NAME,
    prefix: Value = "",
    suffix: Value = "",
    interpret_escape: Value = False,
    timeout: Value = _TIMEOUT_S,
) -> Waiting[str]:
    begin, end = (_marker(word, interpret_escape) for word in (prefix, suffix))

    def take(link: Link) -> str | None:
        data = link.data
        start = data.find(begin)
        stop = data.find(end, start + len(begin)) if end else len(data)
        if start < 0 or stop < 0 or not data:
            return None
        text = data[start + len(begin) : stop][:MAX_LENGTH].decode("latin-1")
        del data[: stop + len(end)]
        return text

    found = yield from _until(core, socket_name, timeout, take)
    return found or ""


def _read_line(core: Core, socket_name: Value = _NAME, timeout: Value = _TIMEOUT_S) -> Waiting[str]:
    def take(link: Link) -> str | None:
        line, end, rest = link.data.partition(b"\n")
        if not end:
            return None
        link.data[:] = rest
        return line[:MAX_LENGTH].decode("latin-1").rstrip("\r")

    found = yield from _until(core, socket_name, timeout, take)
    return found or ""


def _get_var(core: Core, name: Value, socket_name: Value = _NAME) -> Waiting[int]:
    _send(core, f"GET {shown(name)}\n".encode(), socket_name)
    answer = yield from _read_line(core, socket_name)
    value = answer.rpartition(" ")[2]
    return int(value) if value.lstrip("-").isdigit() else 0


def _send(core: Core, data: bytes, name: Value) -> bool:
    link = core.network.link(shown(name))
    return link is not None and link.send(data)


def _set_var(core: Core, name: Value, value: Value, socket_name: Value = _NAME) -> None:
    _send(core, f"SET {shown(name)} {shown(value)}\n".encode(), socket_name)


def _close(core: Core, socket_name: Value = _NAME) -> bool:
    return core.network.close(shown(socket_name))


_SEND: dict[str, Callable[[Core, Value, Value], bool]] = {
    "socket_send_int": lambda core, value, socket_name=_NAME: _send(
        core, struct.pack(">I", int(number(value)) & 0xFFFFFFFF), socket_name
    ),
    "socket_send_byte": lambda core, value, socket_name=_NAME: _send(
        core, bytes((int(number(value)) & 0xFF,)), socket_name
    ),
    "socket_send_string": lambda core, str, socket_name=_NAME: _send(
        core, shown(str).encode(), socket_name
    ),
    "socket_send_line": lambda core, str, socket_name=_NAME: _send(
        core, shown(str).encode() + b"\n", socket_name
    ),
}
SOCKETS: dict[str, Any] = {
    **_SEND,
    "socket_set_var": _set_var,
    "socket_close": _close,
    "socket_open": _open,
    "socket_read_binary_integer": _read_binary_integer,
    "socket_read_byte_list": _read_byte_list,
    "socket_read_ascii_float": _read_ascii_float,
    "socket_read_string": _read_string,
    "socket_read_line": _read_line,
    "socket_get_var": _get_var,
}
"""Built-ins that talk to other machines."""
