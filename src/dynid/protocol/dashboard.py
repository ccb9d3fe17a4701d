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


def failed(command: str) -> str:
    """The answer to a command that the robot's state forbids."""
    return f"Failed to execute: {command}"


def not_understood(line: str) -> str:
    """The answer to a line that is no command."""
    return f"could not understand: '{line}'"


def value(reply: str) -> str:
    """What a reply tells: `Robotmode: RUNNING` tells RUNNING, `true` tells true."""
    return reply.rpartition(": ")[2].strip()
