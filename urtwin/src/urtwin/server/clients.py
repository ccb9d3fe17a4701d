"""The clients of the controller: what each does with the bytes that it sends."""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable

from dynid.core import DynidError, JobError
from dynid.protocol import dashboard, rtde
from urtwin.dashboard import DashboardSession, FindProgram, program_folder
from urtwin.interpreter import Interpreter
from urtwin.machine import ControllerMachine
from urtwin.rtde import Owners, RtdeSession
from urtwin.server.connection import LEFT, Connection, question
from urtwin.settings import INTERPRETER, READ_ONLY, ControllerSettings

LARGEST_SCRIPT = 2_000_000
"""The longest program taken [bytes]."""
POOL = 8_000_000
"""Unfinished programs of all clients together [bytes]."""
_WORD = re.compile(
    rb"""\b(?P<opens>def|sec|thread|if|while)\b|\b(?P<ends>end)\b|"[^"\n]*"?|'[^'\n]*'?|\#.*""",
    re.VERBOSE,
)
_LONGEST_KEYWORD = 6
_CODE = re.compile(rb"^[^#\w\"'\n]*[\w\"']", re.MULTILINE)
LONGEST_LINE = 65_536
"""The longest line taken [bytes]."""
_SERIAL = "20240001"
"""What the dashboard says."""


class ScriptRefused(JobError):
    """A client sent what can be no program, or too much; the connection is to be closed."""


class Pool:
    """Memory [bytes] that all clients share for programs that are not complete."""

    def __init__(self, size: int = POOL) -> None:
        self.size, self.taken = size, 0

    def take(self, count: int) -> None:
        """Take room for `count` bytes, or be refused; a negative count gives it back."""
        if self.taken + count > self.size:
            raise ScriptRefused(
                "too many unfinished programs at once", limit=f"{self.size} bytes together"
            )
        self.taken += count


class ScriptReader:
    """Collects text until its blocks are closed.

    A program is `def` to its `end`, or a single line of code. A string ends with its line at the
    latest; the compiler will say so. Every byte is looked at once, however the text is cut.
    """

    def __init__(self, pool: Pool, largest: int = LARGEST_SCRIPT) -> None:
        self._pool, self._largest = pool, largest
        self._text = bytearray()
        self._counted = self._searched = self._depth = 0

    def feed(self, data: bytes) -> list[str]:
        """Take text; the programs that it completes. What is too long or no text is refused."""
        self._pool.take(len(data))
        self._text += data
        programs: list[str] = []
        while (end := self._text.find(b"\n", self._searched) + 1) > 0:
            self._count(end)
            self._counted = self._searched = end
            if self._depth <= 0:
                program = bytes(self._text[:end])
                del self._text[:end]
                self._pool.take(-end)
                self._counted = self._searched = self._depth = 0
                if _CODE.search(program):
                    programs.append(_decoded(program))
        self._searched = len(self._text)
        self._count(self._searched + 1)
        if len(self._text) > self._largest:
            raise ScriptRefused(
                "the program is too long; its blocks are not closed yet",
                value=f"{len(self._text)} bytes",
                limit=f"{self._largest} bytes",
            )
        return programs

    def _count(self, end: int) -> None:
        """Count the blocks that are opened before a line end; the last word may not be whole."""
        last = len(self._text)
        for word in _WORD.finditer(self._text, self._counted, end):
            if word.end() == last:
                self._counted = word.start()
                return
            self._counted = word.end()
            self._depth += (word["opens"] is not None) - (word["ends"] is not None)
        self._counted = max(self._counted, last - _LONGEST_KEYWORD)

    @property
    def unfinished(self) -> bool:
        """Whether there is code that is no whole program yet."""
        return _CODE.search(self._text) is not None

    def close(self) -> None:
        """Give the memory back."""
        self._pool.take(-len(self._text))
        self._text = bytearray()


def _decoded(program: bytes) -> str:
    try:
        return program.decode()
    except UnicodeDecodeError as error:
        raise ScriptRefused(
            "this is no program: it is not UTF-8 text", value=program[:40]
        ) from error


class Client(ABC):
    """One connected client."""

    read_size = 1024
    """Bytes taken at once: little, so that no client delays a cycle."""
    greeting = b""
    """What it reads first."""

    def __init__(self, connection: Connection) -> None:
        self.connection, self.port = connection, connection.port
        self.regret = ""
        """What went wrong for it though nobody sent it away."""

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
        """Do what the client asks for; after a `DynidError` it is refused and closed."""

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
    """A client of port 30004."""

    def __init__(self, connection: Connection, session: RtdeSession) -> None:
        super().__init__(connection)
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


class LineClient(Client):
    """A client whose protocol is lines of text."""

    def in_words(self, words: str) -> bytes:
        """A line."""
        return words.encode() + b"\n"

    def answer(self, words: str) -> None:
        """Send a line."""
        self.connection.send(self.in_words(words))


class DashboardClient(LineClient):
    """A client of port 29999; ur_rtde waits for the greeting."""

    greeting = dashboard.GREETING.encode() + b"\n"

    def __init__(self, connection: Connection, session: DashboardSession) -> None:
        super().__init__(connection)
        self._session = session

    def take(self, data: bytes) -> None:
        """Answer each line."""
        for reply in self._session.receive(data):
            self.answer(reply)
        if self._session.over:
            self.connection.lost = self.connection.lost or "the client said goodbye"


class WatchingClient(Client):
    """A client of port 30011, 30012 or 30013: it reads states; what it sends is not looked at."""

    introduced = False
    """Whether it was told of the arm itself."""

    def take(self, data: bytes) -> None:
        """Throw it away."""


class ScriptClient(WatchingClient):
    """A client of port 30001, 30002 or 30003: it reads states and may send programs."""

    read_size = 8192

    def __init__(
        self,
        connection: Connection,
        reader: ScriptReader,
        submit: Callable[[str], None],
    ) -> None:
        super().__init__(connection)
        self._reader, self._submit = reader, submit

    def readable(self) -> None:
        """The socket has something; what was sent before the end of the connection counts."""
        super().readable()
        if self.connection.lost == LEFT:
            # What it sent last needs no line end.
            try:
                self.take(b"\n")
            except DynidError as error:
                self.regret = str(error)
        if self.connection.gone and self._reader.unfinished:
            # Closing a socket with something to read in it breaks the connection: what was
            # sent and not yet read is lost.
            self.regret = f"{self.connection.lost} in the middle of a program; it is not run"

    def take(self, data: bytes) -> None:
        """Collect text, and run what is whole."""
        for program in self._reader.feed(data):
            self._submit(program)

    def left(self) -> None:
        """Give the memory of an unfinished program back."""
        self._reader.close()


class LeavingClient(Client):
    """One that was sent away: it may read on until it hangs up, or time is up.

    To close at once would take the words from it that say why. What it sends is thrown away.
    """

    read_size = 1 << 16

    def __init__(self, connection: Connection, until: float) -> None:
        super().__init__(connection)
        self.until = until
        connection.farewell()

    def take(self, data: bytes) -> None:
        """Throw it away."""


class InterpreterClient(LineClient):
    """A client of port 30020."""

    def __init__(self, connection: Connection, interpreter: Interpreter) -> None:
        super().__init__(connection)
        self._interpreter = interpreter
        self._rest = b""

    def take(self, data: bytes) -> None:
        """Hand on whole lines; a line that is empty asks for nothing."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST_LINE:
            raise JobError("no statement is that long", limit=f"{LONGEST_LINE} bytes")
        for line in lines:
            text = line.decode(errors="replace").strip()
            if text:
                self._interpreter.receive(text, self.answer)


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
