"""Built-ins for the state and the model of the arm, force mode and freedrive."""

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np

from dynid.core import Array, JobError
from urtwin import urscript, variables
from urtwin.arm import ForceMode
from urtwin.core import Core, ToolPayload
from urtwin.urscript import Pose, ScriptFault, Value

_STEADY_S, _STANDSTILL = 0.5, 1e-3
_MAX_PAYLOAD_KG = 50.0
_MOST_DAMPING, _MOST_GAIN = 1.0, 2.0
_TYPES = (1, 2, 3)
_ALL_FREE = (1, 1, 1, 1, 1, 1)


def _forward(core: Core, q: Value = None, tcp: Value = None) -> Pose:
    return urscript.pose_of(
        core.arm.kinematics.forward(_joints(core, q).tolist(), _tool(core, tcp))
    )


def _joints(core: Core, q: Value) -> Array:
    return core.arm.state.q if q is None else np.array(urscript.numbers(q, 6, "joint positions"))


def _speeds(core: Core, qd: Value) -> Array:
    return core.arm.state.dq if qd is None else np.array(urscript.numbers(qd, 6, "joint speeds"))


def _tool(core: Core, tcp: Value) -> Array:
    return core.tcp_matrix if tcp is None else urscript.matrix_of(tcp)


def _inverse(
    core: Core,
    x: Value,
    qnear: Value = None,
    maxPositionError: Value = 1e-10,
    maxOrientationError: Value = 1e-10,
    tcp: Value = None,
) -> Value:
    core.interpreter.enough()
    near = core.arm.setpoint if qnear is None else urscript.numbers(qnear, 6, "joint positions")
    found = core.arm.kinematics.inverse(
        urscript.matrix_of(x),
        near,
        _tool(core, tcp),
        position_error=max(urscript.number(maxPositionError), 1e-10),
        orientation_error=max(urscript.number(maxOrientationError), 1e-10),
    )
    return found.tolist()


@wraps(_inverse)
def _has_solution(core: Core, *arguments: Value) -> bool:
    try:
        _inverse(core, *arguments)
    except ScriptFault:
        raise
    except JobError:
        return False
    return True


def _within_limits(core: Core, pose: Value) -> bool:
    if isinstance(pose, Pose):
        return _has_solution(core, pose)
    joints = urscript.numbers(pose, 6, "joint positions")
    arm = core.arm
    return all(low <= q <= high for low, q, high in zip(arm.lower, joints, arm.upper, strict=True))


def _history(core: Core, steps: Value = 0) -> Value:
    return list(
        core.history[urscript.whole("steps of the history", steps, 0, len(core.history) - 1)]
    )


def _is_steady(core: Core) -> bool:
    arm = core.arm
    speed = float(np.max(np.abs(arm.state.target.dq)))
    return arm.still * arm.cycle >= _STEADY_S - 1e-9 and speed < _STANDSTILL


def _set_payload(core: Core, m: Value, cog: Value = None, inertia: Value = None) -> None:
    mass = urscript.within("payload [kg]", m, 0, _MAX_PAYLOAD_KG)
    center = core.tcp[:3] if cog is None else urscript.numbers(cog, 3, "a centre of gravity")
    moments = [0.0] * 6 if inertia is None else urscript.numbers(inertia, 6, "inertias")
    core.payload = ToolPayload(mass, list(center), moments)
    core.tell_payload()


def _set_target_payload(
    core: Core, m: Value, cog: Value, inertia: Value = None, transition_time: Value = 0
) -> None:
    _set_payload(core, m, cog, inertia)


def _set_gravity(core: Core, d: Value) -> None:
    core.gravity = urscript.numbers(d, 3, "gravity")
    core.tell_payload()


def _set_tcp(core: Core, pose: Value, tcp_name: Value = "") -> None:
    core.set_tcp(urscript.numbers(pose, 6, "a pose"))


def _joint_temperature(core: Core, j: Value) -> float:
    return core.arm.measured("temperature")[urscript.whole("joint", j, 0, 5)]


def _rtde_value(core: Core, variable_name: Value) -> Value:
    reader = variables.READERS.get(urscript.shown(variable_name))
    if reader is None:
        raise ScriptFault("no RTDE output has this name", value=urscript.shown(variable_name))
    value = reader(core)
    return list(value) if isinstance(value, list) else value


