"""The RTDE outputs and inputs of the controller, by name.

Supply voltages, the tool's electronics, Euromap signals and the execution time of the controller
have no physics here: they are constants. Nothing touches the arm, so forces at the tool are zero.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter

import numpy as np

from dynid.core import Array, InputError
from dynid.protocol import JointMode, RobotMode, RobotStatus
from dynid.simulation import PlantState, Target
from urtwin.core import BITS, COUNT, Core, Registers
from urtwin.kinematics import to_pose

OutputValue = bool | int | float | list[int] | list[float]
_Reader = Callable[[Core], OutputValue]

_REGISTERS = [
    *((kind, k) for kind in ("int", "double") for k in range(COUNT)),
    *(("bit", k) for k in range(64, BITS)),
]
"""Registers that RTDE names one by one."""
_BUS, _IDLE_CURRENT = 48.0, 0.4
_JOINT_MODE = {
    RobotMode.POWER_OFF: JointMode.POWER_OFF,
    RobotMode.POWER_ON: JointMode.BOOTING,
    RobotMode.IDLE: JointMode.IDLE,
}
_REFERENCE_DEGC = 26.0


def _target(name: str) -> _Reader:
    return lambda core: getattr(core.arm.state.target, name).tolist()


def _measured(quantity: str) -> _Reader:
    return lambda core: core.arm.measured(quantity)


def _constant(value: OutputValue) -> _Reader:
    return lambda _: value


def _tool(core: Core, q: Array) -> list[float]:
    return to_pose(core.arm.kinematics.forward(q.tolist(), core.tcp_matrix))


def tool_speed(core: Core, motion: PlantState | Target) -> list[float]:
    """(6) linear [m/s] and angular [rad/s] velocity of the tool in the base frame."""
    jacobian = core.arm.kinematics.jacobian(motion.q.tolist(), core.tcp_matrix)[1]
    return (jacobian @ motion.dq).tolist()


def _accelerated_tool(core: Core, motion: PlantState | Target) -> tuple[Array, Array]:
    """The tool (4, 4), and its linear and angular acceleration (6), in the base frame."""
    q, dq = motion.q.tolist(), motion.dq
    kinematics = core.arm.kinematics
    tool, jacobian = kinematics.jacobian(q, core.tcp_matrix)
    return tool, jacobian @ motion.ddq + kinematics.jacobian_rate(q, dq, core.tcp_matrix) @ dq


def _tool_acceleration(core: Core, motion: PlantState | Target) -> list[float]:
    return _accelerated_tool(core, motion)[1].tolist()


def _acceleration(core: Core) -> OutputValue:
    """What an accelerometer at the tool feels, in the tool's axes."""
    tool, acceleration = _accelerated_tool(core, core.arm.state)
    return (tool[:3, :3].T @ (acceleration[:3] - core.arm.plant.arm.robot.gravity)).tolist()


def _status(core: Core) -> OutputValue:
    bits = (
        (RobotStatus.POWER_ON, core.mode != RobotMode.POWER_OFF),
        (RobotStatus.PROGRAM_RUNNING, core.playing),
        (RobotStatus.TEACH_BUTTON, core.teaching),
    )
    return sum(bit for bit, on in bits if on)


def _robot_current(core: Core) -> OutputValue:
    state = core.arm.state
    power = float(np.sum(np.abs(state.torque * state.dq)))
    return _IDLE_CURRENT + power / _BUS


def _deviation(core: Core) -> OutputValue:
    state = core.arm.state
    return float(np.max(np.abs(state.q - state.target.q))) / core.safety.limits.deviation


def _current_window(core: Core) -> OutputValue:
    limit = core.arm.limits.torque / np.abs(core.arm.truth.gain)
    return np.nan_to_num(limit, nan=0.0).tolist()


def _registers() -> dict[str, _Reader]:
    found: dict[str, _Reader] = {}
    for side in ("input", "output"):
        bank: Callable[[Core], Registers] = attrgetter(f"{side}s")
        for kind, k in _REGISTERS:
            name = f"{side}_{kind}_register_{k}"
            found[name] = lambda core, bank=bank, kind=kind, k=k: bank(core).banks[kind][k]
        found[f"{side}_bit_registers0_to_31"] = lambda core, bank=bank: bank(core).word(0)
        found[f"{side}_bit_registers32_to_63"] = lambda core, bank=bank: bank(core).word(32)
    return found


