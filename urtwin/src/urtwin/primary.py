"""The packets of ports 30001 to 30003: robot state, messages, real-time state.

Big-endian; every length counts itself. The packages, their sizes and their order are those of a
state recorded from software 5.8 (Universal_Robots_Client_Library, tests/test_primary_parser.cpp)
and of UR's client interface guides; those of software before 3.5 are what python-urx reads
(urx/ursecmon.py). KinematicsInfo, ConfigurationData and the messages are laid out as UR's client
library reads them (src/primary/robot_state, src/primary/robot_message). Real-time packets by
software: 1044 bytes (3.0), 1060 (3.2), 1108 (3.5), 1116 (3.10 and 5.4), 1220 (3.15 and 5.10).
Measured values are as RTDE tells them.
"""

import math
import re
import struct

import numpy as np

from dynid.core import Array
from dynid.protocol import RobotMode, SafetyMode
from dynid.robot import RobotModel
from urtwin.core import Message, MessageKind
from urtwin.machine import ControllerMachine

_NOT_CALIBRATED = (0xFFFFFFFF,) * 6
_JOINT_DEFAULTS, _TOOL_DEFAULTS, _EQUIVALENT_RADIUS = (1.047, 1.396), (0.25, 1.2), 0.25
"""Speed and acceleration of moves; the radius that turns rotations into metres."""
_MASTERBOARD, _BOX = 6, 4
_TYPES = {"ur5": 1, "ur10": 2, "ur3": 3, "ur16": 4, "ur20": 7, "ur30": 8}
_CB_SUBTYPE, _E_SUBTYPE = 1, 3
_AXES = 6
_ROBOT_STATE = 16
_MODE, _JOINTS, _TOOL, _BOARD_STATE, _CARTESIAN, _KINEMATICS, _CONFIGURATION = range(7)
_FORCE_MODE, _ADDITIONAL, _CALIBRATION, _SAFETY, _TOOL_COMMUNICATION, _TOOL_MODE = range(7, 13)
_RUNNING_CONTROL = 0
_INTERNAL_CALIBRATION, _INTERNAL_SAFETY = bytes(48), bytes(38)
"""Packages for UR's own software."""
_NO_TOOL_COMMUNICATION = struct.pack(">?iiiff", False, 115_200, 0, 1, 1.5, 3.5)
_ROBOT_MESSAGE = 20
_TEXT, _POPUP, _VERSION, _SAFETY_MODE, _ERROR_CODE, _KEY, _EXCEPTION = 0, 2, 3, 5, 6, 7, 10
_FROM_CONTROLLER, _FROM_PROGRAM = -2, -3
_PROJECT = b"URControl"
_BUILD_DATE = b"01-01-2024, 00:00:00"
_CODE = re.compile(r"C(\d+)(?:A(\d+))?:?\s*")
_VIOLATION = 3
_LONGEST_TITLE = 255
_UR_ONLY = "0"
"""In the place of values that UR keeps to itself."""


def packed(layout: str, *values: float) -> bytes:
    """Values big-endian, whole numbers where the `struct` codes say so (one code a value)."""
    pairs = zip(layout, values, strict=True)
    return struct.pack(f">{layout}", *(v if code in "df" else int(v) for code, v in pairs))


def since(machine: ControllerMachine, cb: tuple[int, int], e_series: tuple[int, int]) -> bool:
    """Whether the software is as new as the major and minor number given for its series."""
    version = machine.core.version[:2]
    return version >= (cb if version[0] < 5 else e_series)


def kinematics_info(machine: ControllerMachine) -> bytes:
    """The DH table of the arm, as after no calibration."""
    theta, a, d, alpha = dh_table(machine.core.arm.plant.arm.robot)
    return struct.pack(">6I24dI", *_NOT_CALIBRATED, *theta, *a, *d, *alpha, 0)


def configuration_data(machine: ControllerMachine) -> bytes:
    """Joint limits, defaults of the moves, the DH table and the kind of robot."""
    arm = machine.core.arm
    theta, a, d, alpha = dh_table(arm.plant.arm.robot)
    limits = arm.limits
    positions = np.nan_to_num(np.column_stack([limits.lower, limits.upper]), nan=0.0)
    motions = np.nan_to_num(np.column_stack([limits.velocity, limits.acceleration]), nan=0.0)
    name = arm.plant.arm.robot.name.removesuffix("e")
    subtype = _CB_SUBTYPE if machine.core.version[0] < 5 else _E_SUBTYPE
    kind = (_MASTERBOARD, _BOX, _TYPES.get(name, 0), subtype)
    defaults = (*positions.ravel(), *motions.ravel(), *_JOINT_DEFAULTS, *_TOOL_DEFAULTS)
    return struct.pack(">53d4i", *defaults, _EQUIVALENT_RADIUS, *a, *d, *alpha, *theta, *kind)