_ASK: dict[str, Callable[[Core], Value]] = {
    "get_joint_positions": lambda core: list(core.arm.setpoint),
    "get_actual_joint_positions": lambda core: core.arm.measured("position"),
    "get_actual_joint_speeds": lambda core: core.arm.measured("velocity"),
    "get_target_joint_positions": lambda core: list(core.arm.setpoint),
    "get_target_joint_speeds": lambda core: core.arm.state.target.dq.tolist(),
    "get_target_joint_accelerations": lambda core: core.arm.state.target.ddq.tolist(),
    # What is left of the torque after the controller's own model of the arm.
    "get_joint_torques": lambda core: (
        core.arm.state.torque - core.arm.state.target.feedforward
    ).tolist(),
    "get_controller_temp": lambda core: 25.0,
    "get_steptime": lambda core: core.arm.cycle,
    "get_gravity": lambda core: list(core.gravity),
    "get_tcp_offset": lambda core: Pose(core.tcp),
    "get_target_payload": lambda core: core.payload.mass,
    "get_target_payload_cog": lambda core: list(core.payload.cog),
    "get_target_payload_inertia": lambda core: list(core.payload.inertia),
    "get_tool_accelerometer_reading": variables.READERS["actual_tool_accelerometer"],
    "get_tcp_force": lambda core: [0.0] * 6,
    "force": lambda core: 0.0,
    "is_steady": _is_steady,
    "random": lambda core: float(core.random.random()),
    "protective_stop": lambda core: core.protective_stop(
        "Protective stop asked for by the program"
    ),
    "get_actual_tcp_pose": lambda core: _forward(core),
    "get_target_tcp_pose": lambda core: _forward(core, core.arm.state.target.q.tolist()),
    # No path offset and no conveyor moves the arm beside its path.
    "get_target_tcp_pose_along_path": lambda core: _forward(core, core.arm.state.target.q.tolist()),
    "get_target_tcp_speed_along_path": lambda core: variables.tool_speed(
        core, core.arm.state.target
    ),
    "get_target_waypoint": lambda core: _forward(core, core.arm.setpoint),
    "get_actual_tool_flange_pose": lambda core: _forward(core, None, Pose([0.0] * 6)),
    "get_actual_tcp_speed": lambda core: variables.tool_speed(core, core.arm.state),
    "get_target_tcp_speed": lambda core: variables.tool_speed(core, core.arm.state.target),
}
_SET: dict[str, Callable[[Core, Value], Value]] = {
    "set_payload_mass": lambda core, m: _set_payload(core, m, core.payload.cog),
    "set_payload_cog": lambda core, CoG: _set_payload(core, core.payload.mass, CoG),
    "set_gravity": _set_gravity,
    "get_joint_temp": _joint_temperature,
    "get_rtde_value": _rtde_value,
}


def _mass_matrix(core: Core, q: Value = None, include_rotors_inertia: Value = False) -> Value:
    rotors = urscript.truth(include_rotors_inertia) * np.diag(core.arm.truth.motor_inertia)
    return (core.arm.plant.tracker.mass_matrix(_joints(core, q)) + rotors).tolist()


def _coriolis(core: Core, q: Value = None, qd: Value = None) -> Value:
    return core.arm.plant.tracker.coriolis(_joints(core, q), _speeds(core, qd)).tolist()


def _jacobian(core: Core, q: Value = None, tcp: Value = None) -> Value:
    return core.arm.kinematics.jacobian(_joints(core, q).tolist(), _tool(core, tcp))[1].tolist()


def _jacobian_rate(core: Core, q: Value = None, qd: Value = None, tcp: Value = None) -> Value:
    joints, speeds = _joints(core, q).tolist(), _speeds(core, qd)
    return core.arm.kinematics.jacobian_rate(joints, speeds, _tool(core, tcp)).tolist()


def _force_mode(
    core: Core,
    task_frame: Value,
    selection_vector: Value,
    wrench: Value,
    type: Value,
    limits: Value,
) -> None:
    kind = int(urscript.number(type))
    if kind not in _TYPES:
        raise ScriptFault("type of force mode", value=kind, limit=_TYPES)
    core.force = ForceMode(
        frame=urscript.numbers(task_frame, 6, "a pose"),
        compliant=[value != 0 for value in urscript.numbers(selection_vector, 6, "a selection")],
        wrench=urscript.numbers(wrench, 6, "a wrench"),
        kind=kind,
        limits=urscript.numbers(limits, 6, "limits"),
        gain=core.force_gain,
    )


def _end_force_mode(core: Core) -> None:
    core.force = None


def _set_gain(core: Core, scaling: Value) -> None:
    core.force_gain = urscript.within("gain of force mode", scaling, 0, _MOST_GAIN)


def _teach(core: Core) -> None:
    core.teaching = True


def _end_teach(core: Core) -> None:
    core.teaching = False


def _freedrive(core: Core, freeAxes: Value = _ALL_FREE, feature: Value = 0) -> None:
    core.teaching = True


_AT_THE_TOOL: dict[str, Callable[[Core], Value]] = {
    "end_force_mode": _end_force_mode,
    # The force at the tool is zero already.
    "zero_ftsensor": lambda core: None,
    "teach_mode": _teach,
    "end_teach_mode": _end_teach,
    "end_freedrive_mode": _end_teach,
    # No joint is near its limit, as nobody pushes the arm there.
    "get_freedrive_status": lambda core: 0,
}
_FORCE: dict[str, Callable[[Core, Value], Value]] = {
    "force_mode_set_damping": lambda core, damping: urscript.within(
        "damping of force mode", damping, 0, _MOST_DAMPING
    ),
    "force_mode_set_gain_scaling": _set_gain,
    # The tool touches nothing.
    "tool_contact": lambda core, direction=0: 0,
}
STATE: dict[str, Any] = {
    **_ASK,
    **_SET,
    **_AT_THE_TOOL,
    **_FORCE,
    "get_actual_joint_positions_history": _history,
    "set_payload": _set_payload,
    "set_target_payload": _set_target_payload,
    "get_forward_kin": _forward,
    "set_tcp": _set_tcp,
    "get_inverse_kin": _inverse,
    "get_inverse_kin_has_solution": _has_solution,
    "is_within_safety_limits": _within_limits,
    "get_mass_matrix": _mass_matrix,
    "get_coriolis_and_centrifugal_torques": _coriolis,
    "get_jacobian": _jacobian,
    "get_jacobian_time_derivative": _jacobian_rate,
    "force_mode": _force_mode,
    "freedrive_mode": _freedrive,
}
"""Built-ins about the arm's state, the controller's model of it, and the force at the tool."""