_CONSTANTS: tuple[tuple[OutputValue, str], ...] = (
    (
        [0.0] * 6,
        """actual_TCP_force wrench_calc_from_currents target_base_wrench target_base_acceleration
        ft_raw_wrench""",
    ),
    (
        0.0,
        """tcp_force_scalar collision_detection_ratio actual_robot_energy_consumed
        actual_robot_braking_energy_dissipated euromap67_24V_voltage euromap67_24V_current
        tool_analog_input0 tool_analog_input1 tool_output_current""",
    ),
    (
        0,
        """script_control_line encoder0_raw encoder1_raw euromap67_input_bits euromap67_output_bits
        tool_analog_input_types tool_output_mode tool_digital_output0_mode
        tool_digital_output1_mode""",
    ),
    (0.1, "actual_execution_time"),
    (0.05, "io_current"),
    (_BUS, "actual_main_voltage"),
    (_REFERENCE_DEGC, "tool_temperature"),
)
READERS: dict[str, _Reader] = {
    "timestamp": lambda core: core.now,
    "target_q": _target("q"),
    "target_qd": _target("dq"),
    "target_qdd": _target("ddq"),
    "target_moment": _target("moment"),
    "target_current": lambda core: (
        core.arm.state.target.feedforward / core.arm.truth.gain
    ).tolist(),
    "actual_q": _measured("position"),
    "actual_qd": _measured("velocity"),
    "actual_current": _measured("current"),
    "joint_control_output": _measured("current"),
    "joint_temperatures": _measured("temperature"),
    "actual_current_as_torque": lambda core: (
        np.array(core.arm.measured("current")) * core.arm.truth.gain
    ).tolist(),
    "actual_current_window": _current_window,
    "actual_TCP_pose": lambda core: _tool(core, core.arm.state.q),
    "target_TCP_pose": lambda core: _tool(core, core.arm.state.target.q),
    "actual_TCP_speed": lambda core: tool_speed(core, core.arm.state),
    "target_TCP_speed": lambda core: tool_speed(core, core.arm.state.target),
    "actual_TCP_acceleration": lambda core: _tool_acceleration(core, core.arm.state),
    "target_TCP_acceleration": lambda core: _tool_acceleration(core, core.arm.state.target),
    "target_gravity": lambda core: core.gravity,
    "actual_tool_accelerometer": _acceleration,
    "elbow_position": lambda core: core.arm.kinematics.elbow(core.arm.state.q.tolist())[0],
    "elbow_velocity": lambda core: (
        np.array(core.arm.kinematics.elbow(core.arm.state.q.tolist())[1]) @ core.arm.state.dq
    ).tolist(),
    "tcp_offset": lambda core: core.tcp,
    "payload": lambda core: core.payload.mass,
    "payload_cog": lambda core: core.payload.cog,
    "payload_inertia": lambda core: core.payload.inertia,
    "robot_mode": lambda core: int(core.mode),
    "joint_mode": lambda core: [int(_JOINT_MODE.get(core.mode, JointMode.RUNNING))] * 6,
    "safety_mode": lambda core: int(core.safety.mode),
    "safety_status": lambda core: int(core.safety.mode),
    "safety_status_bits": lambda core: core.safety.bits,
    "robot_status_bits": _status,
    "runtime_state": lambda core: int(core.runtime),
    "speed_scaling": lambda core: 0.0 if core.paused else core.scaling,
    "target_speed_fraction": lambda core: core.speed_fraction,
    "actual_momentum": lambda core: core.arm.plant.tracker.momentum(),
    "joint_position_deviation_ratio": _deviation,
    "time_scale_source": lambda core: int(core.playing),
    "target_execution_time": lambda core: 1e3 * core.arm.cycle,
    "control_step": lambda core: core.cycles,
    "actual_robot_voltage": lambda core: 0.0 if core.mode == RobotMode.POWER_OFF else _BUS,
    "actual_robot_current": _robot_current,
    "actual_joint_voltage": lambda core: [0.0 if core.mode == RobotMode.POWER_OFF else _BUS] * 6,
    "actual_digital_input_bits": lambda core: core.signals.digital_in,
    "actual_digital_output_bits": lambda core: core.signals.digital_out,
    "actual_configurable_digital_input_bits": lambda core: core.signals.digital_in >> 8 & 0xFF,
    "actual_configurable_digital_output_bits": lambda core: core.signals.digital_out >> 8 & 0xFF,
    "analog_io_types": lambda core: core.signals.analog_types,
    "standard_analog_input0": lambda core: core.signals.analog_in[0],
    "standard_analog_input1": lambda core: core.signals.analog_in[1],
    "standard_analog_output0": lambda core: core.signals.analog_out[0],
    "standard_analog_output1": lambda core: core.signals.analog_out[1],
    "tool_output_voltage": lambda core: core.signals.tool_voltage,
    "tool_mode": lambda core: int(
        JointMode.RUNNING if core.mode == RobotMode.RUNNING else JointMode.IDLE
    ),
    **{name: _constant(value) for value, names in _CONSTANTS for name in names.split()},
    **_registers(),
}
"""How each output is read; nothing is computed that nobody asks for."""


