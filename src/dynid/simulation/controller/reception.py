"""Who comes to which port."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from dynid.protocol import dashboard, rtde
from dynid.simulation.controller.clients import (
    Client,
    DashboardClient,
    RtdeClient,
    ScriptClient,
    WatchingClient,
)
from dynid.simulation.controller.clients_interpreter import InterpreterClient
from dynid.simulation.controller.connection import Connection
from dynid.simulation.controller.dashboard import DashboardSession
from dynid.simulation.controller.doors import INTERPRETER, READ_ONLY
from dynid.simulation.controller.machine import ControllerMachine
from dynid.simulation.controller.program_files import FindProgram, no_programs
from dynid.simulation.controller.rtde import Owners, RtdeSession
from dynid.simulation.controller.script_text import Pool, ScriptReader


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