def dh_table(robot: RobotModel) -> tuple[Array, Array, Array, Array]:
    """The standard DH table at q = 0: theta [rad], a [m], d [m] and alpha [rad], six each.

    All zero for a robot that is not given by such a table.
    """
    frames = robot.parameter_frames.get("dh")
    rows = np.zeros((_AXES, 4))
    if frames is not None:
        # From one DH frame to the next; the first starts at the base.
        steps: Array = np.matmul(robot.placements, frames)
        steps[1:] = np.linalg.solve(frames[:-1], steps[1:])
        for k, step in enumerate(steps):
            theta = math.atan2(step[1, 0], step[0, 0])
            a = math.cos(theta) * step[0, 3] + math.sin(theta) * step[1, 3]
            rows[k] = (theta, a, step[2, 3], math.atan2(step[2, 1], step[2, 2]))
    return rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3]


def robot_state(machine: ControllerMachine, *, first: bool = False) -> bytes:
    """The state that 30001 and 30002 send ten times a second; the first also tells limits."""
    packages = [
        (_MODE, _mode(machine)),
        (_JOINTS, _joints(machine)),
        (_CARTESIAN, _cartesian(machine)),
        *([(_KINEMATICS, kinematics_info(machine))] if first else []),
        (_CALIBRATION, _INTERNAL_CALIBRATION),
        (_BOARD_STATE, _masterboard(machine)),
        (_TOOL, _tool(machine)),
        *([(_CONFIGURATION, configuration_data(machine))] if first else []),
        (_FORCE_MODE, packed("d" * 7, *machine.numbers("actual_TCP_force"), 0.0)),
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
    core = machine.core
    (timestamp,) = machine.numbers("timestamp")
    flags = (
        # The fourth: the emergency stop, which nobody can press here.
        *(True, True, core.mode > RobotMode.POWER_OFF, False),
        *(core.safety.mode == SafetyMode.PROTECTIVE_STOP, core.playing and not core.paused),
        core.playing and core.paused,
    )
    speeds = machine.numbers("target_speed_fraction", "speed_scaling")
    modes = (core.mode, _RUNNING_CONTROL)
    body = packed("QBBBBBBBBBdd", round(1e6 * timestamp), *flags, *modes, *speeds)
    if since(machine, (3, 2), (5, 0)):
        body += struct.pack(">d", 1.0)
    return body + bytes(1) if since(machine, (3, 5), (5, 0)) else body


def _joints(machine: ControllerMachine) -> bytes:
    names = ("actual_q", "target_q", "actual_qd", "actual_current", "actual_joint_voltage")
    columns = [machine.numbers(name) for name in (*names, "joint_temperatures")]
    modes = machine.numbers("joint_mode")
    rows = zip(*columns, columns[-1], modes, strict=True)
    return b"".join(packed("dddffffB", *row) for row in rows)


def _cartesian(machine: ControllerMachine) -> bytes:
    pose = machine.numbers("actual_TCP_pose")
    if since(machine, (3, 2), (5, 0)):
        pose += machine.numbers("tcp_offset")
    return packed("d" * len(pose), *pose)


def _bits(machine: ControllerMachine, name: str, *places: int) -> list[int]:
    (word,) = machine.numbers(name)
    return [int(word) >> place & 1 for place in places]


def _tool(machine: ControllerMachine) -> bytes:
    values = machine.numbers(
        *("tool_analog_input0", "tool_analog_input1", "actual_robot_voltage"),
        *("tool_output_voltage", "tool_output_current", "tool_temperature", "tool_mode"),
    )
    return packed("BBddfBffB", *_bits(machine, "tool_analog_input_types", 0, 1), *values)


def _masterboard(machine: ControllerMachine) -> bytes:
    digital = machine.numbers("actual_digital_input_bits", "actual_digital_output_bits")
    body = packed(
        "IIBBddBBddffffBBBI",
        *digital,
        *_bits(machine, "analog_io_types", 0, 1),
        *machine.numbers("standard_analog_input0", "standard_analog_input1"),
        *_bits(machine, "analog_io_types", 2, 3),
        *machine.numbers("standard_analog_output0", "standard_analog_output1"),
        *machine.numbers("tool_temperature", "actual_robot_voltage"),
        *machine.numbers("actual_robot_current", "io_current"),
        *(machine.core.safety.mode, 0, 0, 0),
    )
    # The selector of the operational mode and the three-position device; then UR's own byte.
    selectors = 3 * since(machine, (3, 5), (5, 0)) or 2 * since(machine, (3, 2), (5, 0))
    return body + bytes(selectors)


def _additional(machine: ControllerMachine) -> bytes:
    """The teach button, whether it may be used, freedrive by an input."""
    length = 4 if since(machine, (4, 0), (5, 0)) else 3 if since(machine, (3, 5), (5, 0)) else 2
    return bytes((machine.core.teaching, True, False, False)[:length])


def version_message(version: tuple[int, int, int, int], timestamp: float) -> bytes:
    """What a client of 30001 or 30002 reads first, at a controller time [s]."""
    body = _short(_PROJECT) + struct.pack(">BBii", *version) + _BUILD_DATE
    return _message(_VERSION, _FROM_CONTROLLER, body, timestamp)


def packets(message: Message) -> bytes:
    """What clients of 30001 read of something that the controller has said."""
    words, at = message.text.encode(), message.timestamp
    match message.kind:
        case MessageKind.KEY:
            body = struct.pack(">ii", 0, 0) + _short(message.title.encode()) + words
            return _message(_KEY, _FROM_CONTROLLER, body, at)
        case MessageKind.POPUP:
            return _message(_POPUP, _FROM_PROGRAM, _popup(message), at)
        case MessageKind.STOP:
            return _stop(message)
        case MessageKind.EXCEPTION:
            place = struct.pack(">ii", message.line, 1)
            said = place + (message.title.encode() or words)
            exception = _message(_EXCEPTION, _FROM_PROGRAM, said, at)
            # The controller's own words name the error; ours say what to do.
            return exception + _message(_TEXT, _FROM_PROGRAM, words, at)
        case MessageKind.NOTE:
            return b""
        case MessageKind.TEXT:
            return _message(_TEXT, _FROM_PROGRAM, words, at)


def _popup(message: Message) -> bytes:
    """Number, type asked for, warning, error, blocking, title and text."""
    number = round(1e6 * message.timestamp) & 0xFFFFFFFF
    flags = (message.level == 2, message.level < 2, message.blocking)
    head = struct.pack(">IB???", number, 0, *flags)
    return head + _short(message.title.encode()) + message.text.encode()


def _stop(message: Message) -> bytes:
    """The error code of a stop, then the new safety mode."""
    found = _CODE.match(message.text)
    code, argument = (int(number or 0) for number in found.groups()) if found else (0, 0)
    report = struct.pack(">iiiII", code, argument, _VIOLATION, 0, 0) + message.text.encode()
    entered = SafetyMode.FAULT if message.level == 0 else SafetyMode.PROTECTIVE_STOP
    mode = struct.pack(">iiBII", code, argument, int(entered), 0, 0)
    return _message(_ERROR_CODE, _FROM_CONTROLLER, report, message.timestamp) + _message(
        _SAFETY_MODE, _FROM_CONTROLLER, mode, message.timestamp
    )


def _short(text: bytes) -> bytes:
    return bytes((len(text[:_LONGEST_TITLE]),)) + text[:_LONGEST_TITLE]


def _message(kind: int, source: int, body: bytes, timestamp: float) -> bytes:
    head = struct.pack(">Qbb", round(1e6 * timestamp), source, kind)
    return struct.pack(">iB", 5 + len(head) + len(body), _ROBOT_MESSAGE) + head + body


_REALTIME: tuple[tuple[tuple[int, int], tuple[int, int], str], ...] = (
    (
        (3, 0),
        (5, 0),
        """timestamp target_q target_qd target_qdd target_current target_moment actual_q actual_qd
        actual_current joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force
        target_TCP_pose target_TCP_speed actual_digital_input_bits joint_temperatures
        actual_execution_time 0 robot_mode joint_mode safety_mode 0 0 0 0 0 0
        actual_tool_accelerometer 0 0 0 0 0 0 speed_scaling actual_momentum 0 0 actual_main_voltage
        actual_robot_voltage actual_robot_current actual_joint_voltage""",
    ),
    ((3, 2), (5, 0), "actual_digital_output_bits runtime_state"),
    ((3, 5), (5, 0), "elbow_position elbow_velocity"),
    ((3, 10), (5, 4), "safety_status"),
    ((3, 15), (5, 10), "0 0 0 payload payload_cog payload_inertia"),
)
"""What each version of the software (CB-Series, e-Series) has added to the packet."""


def realtime_state(machine: ControllerMachine) -> bytes:
    """The packet of this cycle, in the layout of the controller's software."""
    values: list[float] = []
    for cb, e_series, names in _REALTIME:
        if since(machine, cb, e_series):
            for name in names.split():
                values += [0.0] if name == _UR_ONLY else machine.numbers(name)
    return struct.pack(f">i{len(values)}d", 4 + 8 * len(values), *values)
