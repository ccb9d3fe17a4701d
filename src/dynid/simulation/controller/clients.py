"""The clients of the controller: what each does with the bytes it gets."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from dynid.core import DynidError
from dynid.protocol import dashboard
from dynid.simulation.controller.connection import LEFT, Connection
from dynid.simulation.controller.dashboard import DashboardSession
from dynid.simulation.controller.rtde import RtdeSession
from dynid.simulation.controller.script_text import ScriptReader
from dynid.simulation.controller.unread import question


class Client(ABC):
    """One connected client.

    Args:
        connection: Its socket.
        port: The port that it came to.
    """

    read_size = 1024
    """Bytes taken at once: little, so that no client delays a cycle."""

    def __init__(self, connection: Connection, port: int) -> None:
        self.connection, self.port = connection, port
        self.regret = ""
        """What went wrong for it though nobody sent it away."""

    @property
    def greeting(self) -> bytes:
        """What it reads first."""
        return b""

    def readable(self) -> None:
        """The socket has something."""
        data = self.connection.receive(self.read_size)
        if not data:
            return
        try:
            self.take(data)
        except DynidError as error:
            self.refuse(str(error))

    @abstractmethod
    def take(self, data: bytes) -> None:
        """Do what the client asks for.

        Raises:
            DynidError: It asks for what nobody can give: it is refused and closed.
        """

    def refuse(self, words: str) -> None:
        """Tell the client why it is closed, and close it."""
        self.connection.send(self.in_words(words))
        self.connection.lost = self.connection.lost or words

    def in_words(self, words: str) -> bytes:
        """A text in the client's protocol; empty where that knows none."""
        return b""

    def left(self) -> None:
        """The client is gone: free what it held."""
        self.connection.silent = False


class RtdeClient(Client):
    """A client of port 30004.

    Args:
        connection: Its socket.
        port: The port that it came to.
        session: Its session.
    """

    def __init__(self, connection: Connection, port: int, session: RtdeSession) -> None:
        super().__init__(connection, port)
        self.session = session
        self.question = question(connection.socket)

    def take(self, data: bytes) -> None:
        """Answer requests, write inputs."""
        self.connection.send(self.session.receive(data))

    def in_words(self, words: str) -> bytes:
        """An RTDE text message."""
        return self.session.text(words)

    def left(self) -> None:
        """Others may write its inputs."""
        self.session.close()


class DashboardClient(Client):
    """A client of port 29999.

    Args:
        connection: Its socket.
        port: The port that it came to.
        session: Its session.
    """

    def __init__(self, connection: Connection, port: int, session: DashboardSession) -> None:
        super().__init__(connection, port)
        self.session = session

    @property
    def greeting(self) -> bytes:
        """The line that ur_rtde waits for."""
        return self.in_words(dashboard.GREETING)

    def take(self, data: bytes) -> None:
        """Answer each line."""
        for reply in self.session.receive(data):
            self.connection.send(self.in_words(reply))
        if self.session.over:
            self.connection.lost = self.connection.lost or "the client said goodbye"

    def in_words(self, words: str) -> bytes:
        """A line."""
        return words.encode() + b"\n"


class WatchingClient(Client):
    """A client of port 30011, 30012 or 30013: it reads states; what it sends is not looked at."""

    introduced = False
    """Whether it was told of the arm itself."""

    def take(self, data: bytes) -> None:
        """Throw it away."""


class ScriptClient(WatchingClient):
    """A client of port 30001, 30002 or 30003: it reads states and may send programs.

    Args:
        connection: Its socket.
        port: The port that it came to.
        reader: Finds programs in what it sends.
        submit: Takes a whole program.
    """

    read_size = 8192

    def __init__(
        self,
        connection: Connection,
        port: int,
        reader: ScriptReader,
        submit: Callable[[str], None],
    ) -> None:
        super().__init__(connection, port)
        self._reader, self._submit = reader, submit

    def readable(self) -> None:
        """The socket has something; what was sent before the end of the connection counts."""
        super().readable()
        if self.connection.lost == LEFT:
            try:
                self._run(self._reader.finish())
            except DynidError as error:
                self.regret = str(error)
        if self.connection.gone and self._reader.unfinished:
            # Closing a socket with something to read in it breaks the connection: what was
            # sent and not yet read is lost.
            self.regret = f"{self.connection.lost} in the middle of a program; it is not run"

    def take(self, data: bytes) -> None:
        """Collect text, and run what is whole."""
        self._run(self._reader.feed(data))

    def left(self) -> None:
        """Give the memory of an unfinished program back."""
        self._reader.close()

    def _run(self, programs: list[str]) -> None:
        for program in programs:
            self._submit(program)


class LeavingClient(Client):
    """One that was sent away: what it still sends is thrown away until it hangs up.

    To close at once would take the words from it that say why.

    Args:
        connection: Its socket.
        port: The port that it came to.
        until: When it is closed even if it stays [s].
    """

    read_size = 1 << 16

    def __init__(self, connection: Connection, port: int, until: float) -> None:
        super().__init__(connection, port)
        self.until = until
        connection.farewell()

    def take(self, data: bytes) -> None:
        """Throw it away."""
