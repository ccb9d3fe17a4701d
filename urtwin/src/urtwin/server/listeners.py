"""The settings of a controller, its ports, and which client a port serves.

Where a port is full, who has been silent for longest makes room.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from dynid.core import InputError, JobError
from dynid.protocol import dashboard, rtde
from dynid.simulation import Thermal
from urtwin.dashboard import DashboardSession, FindProgram, program_folder
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
_SERIAL = "20240001"
"""What the dashboard says."""
CB_HZ, E_SERIES_HZ = 125.0, 500.0


def open_listeners(host: str) -> list[socket.socket]:
    """Listen on all ports of a controller.

    Raises:
        JobError: A port is taken or the address is not of this machine.
    """
    listeners: list[socket.socket] = []
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
                listener.close()
            raise JobError(
                f"cannot listen on port {port}: {error.strerror}",
                where=host,
                next_step="A controller may run there already; each needs an address of its own, "
                "for example --host 127.0.0.2",
            ) from error
        listeners.append(sock)
    return listeners


def place_for_another(clients: Iterable[Client], now: float) -> tuple[bool, Client | None]:
    """Whether one more client of a port may come in, and who has to leave for it.

    A full port gives up the client that has been connected for longest without a word. `now` is
    the monotonic clock [s].
    """
    present = list(clients)
    if len(present) < CLIENTS:
        return True, None
    silent = [c for c in present if c.connection.silent and now - c.connection.since > NEWCOMER_S]
    if not silent:
        return False, None
    return True, min(silent, key=lambda client: client.connection.since)


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerSettings:
    """What to simulate, and where.

    Raises:
        InputError: A control rate that no UR controller has.
    """

    robot: str = "ur5"
    """Built-in name, URDF or robot file."""
    host: str = "127.0.0.1"
    """Address to listen on."""
    thermal: Thermal = "cold"
    """Temperatures at the start."""
    virtual_time: bool = False
    """Whether time goes as fast as the clients read."""
    hold: bool = False
    """Whether time stands still until the first client has started RTDE."""
    seed: int = 0
    """Seed of the measurement noise."""
    rate_hz: float | None = None
    """Control cycles a second; None: 500 for robots whose name ends in `e`, else 125."""
    version: tuple[int, int, int] | None = None
    """Software version; None: the one usual for the rate."""
    truth: Path | None = None
    """Where to write the truth behind the measurements."""
    report: Path | None = None
    """Where to write, at the end, how well time was kept."""
    programs: Path | None = None
    """Folder of the programs that the dashboard can load."""
    parent: int | None = None
    """The process without which the controller ends; None: it stays."""

    def __post_init__(self) -> None:
        if self.rate_hz is not None and self.rate_hz not in (CB_HZ, E_SERIES_HZ):
            raise InputError(
                "no UR controller has this control rate",
                value=f"{self.rate_hz:g} Hz",
                limit=f"{CB_HZ:g} Hz (CB-Series) or {E_SERIES_HZ:g} Hz (e-Series)",
            )


class Reception:
    """Makes clients of connections; `submit` takes the programs of script ports."""

    def __init__(
        self,
        machine: ControllerMachine,
        settings: ControllerSettings,
        submit: Callable[[str], None],
    ) -> None:
        self._machine, self._submit, self._orderly = machine, submit, settings.virtual_time
        self._owners, self._pool = Owners(), Pool()
        self._model = machine.core.arm.plant.arm.robot.name.removesuffix("e").upper()
        folder = settings.programs
        self._programs: FindProgram = program_folder(folder) if folder else lambda _: None

    def client(self, connection: Connection) -> Client:
        """The client behind a connection."""
        machine, port = self._machine, connection.port
        if port == rtde.PORT:
            session = RtdeSession(machine, self._owners, orderly=self._orderly)
            return RtdeClient(connection, session)
        if port == dashboard.PORT:
            desk = DashboardSession(machine, self._model, _SERIAL, self._programs)
            return DashboardClient(connection, desk)
        if port == INTERPRETER:
            return InterpreterClient(connection, machine.core.interpreter)
        if port in READ_ONLY:
            return WatchingClient(connection)
        return ScriptClient(connection, ScriptReader(self._pool), self._submit)
