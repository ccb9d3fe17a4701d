"""What port 30003 sends every cycle, as UR's real-time client guide lays it out.

Sizes by software: 1044 bytes (3.0), 1060 (3.2), 1108 (3.5), 1116 (3.10 and 5.4), 1220 (3.15 and
5.10). All numbers are big-endian doubles but the size, which counts itself.
"""

from __future__ import annotations

import struct

from dynid.simulation.controller.machine import ControllerMachine
from dynid.simulation.controller.state_values import scalar, since, vector

_VECTORS_FIRST = (
    *("target_q", "target_qd", "target_qdd", "target_current", "target_moment"),
    *("actual_q", "actual_qd", "actual_current", "joint_control_output"),
    *("actual_TCP_pose", "actual_TCP_speed", "actual_TCP_force"),
    *("target_TCP_pose", "target_TCP_speed"),
)
_UR_ONLY = 0.0
"""In the place of values that UR keeps to itself."""


def realtime_state(machine: ControllerMachine) -> bytes:
    """The packet of this cycle, in the layout of the controller's software."""
    values = _values(machine)
    return struct.pack(f">i{len(values)}d", 4 + 8 * len(values), *values)


def _values(machine: ControllerMachine) -> list[float]:
    def vectors(*names: str) -> list[float]:
        return [number for name in names for number in vector(machine, name)]

    def scalars(*names: str) -> list[float]:
        return [scalar(machine, name) for name in names]

    values = [
        *scalars("timestamp"),
        *vectors(*_VECTORS_FIRST),
        *scalars("actual_digital_input_bits"),
        *vectors("joint_temperatures"),
        *scalars("actual_execution_time"),
        _UR_ONLY,
        *scalars("robot_mode"),
        *vectors("joint_mode"),
        *scalars("safety_mode"),
        *[_UR_ONLY] * 6,
        *vectors("actual_tool_accelerometer"),
        *[_UR_ONLY] * 6,
        *scalars("speed_scaling", "actual_momentum"),
        *[_UR_ONLY] * 2,
        *scalars("actual_main_voltage", "actual_robot_voltage", "actual_robot_current"),
        *vectors("actual_joint_voltage"),
    ]
    if since(machine, (3, 2), (5, 0)):
        values += scalars("actual_digital_output_bits", "runtime_state")
    if since(machine, (3, 5), (5, 0)):
        values += vectors("elbow_position", "elbow_velocity")
    if since(machine, (3, 10), (5, 4)):
        values += scalars("safety_status")
    if since(machine, (3, 15), (5, 10)):
        values += [*[_UR_ONLY] * 3, *scalars("payload"), *vectors("payload_cog", "payload_inertia")]
    return values
