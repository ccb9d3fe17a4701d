"""The state packets of ports 30001, 30002 and 30003, as UR's client interface guide lays them out.

Big-endian; every length counts itself. Measured values are as RTDE tells them.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from dynid.protocol.modes import RobotMode, SafetyMode
from dynid.simulation.controller.machine import ControllerMachine

_ROBOT_STATE, _ROBOT_MESSAGE = 16, 20
_MODE, _JOINTS, _TOOL, _MASTERBOARD, _CARTESIAN = 0, 1, 2, 3, 4
_TEXT, _VERSION = 0, 3
_FROM_CONTROLLER = -2
_PROJECT = b"URControl"
_BUILD_DATE = b"01-01-2024, 00:00:00"
_MODE_LAYOUT = struct.Struct(">Q7?BBdddB")
_JOINT_LAYOUT = struct.Struct(">dddffffB")
_TOOL_LAYOUT = struct.Struct(">BBddfBffB")
_MASTERBOARD_LAYOUT = struct.Struct(">IIBBddBBddffffBBBIBBB")
_RUNNING_CONTROL = 0


def version_message(version: tuple[int, int, int, int], timestamp: float) -> bytes:
    """What a client of 30001 or 30002 reads first.

    Args:
        version: Major, minor, bugfix and build number.
        timestamp: Controller time [s].
    """
    body = bytes((len(_PROJECT),)) + _PROJECT
    body += struct.pack(">BBii", *version) + _BUILD_DATE
    return _message(_VERSION, body, timestamp)


def text_message(words: str, timestamp: float) -> bytes:
    """A text for the log of clients of 30001.

    Args:
        words: The text.
        timestamp: Controller time [s].
    """
    return _message(_TEXT, words.encode(), timestamp)


def robot_state(machine: ControllerMachine) -> bytes:
    """The state that 30001 and 30002 send ten times a second."""
    packages = (
        _package(_MODE, _mode(machine)),
        _package(_JOINTS, _joints(machine)),
        _package(_TOOL, _tool(machine)),
        _package(_MASTERBOARD, _masterboard(machine)),
        _package(_CARTESIAN, struct.pack(">12d", *_cartesian(machine))),
    )
    body = b"".join(packages)
    return struct.pack(">iB", 5 + len(body), _ROBOT_STATE) + body


def realtime_state(machine: ControllerMachine) -> bytes:
    """What 30003 sends every cycle.

    The layout of software 3.10/5.4 (1116 bytes), with the payload from 3.15/5.10 on (1220 bytes).
    """
    values = _realtime_values(machine)
    return struct.pack(f">i{len(values)}d", 4 + 8 * len(values), *values)


def _package(kind: int, body: bytes) -> bytes:
    return struct.pack(">iB", 5 + len(body), kind) + body


def _message(kind: int, body: bytes, timestamp: float) -> bytes:
    head = struct.pack(">Qbb", round(1e6 * timestamp), _FROM_CONTROLLER, kind)
    return struct.pack(">iB", 5 + len(head) + len(body), _ROBOT_MESSAGE) + head + body


def _mode(machine: ControllerMachine) -> bytes:
    safety, state = machine.safety_mode, machine.program_state
    return _MODE_LAYOUT.pack(
        round(1e6 * _scalar(machine, "timestamp")),
        True,
        True,
        machine.robot_mode > RobotMode.POWER_OFF,
        safety in (SafetyMode.SYSTEM_EMERGENCY_STOP, SafetyMode.ROBOT_EMERGENCY_STOP),
        safety == SafetyMode.PROTECTIVE_STOP,
        state != "STOPPED",
        state == "PAUSED",
        int(machine.robot_mode),
        _RUNNING_CONTROL,
        _scalar(machine, "target_speed_fraction"),
        _scalar(machine, "speed_scaling"),
        1.0,
        0,
    )


def _joints(machine: ControllerMachine) -> bytes:
    names = ("actual_q", "target_q", "actual_qd", "actual_current", "actual_joint_voltage")
    columns = [_vector(machine, name) for name in (*names, "joint_temperatures")]
    modes = _vector(machine, "joint_mode")
    return b"".join(
        _JOINT_LAYOUT.pack(*(column[k] for column in columns), columns[-1][k], int(modes[k]))
        for k in range(len(modes))
    )


def _tool(machine: ControllerMachine) -> bytes:
    return _TOOL_LAYOUT.pack(
        0,
        0,
        _scalar(machine, "tool_analog_input0"),
        _scalar(machine, "tool_analog_input1"),
        _scalar(machine, "actual_robot_voltage"),
        int(_scalar(machine, "tool_output_voltage")),
        _scalar(machine, "tool_output_current"),
        _scalar(machine, "tool_temperature"),
        int(_scalar(machine, "tool_mode")),
    )


def _masterboard(machine: ControllerMachine) -> bytes:
    types = int(_scalar(machine, "analog_io_types"))
    return _MASTERBOARD_LAYOUT.pack(
        int(_scalar(machine, "actual_digital_input_bits")),
        int(_scalar(machine, "actual_digital_output_bits")),
        types & 1,
        types >> 1 & 1,
        _scalar(machine, "standard_analog_input0"),
        _scalar(machine, "standard_analog_input1"),
        types >> 2 & 1,
        types >> 3 & 1,
        _scalar(machine, "standard_analog_output0"),
        _scalar(machine, "standard_analog_output1"),
        _scalar(machine, "tool_temperature"),
        _scalar(machine, "actual_robot_voltage"),
        _scalar(machine, "actual_robot_current"),
        _scalar(machine, "io_current"),
        int(machine.safety_mode),
        machine.safety_mode == SafetyMode.REDUCED,
        0,
        0,
        0,
        0,
        0,
    )


def _cartesian(machine: ControllerMachine) -> list[float]:
    return [*_vector(machine, "actual_TCP_pose"), *_vector(machine, "tcp_offset")]


def _realtime_values(machine: ControllerMachine) -> list[float]:
    def vectors(*names: str) -> list[float]:
        return [number for name in names for number in _vector(machine, name)]

    def scalars(*names: str) -> list[float]:
        return [_scalar(machine, name) for name in names]

    values = [
        *scalars("timestamp"),
        *vectors("target_q", "target_qd", "target_qdd", "target_current", "target_moment"),
        *vectors("actual_q", "actual_qd", "actual_current", "joint_control_output"),
        *vectors("actual_TCP_pose", "actual_TCP_speed", "actual_TCP_force"),
        *vectors("target_TCP_pose", "target_TCP_speed"),
        *scalars("actual_digital_input_bits"),
        *vectors("joint_temperatures"),
        *scalars("actual_execution_time"),
        0.0,
        *scalars("robot_mode"),
        *vectors("joint_mode"),
        *scalars("safety_mode"),
        *[0.0] * 6,
        *vectors("actual_tool_accelerometer"),
        *[0.0] * 6,
        *scalars("speed_scaling", "actual_momentum"),
        0.0,
        0.0,
        *scalars("actual_main_voltage", "actual_robot_voltage", "actual_robot_current"),
        *vectors("actual_joint_voltage"),
        *scalars("actual_digital_output_bits", "runtime_state"),
        *vectors("elbow_position", "elbow_velocity"),
        *scalars("safety_status"),
    ]
    if machine.core.version[:2] >= _since(machine, (3, 15), (5, 10)):
        values += [0.0] * 3
        values += [*scalars("payload"), *vectors("payload_cog", "payload_inertia")]
    return values


def _since(
    machine: ControllerMachine, cb: tuple[int, int], e_series: tuple[int, int]
) -> tuple[int, int]:
    return cb if machine.core.version[0] < e_series[0] else e_series


def _scalar(machine: ControllerMachine, name: str) -> float:
    value = machine.output(name)
    if isinstance(value, Sequence):
        raise TypeError(f"{name} is a vector")
    return float(value)


def _vector(machine: ControllerMachine, name: str) -> list[float]:
    value = machine.output(name)
    if not isinstance(value, Sequence):
        raise TypeError(f"{name} is one number")
    return [float(number) for number in value]
