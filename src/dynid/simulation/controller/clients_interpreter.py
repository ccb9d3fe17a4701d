"""A client of port 30020: a line is a statement or a command of interpreter mode."""

from __future__ import annotations

from dynid.core import JobError
from dynid.simulation.controller.clients import Client
from dynid.simulation.controller.connection import Connection
from dynid.simulation.controller.machine_interpreter import Interpreter

LONGEST_LINE = 65_536
"""The longest line taken [bytes]."""


class InterpreterClient(Client):
    """One connected client.

    Args:
        connection: Its socket.
        port: The port that it came to.
        interpreter: Takes its lines.
    """

    def __init__(self, connection: Connection, port: int, interpreter: Interpreter) -> None:
        super().__init__(connection, port)
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
                self._interpreter.receive(text, self._answer)

    def in_words(self, words: str) -> bytes:
        """A line."""
        return words.encode() + b"\n"

    def _answer(self, words: str) -> None:
        self.connection.send(self.in_words(words))
