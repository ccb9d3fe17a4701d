"""Sockets: those that listen, a client's that never blocks, what it has not read of the sent."""

import socket
import struct
import time
from collections.abc import Iterable

from dynid.core import JobError

_SOCK_DIAG, _BY_FAMILY, _REQUEST = 4, 20, 1
_TCP = 6
_HEADER = struct.Struct("=IHHII")
_QUERY = struct.Struct("=BBBxI")
_RECEIVE_QUEUE = struct.Struct("=I")
_QUEUE_AT = _HEADER.size + 4 + 48 + 4
_ANY_COOKIE = b"\xff" * 8
# Where the kernel's queue is full, a client believes itself connected and nobody knows of it.
_BACKLOG = 1024
_SEND_BUFFER = 1 << 17
LEFT = "the client has left"
_REPLIES = 1 << 16


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


def open_listeners(host: str, ports: Iterable[int]) -> list[socket.socket]:
    """Listen on the ports of a controller.

    Raises:
        JobError: A port is taken or the address is not of this machine.
    """
    listeners: list[socket.socket] = []
    for port in ports:
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # Inherited by every client's socket.
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        sock.setblocking(False)
        try:
            sock.bind((host, port))
            sock.listen(_BACKLOG)
        except OSError as error:
            sock.close()
            for listener in listeners:
                listener.close()
            raise JobError(
                f"cannot listen on port {port}: {error.strerror}",
                where=host,
                next_step="A controller may run there already; each needs an address of its own, "
                "for example --host 127.0.0.2",
            ) from error
        listeners.append(sock)
    return listeners


class Connection:
    """One client.

    What the socket does not take at once waits here, up to 64 kB; a client that lets more pile
    up does not read, and is `lost`.
    """

    def __init__(self, sock: socket.socket, peer: str) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket, self.peer = sock, peer
        self.port: int = sock.getsockname()[1]
        """Where it came to."""
        self.since = time.monotonic()
        self.silent = True
        """Whether it has not said a word yet."""
        self.lost = ""
        """Why it is to be closed; empty while it lives."""
        self.skipped = 0
        """Packages that it was too slow for."""
        self._waiting = bytearray()
        self._gathered, self._count = bytearray(), 0
        self._full_since = 0.0
        self.gone = False
        """Whether nobody is at the other end any more."""

    @property
    def full(self) -> bool:
        """Whether the socket has not taken all yet."""
        return bool(self._waiting)

    def still_full(self) -> bool:
        """Try again; whether something waits even so."""
        self.flush()
        return bool(self._waiting)

    def full_for(self, now: float) -> float:
        """Seconds for which the socket has been full without taking a byte."""
        return now - self._full_since if self._waiting else 0.0

    def receive(self, size: int) -> bytes:
        """What the client sent, up to `size` bytes; marks the connection lost at its end."""
        try:
            data = self.socket.recv(size)
        except BlockingIOError:
            return b""
        except OSError as error:
            self._broken(error)
            return b""
        if data:
            self.silent = False
        else:
            self.lost, self.gone = self.lost or LEFT, True
        return data

    def send(self, data: bytes) -> None:
        """Send, and keep what the socket does not take."""
        if self.lost or not (data or self._gathered):
            return
        self._waiting += self._gathered + data
        self._gathered.clear()
        self._count = 0
        self.flush()
        if len(self._waiting) > _REPLIES:
            self.lost = "the client does not read what it is sent"

    def offer(self, package: bytes, together: int = 1) -> bool:
        """Send the newest of a stream, so many `together`; skip it if the last has not left yet."""
        if self._waiting:
            self.flush()
        if self.lost:
            return False
        if self._waiting:
            self.skipped += 1
            return False
        self._gathered += package
        self._count += 1
        if self._count >= together:
            self.release()
        return True

    def release(self) -> None:
        """Send what was gathered."""
        self.send(b"")

    def flush(self) -> None:
        """Send what waits, as far as the socket takes it."""
        if not self._waiting or self.gone:
            return
        try:
            sent = self.socket.send(self._waiting)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            self._broken(error)
            return
        if sent or not self._full_since:
            self._full_since = time.monotonic()
        del self._waiting[:sent]
        if not self._waiting:
            self._full_since = 0.0

    def farewell(self) -> None:
        """Say that nothing follows; the client may read what it was sent before it is closed."""
        self.flush()
        self._waiting.clear()
        self.lost = ""
        try:
            self.socket.shutdown(socket.SHUT_WR)
        except OSError as error:
            self._broken(error)

    def close(self) -> None:
        """Close the connection."""
        self.socket.close()

    def _broken(self, error: OSError) -> None:
        self.lost = self.lost or f"connection broken: {error.strerror}"
        self.gone = True
