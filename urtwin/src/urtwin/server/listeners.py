"""The listening ports, who is accepted when they are full, and which client a port serves."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from dynid.core import JobError
from dynid.protocol import dashboard, rtde
from urtwin.dashboard import DashboardSession, FindProgram, no_programs
from urtwin.machine import ControllerMachine
from urtwin.rtde import Owners, RtdeSession
from urtwin.server.clients import (
    Client,
    DashboardClient,
    InterpreterClient,
    Pool,
    RtdeClient,
    ScriptClient,
    ScriptReader,
    WatchingClient,
)
from urtwin.server.connection import Connection

CLIENTS = 128
"""Clients of one port at the same time."""
NEWCOMER_S = 1.0
"""How long a client may be silent before its place can be given to another [s]."""
PRIMARY, SECONDARY, REALTIME = 30001, 30002, 30003
INTERPRETER = 30020
"""Takes statements for the running program while it is in interpreter mode."""
READ_ONLY = {30011: PRIMARY, 30012: SECONDARY, 30013: REALTIME}
"""Ports that send what another does, and do not listen."""
PORTS = (dashboard.PORT, PRIMARY, SECONDARY, REALTIME, rtde.PORT, INTERPRETER, *READ_ONLY)
"""The ports of a UR controller; clients cannot be told others."""
# Where the kernel's queue is full, a client believes itself connected and nobody knows of it.
_BACKLOG = 1024
_SEND_BUFFER = 1 << 17


@dataclass(frozen=True, slots=True)
class Listener:
    """One listening port."""

    socket: socket.socket
    """The listening socket."""
    port: int
    """Its number."""

    def accept(self) -> tuple[socket.socket, str] | None:
        """The next client and its address, if one waits."""
        try:
            sock, (host, port, *_) = self.socket.accept()
        except OSError:
            return None
        return sock, f"{host}:{port}"


def open_listeners(host: str) -> list[Listener]:
    """Listen on all ports of a controller.

    Args:
        host: The address to listen on.

    Raises:
        JobError: A port is taken or the address is not of this machine.
    """
    listeners: list[Listener] = []
    for port in PORTS:
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
                listener.socket.close()
            raise JobError(
                f"cannot listen on port {port}: {error.strerror}",
                where=host,
                next_step="A controller may run there already; each needs an address of its own, "
                "for example --host 127.0.0.2",
            ) from error
        listeners.append(Listener(sock, port))
    return listeners


def place_for_another(clients: Iterable[Client], now: float) -> tuple[bool, Client | None]:
    """Whether one more client of a port may come in, and who has to leave for it.

    A full port gives up the client that has been connected for longest without a word.

    Args:
        clients: The clients of the port.
        now: The monotonic clock [s].
    """
    present = list(clients)
    if len(present) < CLIENTS:
        return True, None
    silent = [c for c in present if c.connection.silent and now - c.connection.since > NEWCOMER_S]
    if not silent:
        return False, None
    return True, min(silent, key=lambda client: client.connection.since)


@dataclass(frozen=True, slots=True, kw_only=True)
class ServerSettings:
    """How the controller shows itself."""

    host: str = "127.0.0.1"
    """Address to listen on."""
    virtual: bool = False
    """Whether time goes as fast as the clients read."""
    hold: bool = False
    """Whether time stands still until the first client has started RTDE."""
    model: str = "UR5"
    """What the dashboard says the robot is."""
    serial: str = "20240001"
    """Its serial number."""
    programs: FindProgram = no_programs
    """Finds the programs that the dashboard can load."""


class Reception:
    """Makes clients of connections.

    Args:
        machine: The controller.
        settings: How it shows itself.
        submit: Takes the programs of script ports.
    """

    def __init__(
        self, machine: ControllerMachine, settings: ServerSettings, submit: Callable[[str], None]
    ) -> None:
        self._machine, self._settings, self._submit = machine, settings, submit
        self._owners, self._pool = Owners(), Pool()

    def client(self, connection: Connection, port: int) -> Client:
        """The client behind a connection to a port."""
        machine, settings = self._machine, self._settings
        if port == rtde.PORT:
            session = RtdeSession(machine, self._owners, orderly=settings.virtual)
            return RtdeClient(connection, port, session)
        if port == dashboard.PORT:
            desk = DashboardSession(machine, settings.model, settings.serial, settings.programs)
            return DashboardClient(connection, port, desk)
        if port == INTERPRETER:
            return InterpreterClient(connection, port, machine.core.interpreter)
        if port in READ_ONLY:
            return WatchingClient(connection, port)
        return ScriptClient(connection, port, ScriptReader(self._pool), self._submit)
