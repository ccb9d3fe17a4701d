"""How much of what was sent the client has not read yet; Linux, both ends on this machine."""

from __future__ import annotations

import socket
import struct

_SOCK_DIAG, _BY_FAMILY, _REQUEST = 4, 20, 1
_TCP = 6
_HEADER = struct.Struct("=IHHII")
_QUERY = struct.Struct("=BBBxI")
_RECEIVE_QUEUE = struct.Struct("=I")
_QUEUE_AT = _HEADER.size + 4 + 48 + 4
_ANY_COOKIE = b"\xff" * 8


class UnreadBytes:
    """Asks the kernel (`sock_diag(7)`, some 15 us a question).

    Where the kernel does not answer, or the client is on another machine, nothing counts as
    unread: then a client is served as far ahead as its socket's buffers reach.
    """

    def __init__(self) -> None:
        self._link: socket.socket | None = None
        if hasattr(socket, "AF_NETLINK"):
            try:
                self._link = socket.socket(socket.AF_NETLINK, socket.SOCK_DGRAM, _SOCK_DIAG)
                self._link.settimeout(0.1)
            except OSError:
                self._link = None

    def of(self, question: bytes) -> int:
        """Bytes that the client of a `question` has not read [bytes]."""
        if self._link is None:
            return 0
        try:
            self._link.send(question)
            answer = self._link.recv(4096)
        except OSError:
            self._link.close()
            self._link = None
            return 0
        known = len(answer) >= _QUEUE_AT + 4 and _HEADER.unpack_from(answer)[1] == _BY_FAMILY
        return int(_RECEIVE_QUEUE.unpack_from(answer, _QUEUE_AT)[0]) if known else 0

    def close(self) -> None:
        """Let the kernel go."""
        if self._link is not None:
            self._link.close()


def question(sock: socket.socket) -> bytes:
    """The question after the other end of an IPv4 connection."""
    (here, port), (there, peer) = sock.getsockname()[:2], sock.getpeername()[:2]
    ends = struct.pack(">HH", peer, port)
    addresses = b"".join(socket.inet_aton(address) + bytes(12) for address in (there, here))
    body = _QUERY.pack(socket.AF_INET, _TCP, 0, 0xFFFFFFFF) + ends + addresses
    body += bytes(4) + _ANY_COOKIE
    return _HEADER.pack(_HEADER.size + len(body), _BY_FAMILY, _REQUEST, 0, 0) + body
