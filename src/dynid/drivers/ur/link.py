"""A connection to a UR controller: RTDE, programs and questions."""

import socket
import threading
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from statistics import median

from dynid.core import JobError
from dynid.protocol import Framer, Kind, Numbers, Packet, ProtocolError, Recipe, dashboard, rtde

CONNECT_S = 3.0
"""How long a controller may take to answer [s]."""
SILENCE_S = 2.0
"""After this long without a package the connection counts as cut [s]."""
_CHUNK = 1 << 16
_LOOKS = 10
"""Answers of which the median counts: a computer with other work is late once or twice."""
_WHO = "Check its address: is it a UR controller?"


class Disconnected(JobError):
    """The connection to the controller is gone."""


class RtdeLink:
    """A connection to one controller by RTDE, protocol 2.

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
            answer = self._ask(Kind.REQUEST_PROTOCOL_VERSION, rtde.request_protocol(2))
            if not rtde.read_answer(answer):
                raise ProtocolError("the controller has no RTDE protocol 2", where=host)
            self.version = self._ask_version()
            """Major, minor, bugfix and build number of its software."""
        except BaseException:
            self.close()
            raise

    def _ask_version(self) -> tuple[int, int, int, int]:
        reply = self._ask(Kind.GET_URCONTROL_VERSION, rtde.frame(Kind.GET_URCONTROL_VERSION))
        return rtde.read_software_version(reply)

    def answer_time(self) -> float:
        """How long the network and the controller take for an answer, median of some [s].

        Raises:
            JobError: There is none.
        """
        times: list[float] = []
        for _ in range(_LOOKS):
            asked = time.monotonic()
            self._ask_version()
            times.append(time.monotonic() - asked)
        return median(times)

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
        if not rtde.read_answer(self._ask(Kind.START, rtde.frame(Kind.START))):
            raise ProtocolError("the controller refuses to send", where=self.host)
        self.socket.settimeout(SILENCE_S)

    def packages(self) -> list[Numbers]:
        """Wait for packages; all that have arrived, in order, at least one.

        Raises:
            Disconnected: Silence, texts alone, or the end of the connection.
            JobError: Something that is no RTDE.
        """
        until = time.monotonic() + SILENCE_S
        found: list[Numbers] = []
        while not found:
            waiting, self._waiting = self._waiting, []
            for kind, payload in waiting or self._receive(until, "no package"):
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
        with _connected(_BROKE, self.host):
            self.socket.sendall(package)

    def close(self) -> None:
        """Close the connection."""
        self.socket.close()

    def _ask(self, kind: Kind, request: bytes) -> bytes:
        """Send a request and wait for its answer; what else arrives stays for later."""
        self.write(request)
        kept: list[Packet] = []
        until = time.monotonic() + CONNECT_S
        while True:
            for k, packet in enumerate(packets := self._receive(until, "no answer")):
                if packet.kind is kind:
                    self._waiting += [*kept, *packets[k + 1 :]]
                    return packet.payload
                kept.append(packet)

    def _receive(self, until: float, missing: str) -> list[Packet]:
        """Wait for packets; what is still missing after that time [s] is told."""
        packets: list[Packet] = []
        limit = f"{self.socket.gettimeout():g} s"
        while not packets:
            if time.monotonic() > until:
                what = f"what is there sends something, but {missing}"
                raise Disconnected(what, where=self.host, limit=limit, next_step=_WHO)
            with _connected(_BROKE, self.host):
                try:
                    data = self.socket.recv(_CHUNK)
                except TimeoutError as error:
                    what = "the controller sends nothing any more: the network is cut, or it is off"
                    raise Disconnected(what, where=self.host, limit=limit) from error
            if not data:
                raise Disconnected("the controller has closed the connection", where=self.host)
            try:
                packets = self._framer.feed(data)
            except ProtocolError as error:
                raise error.changed(where=self.host, next_step=_WHO) from error
        return packets


def connect(host: str, port: int) -> socket.socket:
    """A TCP connection without delay of small packets.

    Raises:
        JobError: Nobody answers there.
    """
    try:
        sock = socket.create_connection((host, port), timeout=CONNECT_S)
    except (OSError, UnicodeError) as error:
        # UnicodeError: a name that no host can have.
        raise JobError(
            f"no connection to the controller, port {port}",
            where=host,
            value=getattr(error, "strerror", None) or str(error),
            next_step="Check its address, the cable, that it is switched on, and that this service "
            "is enabled there (Settings, Security, Services).",
        ) from error
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return sock


_BROKE = "the connection to the controller broke"


@contextmanager
def _connected(fault: str, host: str) -> Generator[None]:
    """What the system says of a socket as the end of the connection, with the fault in words."""
    try:
        yield
    except OSError as error:
        raise Disconnected(f"{fault} ({error.strerror or error})", where=host) from error


SCRIPT_PORT = 30002
"""The secondary interface: takes programs, sends a state nobody here reads."""
STOP_DECELERATION = 40.0
"""How hard a stop brakes [rad/s^2]: rest from 3 rad/s in less than 0.1 s."""
STOP_PROGRAM = f"def dynid_stop():\n  stopj({STOP_DECELERATION})\nend\n"
_LINE = 4096
"""Longest answer of a dashboard [bytes]."""
_PARTING_S = 0.3
"""How long the other side may take to close [s]."""


class ScriptPort:
    """Sends programs; each one replaces the one that runs.

    The connection stays open, so that a stop need not wait for one.

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
            with _connected("the program cannot be sent", self.host):
                self._socket.settimeout(CONNECT_S)
                self._socket.sendall(program.encode("ascii"))

    def drain(self) -> None:
        """Throw away the states that the controller has sent."""
        with self._lock:
            self._drain()

    def close(self) -> None:
        """Close and wait a little for the other side: unread states take a program back."""
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

    Raises:
        JobError: Nobody answers there, or no dashboard.
    """

    def __init__(self, host: str) -> None:
        self.host = host
        self._socket = connect(host, dashboard.PORT)
        self._rest = b""
        try:
            if "Dashboard" not in (greeting := self._read()):
                raise JobError("this is no dashboard server", where=host, value=greeting)
        except BaseException:
            self.close()
            raise

    def ask(self, command: str) -> str:
        """The answer to a command.

        Raises:
            Disconnected: There is none.
        """
        with _connected("the dashboard server is gone", self.host):
            self._socket.sendall(f"{command}\n".encode())
        return self._read()

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def _read(self) -> str:
        until = time.monotonic() + CONNECT_S
        while b"\n" not in self._rest:
            if len(self._rest) > _LINE or time.monotonic() > until:
                raise Disconnected(
                    "the dashboard sends a line without an end",
                    where=self.host,
                    value=f"{len(self._rest)} bytes",
                    limit=f"{_LINE} bytes within {CONNECT_S:g} s",
                    next_step=_WHO,
                )
            with _connected("the dashboard does not answer", self.host):
                data = self._socket.recv(_CHUNK)
            if not data:
                raise Disconnected("the dashboard has closed the connection", where=self.host)
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode(errors="replace").strip()
