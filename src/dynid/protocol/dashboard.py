"""The dashboard server (TCP port 29999) and the modes that a UR controller reports."""

from enum import IntEnum, IntFlag

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
    """Whether software of a major and minor number has a command, in small letters."""
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


class RobotMode(IntEnum):
    """Output `robot_mode`."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING_FIRMWARE = 8


class SafetyMode(IntEnum):
    """Output `safety_mode`."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9
    VALIDATE_JOINT_ID = 10
    UNDEFINED_SAFETY_MODE = 11


class RuntimeState(IntEnum):
    """Output `runtime_state`: what the program does."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


class JointMode(IntEnum):
    """Output `joint_mode`: the modes that a healthy arm passes through."""

    POWER_OFF = 239
    BOOTING = 247
    RUNNING = 253
    IDLE = 255


class RobotStatus(IntFlag):
    """Output `robot_status_bits`."""

    POWER_ON = 1
    PROGRAM_RUNNING = 2
    TEACH_BUTTON = 4
    POWER_BUTTON = 8


class SafetyStatus(IntFlag):
    """Output `safety_status_bits`."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOPPED = 4
    RECOVERY = 8
    SAFEGUARD_STOPPED = 16
    SYSTEM_EMERGENCY_STOPPED = 32
    ROBOT_EMERGENCY_STOPPED = 64
    EMERGENCY_STOPPED = 128
    VIOLATION = 256
    FAULT = 512
    STOPPED_DUE_TO_SAFETY = 1024
