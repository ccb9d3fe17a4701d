"""The sockets that a program opens to other machines: by name, never waiting."""

import errno
import ipaddress
import socket
from collections.abc import Callable

SOCKETS = 16
"""Most sockets of a program."""
BUFFER = 1 << 16
"""Most bytes that wait on either side of a socket."""
_CONNECTING = (errno.EINPROGRESS, errno.EALREADY)
_PIECE = 4096


def on_this_machine(host: str) -> bool:
    """Whether an IPv4 address leads to this machine."""
    try:
        address = ipaddress.IPv4Address(host)
    except ValueError:
        return False
    if address.is_loopback:
        return True
    if address.is_multicast or address.is_unspecified:
        return False
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as sock:
        try:
            # Only an address of one's own can be bound to.
            sock.bind((host, 0))
        except OSError:
            return False
    return True


class Link:
    """One socket to an IPv4 address and a TCP port; what it received waits in `data`."""

    def __init__(self, host: str, port: int) -> None:
        self.data = bytearray()
        self.open = False
        """Whether it is connected."""
        self.opening = True
        self._unsent = bytearray()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._address = host, port
        self._connect()

    def poll(self) -> None:
        """See to the connection, and take what has come."""
        if self.opening:
            self._connect()
        if not self.open:
            return
        self._flush()
        while len(self.data) < BUFFER:
            try:
                piece = self._socket.recv(_PIECE)
            except BlockingIOError:
                return
            except OSError:
                piece = b""
            if not piece:
                self.open = False
                return
            self.data += piece
            if len(piece) < _PIECE:
                return

    def send(self, data: bytes) -> bool:
        """Send; whether the other side can still get it."""
        if not self.open or len(self._unsent) + len(data) > BUFFER:
            return False
        self._unsent += data
        self._flush()
        return self.open

    def take(self, count: int) -> bytes | None:
        """So many bytes, once they are all there."""
        if len(self.data) < count:
            return None
        found = bytes(self.data[:count])
        del self.data[:count]
        return found

    def close(self) -> None:
        """Close the connection."""
        self.open = self.opening = False
        self._socket.close()

    def _connect(self) -> None:
        state = self._socket.connect_ex(self._address)
        self.opening, self.open = state in _CONNECTING, state in (0, errno.EISCONN)

    def _flush(self) -> None:
        if not self._unsent:
            return
        try:
            del self._unsent[: self._socket.send(self._unsent)]
        except BlockingIOError:
            return
        except OSError:
            self.open = False


class Network:
    """The sockets of the running program; `allowed` tells to which addresses it may connect."""

    def __init__(self, allowed: Callable[[str], bool]) -> None:
        self._allowed = allowed
        self.listening = False
        """Whether a thread has waited for a socket in this cycle."""
        self.reads = 0
        """What threads have got from sockets in this cycle."""
        self.late = False
        """Whether this cycle is one of several that are caught up."""
        self._links: dict[str, Link] = {}

    def open(self, name: str, host: str, port: int) -> Link | str:
        """Begin to connect; one that had the name is closed. The socket, or why there is none."""
        self.close(name)
        address = "127.0.0.1" if host == "localhost" else host
        if not self._allowed(address):
            return "programs of a controller on a loopback address connect to this machine only"
        if len(self._links) >= SOCKETS:
            return f"no more than {SOCKETS} sockets"
        try:
            link = Link(address, port)
        except (OSError, OverflowError) as error:
            return str(error)
        self._links[name] = link
        return link

    def link(self, name: str) -> Link | None:
        """The socket of a name, up to date; None if there is none."""
        link = self._links.get(name)
        if link is not None:
            link.poll()
        return link

    def close(self, name: str) -> bool:
        """Close it; whether there was such a socket."""
        link = self._links.pop(name, None)
        if link is not None:
            link.close()
        return link is not None

    def close_all(self) -> None:
        """The program is over."""
        self.listening = False
        for name in list(self._links):
            self.close(name)
