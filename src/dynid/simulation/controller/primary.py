"""The robot state of ports 30001 and 30002, in the layout of the controller's software.

Big-endian; every length counts itself. The packages, their sizes and their order are those of a
state recorded from software 5.8 (Universal_Robots_Client_Library, tests/test_primary_parser.cpp)
and of UR's client interface guides; those of software before 3.5 are what python-urx reads
(urx/ursecmon.py). Measured values are as RTDE tells them.
"""

from __future__ import annotations

import struct

from dynid.protocol import RobotMode, SafetyMode
from dynid.simulation.controller.machine import ControllerMachine
from dynid.simulation.controller.state_identity import configuration_data, kinematics_info
from dynid.simulation.controller.state_values import scalar, since, vector

_ROBOT_STATE = 16
_MODE, _JOINTS, _TOOL, _MASTERBOARD, _CARTESIAN, _KINEMATICS, _CONFIGURATION = range(7)
_FORCE_MODE, _ADDITIONAL, _CALIBRATION, _SAFETY, _TOOL_COMMUNICATION, _TOOL_MODE = range(7, 13)
_JOINT_LAYOUT = struct.Struct(">dddffffB")
_TOOL_LAYOUT = struct.Struct(">BBddfBffB")
_MASTERBOARD_LAYOUT = struct.Struct(">IIBBddBBddffffBBBI")
_RUNNING_CONTROL = 0
_INTERNAL_CALIBRATION, _INTERNAL_SAFETY = bytes(48), bytes(38)
"""Packages for UR's own software."""
_NO_TOOL_COMMUNICATION = struct.pack(">?iiiff", False, 115_200, 0, 1, 1.5, 3.5)


def robot_state(machine: ControllerMachine, *, first: bool = False) -> bytes:
    """The state that 30001 and 30002 send ten times a second.

    Args:
        machine: The controller.
        first: Whether the client has had none yet: it is told the kinematics and the limits too.
    """
    packages = [
        (_MODE, _mode(machine)),
        (_JOINTS, _joints(machine)),
        (_CARTESIAN, _cartesian(machine)),
        *([(_KINEMATICS, kinematics_info(machine))] if first else []),
        (_CALIBRATION, _INTERNAL_CALIBRATION),
        (_MASTERBOARD, _masterboard(machine)),
        (_TOOL, _tool(machine)),
        *([(_CONFIGURATION, configuration_data(machine))] if first else []),
        (_FORCE_MODE, struct.pack(">7d", *vector(machine, "actual_TCP_force"), 0.0)),
        (_ADDITIONAL, _additional(machine)),
    ]
    if since(machine, (4, 0), (5, 0)):
        packages += [
            (_SAFETY, _INTERNAL_SAFETY),
            (_TOOL_COMMUNICATION, _NO_TOOL_COMMUNICATION),
            (_TOOL_MODE, bytes(3)),
        ]
    body = b"".join(struct.pack(">iB", 5 + len(data), kind) + data for kind, data in packages)
    return struct.pack(">iB", 5 + len(body), _ROBOT_STATE) + body


def _mode(machine: ControllerMachine) -> bytes:
    safety, state = machine.safety_mode, machine.program_state
    body = struct.pack(
        ">Q7?BBdd",
        round(1e6 * scalar(machine, "timestamp")),
        True,
        True,
        machine.robot_mode > RobotMode.POWER_OFF,
        safety in (SafetyMode.SYSTEM_EMERGENCY_STOP, SafetyMode.ROBOT_EMERGENCY_STOP),
        safety == SafetyMode.PROTECTIVE_STOP,
        state == "PLAYING",
        state == "PAUSED",
        int(machine.robot_mode),
        _RUNNING_CONTROL,
        scalar(machine, "target_speed_fraction"),
        scalar(machine, "speed_scaling"),
    )
    if since(machine, (3, 2), (5, 0)):
        body += struct.pack(">d", 1.0)
    return body + bytes(1) if since(machine, (3, 5), (5, 0)) else body


def _joints(machine: ControllerMachine) -> bytes:
    names = ("actual_q", "target_q", "actual_qd", "actual_current", "actual_joint_voltage")
    columns = [vector(machine, name) for name in (*names, "joint_temperatures")]
    modes = vector(machine, "joint_mode")
    return b"".join(
        _JOINT_LAYOUT.pack(*(column[k] for column in columns), columns[-1][k], int(modes[k]))
        for k in range(len(modes))
    )


def _cartesian(machine: ControllerMachine) -> bytes:
    numbers = vector(machine, "actual_TCP_pose")
    if since(machine, (3, 2), (5, 0)):
        numbers += vector(machine, "tcp_offset")
    return struct.pack(f">{len(numbers)}d", *numbers)


def _tool(machine: ControllerMachine) -> bytes:
    types = int(scalar(machine, "tool_analog_input_types"))
    return _TOOL_LAYOUT.pack(
        types & 1,
        types >> 1 & 1,
        scalar(machine, "tool_analog_input0"),
        scalar(machine, "tool_analog_input1"),
        scalar(machine, "actual_robot_voltage"),
        int(scalar(machine, "tool_output_voltage")),
        scalar(machine, "tool_output_current"),
        scalar(machine, "tool_temperature"),
        int(scalar(machine, "tool_mode")),
    )


def _masterboard(machine: ControllerMachine) -> bytes:
    types = int(scalar(machine, "analog_io_types"))
    body = _MASTERBOARD_LAYOUT.pack(
        int(scalar(machine, "actual_digital_input_bits")),
        int(scalar(machine, "actual_digital_output_bits")),
        types & 1,
        types >> 1 & 1,
        scalar(machine, "standard_analog_input0"),
        scalar(machine, "standard_analog_input1"),
        types >> 2 & 1,
        types >> 3 & 1,
        scalar(machine, "standard_analog_output0"),
        scalar(machine, "standard_analog_output1"),
        scalar(machine, "tool_temperature"),
        scalar(machine, "actual_robot_voltage"),
        scalar(machine, "actual_robot_current"),
        scalar(machine, "io_current"),
        int(machine.safety_mode),
        machine.safety_mode == SafetyMode.REDUCED,
        0,
        0,
    )
    # The selector of the operational mode and the three-position device; then UR's own byte.
    selectors = 3 * since(machine, (3, 5), (5, 0)) or 2 * since(machine, (3, 2), (5, 0))
    return body + bytes(selectors)


def _additional(machine: ControllerMachine) -> bytes:
    """The teach button, whether it may be used, freedrive by an input."""
    length = 4 if since(machine, (4, 0), (5, 0)) else 3 if since(machine, (3, 5), (5, 0)) else 2
    return bytes((machine.core.teaching, True, False, False)[:length])