_WRENCH = "external_force_torque"
InputValue = bool | int | float | Sequence[float]
_MASKED = (
    ("standard_digital_output", 0),
    ("configurable_digital_output", 8),
    ("tool_digital_output", 16),
)


class Inputs:
    """Takes inputs as they come and applies them at the start of a cycle."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._waiting: dict[str, float] = {}
        inputs, held = (
            core.inputs,
            [f"{name}{part}" for name, _ in _MASKED for part in ("", "_mask")],
        )
        held += ["speed_slider_mask", "speed_slider_fraction"]
        held += [f"standard_analog_output_{part}" for part in ("mask", "type", "0", "1")]
        self._writers: dict[str, Callable[[float], None]] = {
            **{name: partial(self._waiting.__setitem__, name) for name in held},
            **{
                f"input_{kind}_register_{k}": partial(inputs.write, kind, k)
                for kind, k in _REGISTERS
            },
            "input_bit_registers0_to_31": partial(inputs.set_word, 0),
            "input_bit_registers32_to_63": partial(inputs.set_word, 32),
        }

    def write(self, name: str, value: InputValue) -> None:
        """Take an input; `InputError` for an unknown one, or another number of values."""
        if name not in self._writers and name != _WRENCH:
            raise InputError("unknown RTDE input", value=name)
        size = len(value) if isinstance(value, Sequence) else 1
        if size != (6 if name == _WRENCH else 1):
            raise InputError("another number of values than the input has", where=name, value=value)
        # A measured wrench has no effect: the simulated arm touches nothing.
        if not isinstance(value, Sequence):
            self._writers[name](value)
        self._core.feed(name)

    def apply(self) -> None:
        """Let masked inputs act: outputs and the speed slider change where the mask says so."""
        if not self._waiting:
            return
        waiting, core, signals = self._waiting, self._core, self._core.signals
        fraction = waiting.get("speed_slider_fraction", math.nan)
        if waiting.get("speed_slider_mask") and math.isfinite(fraction):
            core.speed_fraction = min(max(fraction, 0.0), 1.0)
        for name, shift in _MASKED:
            mask = int(waiting.get(f"{name}_mask", 0))
            if mask:
                signals.masked(mask, int(waiting.get(name, 0)), shift)
        mask = int(waiting.get("standard_analog_output_mask", 0))
        for k in range(2):
            share = waiting.get(f"standard_analog_output_{k}", 0.0)
            if mask >> k & 1 and math.isfinite(share):
                signals.analog_out[k] = min(max(share, 0.0), 1.0)
        if mask:
            kinds = int(waiting.get("standard_analog_output_type", 0)) & mask
            signals.analog_types = signals.analog_types & ~(mask << 2) | kinds << 2
        waiting.clear()
