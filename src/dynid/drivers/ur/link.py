"""A connection to a controller's RTDE server."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from dynid.core.errors import JobError
from dynid.protocol import rtde
from dynid.protocol.framing import Framer, Kind, Packet, ProtocolError
from dynid.protocol.recipe import Numbers, Recipe

CONNECT_S = 3.0
"""How long a controller may take to answer [s]."""
SILENCE_S = 2.0
"""After this long without a package the connection counts as cut [s]."""
_CHUNK = 1 << 16


class Disconnected(JobError):
    """The connection to the controller is gone."""


class RtdeLink:
    """Speaks RTDE, protocol 2, with one controller.

    Args:
        host: Name or address of the controller.
        port: Its RTDE port.

    Raises:
        JobError: Nobody answers there, or not in RTDE.
    """

    def __init__(self, host: str, port: int = rtde.PORT) -> None:
        self.host = host
        self._framer = Framer()
        self._waiting: list[Packet] = []
        self._recipe = Recipe((), ())
        self.messages: list[str] = []
        """What the controller said to people."""
        self.socket = connect(host, port)
        try:
            if not rtde.read_answer(
                self._ask(Kind.REQUEST_PROTOCOL_VERSION, rtde.request_protocol(2))
            ):
                raise ProtocolError("the controller does not speak RTDE 2", where=host)
            reply = self._ask(Kind.GET_URCONTROL_VERSION, rtde.request_software_version())
            self.version = rtde.read_software_version(reply)
            """Major, minor, bugfix and build number of its software."""
        except BaseException:
            self.close()
            raise

    @property
    def rate_hz(self) -> float:
        """Control cycles a second: 500 on e-Series, 125 before."""
        return 500.0 if self.version[0] >= 5 else 125.0

    def ask_outputs(self, names: Sequence[str]) -> Recipe:
        """Choose what each package brings, one package a control cycle.

        Raises:
            JobError: The controller has no such variable.
        """
        reply = self._ask(Kind.SETUP_OUTPUTS, rtde.request_outputs(names, self.rate_hz))
        number, types = rtde.read_setup_answer(Kind.SETUP_OUTPUTS, reply, 2)
        self._recipe = Recipe.of(names, types, number)
        return self._recipe

    def ask_inputs(self, names: Sequence[str]) -> Recipe:
        """Claim inputs to write.

        Raises:
            JobError: The controller has no such input, or another program writes it.
        """
        reply = self._ask(Kind.SETUP_INPUTS, rtde.request_inputs(names))
        number, types = rtde.read_setup_answer(Kind.SETUP_INPUTS, reply, 2)
        return Recipe.of(names, types, number)

    def start(self) -> None:
        """Let the packages come; they must be read from now on.

        Raises:
            JobError: The controller refuses (`ProtocolError`), or is gone.
        """
        if not rtde.read_answer(self._ask(Kind.START, rtde.request_start())):
            raise ProtocolError("the controller refuses to send", where=self.host)
        self.socket.settimeout(SILENCE_S)

    def packages(self) -> list[Numbers]:
        """Wait for packages; all that have arrived, in order.

        Raises:
            Disconnected: Silence, or the end of the connection.
            JobError: Something that is no RTDE.
        """
        waiting, self._waiting = self._waiting, []
        packets = waiting or self._receive()
        found: list[Numbers] = []
        for kind, payload in packets:
            if kind is Kind.DATA_PACKAGE:
                found.append(self._recipe.numbers(payload))
            elif kind is Kind.TEXT_MESSAGE:
                self.messages.append(rtde.read_text_message(payload, 2).message)
        return found

    def write(self, package: bytes) -> None:
        """Send a package of inputs.

        Raises:
            Disconnected: The connection is gone.
        """
        try:
            self.socket.sendall(package)
        except OSError as error:
            raise Disconnected(_gone(error), where=self.host) from error

    def close(self) -> None:
        """Hang up."""
        self.socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _ask(self, kind: Kind, request: bytes) -> bytes:
        """Send a request and wait for its answer; what else arrives stays for later."""
        self.write(request)
        kept: list[Packet] = []
        while True:
            for k, packet in enumerate(packets := self._receive()):
                if packet.kind is kind:
                    self._waiting += [*kept, *packets[k + 1 :]]
                    return packet.payload
                kept.append(packet)

    def _receive(self) -> list[Packet]:
        while True:
            try:
                data = self.socket.recv(_CHUNK)
            except TimeoutError as error:
                raise Disconnected(
                    "the controller has fallen silent: the network is cut, or it is dead",
                    where=self.host,
                    limit=f"{self.socket.gettimeout()} s",
                ) from error
            except OSError as error:
                raise Disconnected(_gone(error), where=self.host) from error
            if not data:
                raise Disconnected("the controller has closed the connection", where=self.host)
            if packets := self._framer.feed(data):
                return packets


def connect(host: str, port: int) -> socket.socket:
    """A TCP connection without delay of small packets.

    Raises:
        JobError: Nobody answers there.
    """
    try:
        sock = socket.create_connection((host, port), timeout=CONNECT_S)
    except OSError as error:
        raise JobError(
            f"no connection to the controller, port {port}",
            where=host,
            value=error.strerror or str(error),
            next_step="Check its address, the cable, and that it is switched on.",
        ) from error
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return sock


def _gone(error: OSError) -> str:
    return f"the connection to the controller broke ({error.strerror or error})"
