"""The dashboard server (TCP port 29999): one line a command, one line back.

The exact words that UR's software answers, from the dashboard server article; clients compare
them. A driver reads `value`; the simulated controller fills the rest in.
"""

from __future__ import annotations

PORT = 29999
"""Where controllers listen."""
GREETING = "Connected: Universal Robots Dashboard Server"
"""What a client reads first."""
STARTING, STOPPED, PAUSING = "Starting program", "Stopped", "Pausing program"
POWERING_ON, POWERING_OFF, RELEASING = "Powering on", "Powering off", "Brake releasing"
UNLOCKING = "Protective stop releasing"
UNLOCK_TOO_EARLY = (
    "Cannot unlock protective stop until 5s after occurrence. "
    "Always inspect cause of protective stop before unlocking"
)
DISCONNECTED, SHUTTING_DOWN = "Disconnected", "Shutting down"
NO_PROGRAM = "No program loaded"
LOG_SAVED = "Log saved to disk"
NO_REPORT = "Error: a simulated controller makes no flight report"
NO_SUPPORT_FILE = "Error: Failed to create support report file. Invalid target location"
_NEVER = (99, 0)
# Universal_Robots_Client_Library, src/ur/dashboard_client_implementation_g5.cpp, the table of
# commands; what is not here is as old as the dashboard.
_SINCE: dict[str, tuple[tuple[int, int], tuple[int, int]]] = {
    "version": ((5, 0), (5, 0)),
    "set operational mode": (_NEVER, (5, 0)),
    "get operational mode": (_NEVER, (5, 6)),
    "clear operational mode": (_NEVER, (5, 0)),
    "safetystatus": (_NEVER, (5, 4)),
    "restart safety": ((3, 7), (5, 1)),
    "is in remote control": (_NEVER, (5, 6)),
    "get serial number": ((3, 12), (5, 6)),
    "get robot model": ((3, 12), (5, 6)),
    "generate flight report": ((3, 13), (5, 8)),
    "generate support file": ((3, 13), (5, 8)),
    "savelog": ((3, 13), (5, 8)),
    "setuserrole": ((3, 1), _NEVER),
    "getuserrole": ((3, 1), _NEVER),
}


def known_to(command: str, version: tuple[int, int]) -> bool:
    """Whether software of a version has a command.

    Args:
        command: In small letters, without what follows it.
        version: Major and minor number.
    """
    cb, e_series = _SINCE.get(command, ((0, 0), (0, 0)))
    return version >= (cb if version[0] < 5 else e_series)


def failed(command: str) -> str:
    """The answer to a command that the robot's state forbids."""
    return f"Failed to execute: {command}"


def not_understood(line: str) -> str:
    """The answer to a line that is no command."""
    return f"could not understand: '{line}'"


def value(reply: str) -> str:
    """What a reply tells: `Robotmode: RUNNING` tells RUNNING, `true` tells true."""
    return reply.rpartition(": ")[2].strip()
