"""Programs and questions for a UR controller: its script port and its dashboard."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress

from dynid.core.errors import JobError
from dynid.drivers.ur.link import CONNECT_S, Disconnected, connect
from dynid.protocol import dashboard

SCRIPT_PORT = 30002
"""The secondary interface: takes programs, sends a state nobody here reads."""
STOP_DECELERATION = 40.0
"""How hard a stop brakes [rad/s^2]: rest from 3 rad/s in less than 0.1 s."""
STOP_PROGRAM = f"def dynid_stop():\n  stopj({STOP_DECELERATION})\nend\n"
_LINE = 4096
"""Longest answer of a dashboard [bytes]."""
_PARTING_S = 0.3
"""How long the other side may take to hang up [s]."""


class ScriptPort:
    """Sends programs; each one replaces the one that runs.

    The connection stays open, so that a stop need not wait for one.

    Args:
        host: Name or address of the controller.

    Raises:
        JobError: Nobody answers there.
    """

    def __init__(self, host: str) -> None:
        self.host = host
        self._socket = connect(host, SCRIPT_PORT)
        self._lock = threading.Lock()

    def send(self, program: str) -> None:
        """Send a program.

        Raises:
            Disconnected: The connection is gone.
        """
        with self._lock:
            self._drain()
            try:
                self._socket.settimeout(CONNECT_S)
                self._socket.sendall(program.encode("ascii"))
            except OSError as error:
                raise Disconnected(
                    "the program cannot be sent", where=self.host, value=error.strerror
                ) from error

    def drain(self) -> None:
        """Throw away the states that the controller has sent."""
        with self._lock:
            self._drain()

    def close(self) -> None:
        """Hang up and wait a little for the other side: unread states take a program back."""
        with self._lock:
            with suppress(OSError):
                self._socket.shutdown(socket.SHUT_WR)
                until = time.monotonic() + _PARTING_S
                self._socket.settimeout(_PARTING_S)
                while time.monotonic() < until and self._socket.recv(1 << 16):
                    pass
            self._socket.close()

    def _drain(self) -> None:
        self._socket.settimeout(0.0)
        with suppress(OSError):
            while self._socket.recv(1 << 16):
                pass


class Dashboard:
    """Asks the dashboard server, one line at a time.

    Args:
        host: Name or address of the controller.

    Raises:
        JobError: Nobody answers there, or no dashboard.
    """

    def __init__(self, host: str) -> None:
        self.host = host
        self._socket = connect(host, dashboard.PORT)
        self._stream = self._socket.makefile("rb")
        greeting = self._read()
        if "Dashboard" not in greeting:
            self.close()
            raise JobError("this is no dashboard server", where=host, value=greeting)

    def ask(self, command: str) -> str:
        """The answer to a command.

        Raises:
            Disconnected: There is none.
        """
        try:
            self._socket.sendall(f"{command}\n".encode())
        except OSError as error:
            raise Disconnected(
                "the dashboard has gone", where=self.host, value=error.strerror
            ) from error
        return self._read()

    def close(self) -> None:
        """Hang up."""
        self._stream.close()
        self._socket.close()

    def _read(self) -> str:
        try:
            line = self._stream.readline(_LINE)
        except OSError as error:
            raise Disconnected(
                "the dashboard does not answer", where=self.host, value=error.strerror or str(error)
            ) from error
        if not line:
            raise Disconnected("the dashboard has hung up", where=self.host)
        return line.decode(errors="replace").strip()
