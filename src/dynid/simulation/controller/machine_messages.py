"""What a controller says: to its screen, its log and the clients of port 30001."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

PROGRAM_STARTED, PROGRAM_STOPPED = "PROGRAM_XXX_STARTED", "PROGRAM_XXX_STOPPED"
"""Titles by which clients know that a program began or ended."""


class MessageKind(Enum):
    """What sort of message it is."""

    TEXT = "a text"
    KEY = "the beginning or the end of a program; the title tells which"
    POPUP = "a window on the screen"
    EXCEPTION = "what is wrong with a script; the title is UR's name for it"
    STOP = "a stop by the safety system"
    NOTE = "what a real controller would not say; for people beside the simulated one"


@dataclass(frozen=True, slots=True, kw_only=True)
class Message:
    """Something for the screen or the log of the controller."""

    text: str
    source: str
    """`program`, `safety` or `controller`."""
    level: int
    """As in RTDE: 0 exception, 1 error, 2 warning, 3 information."""
    timestamp: float
    """Controller time [s]."""
    kind: MessageKind = MessageKind.TEXT
    title: str = ""
    """What stands above the text."""
    line: int = 0
    """Of an exception: the line of the script, from one; 0 where it has none."""
    blocking: bool = False
    """Of a window: whether the program waits until it is closed."""

    @property
    def words(self) -> str:
        """All of it in one line, for people."""
        return f"{self.title}: {self.text}" if self.title and not self.line else self.text
