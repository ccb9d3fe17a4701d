"""States that a UR controller reports: the numbers of RTDE, the names of the dashboard.

From Universal Robots' RTDE guide and dashboard server article.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag


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
