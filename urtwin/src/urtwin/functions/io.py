"""Built-ins for registers, signals, messages and watchdogs, and those that are not simulated."""

import math
from collections.abc import Callable, Generator, Sequence
from typing import Any

from dynid.protocol import INPUTS
from urtwin.core import BITS, COUNT, FLAGS, Core, InputWatchdog, MessageKind, Registers
from urtwin.urscript import Builtin, ScriptFault, Value, number, shown, truth, whole, within

_ACTIONS = ("ignore", "pause", "stop")
_TOOL_VOLTAGES = (0, 12, 24)


def _pair(n: Value) -> int:
    return whole("analog signal", n, 0, 1)


def _flag(n: Value) -> int:
    return whole("flag", n, 0, FLAGS - 1)


def _address(kind: str, address: Value) -> int:
    return whole(f"{kind} register", address, 0, (BITS if kind == "bit" else COUNT) - 1)


def _reader(kind: str, bank: Callable[[Core], Registers]) -> Callable[[Core, Value], Value]:
    return lambda core, address: bank(core).banks[kind][_address(kind, address)]


def _writer(kind: str) -> Callable[[Core, Value, Value], None]:
    def write(core: Core, address: Value, value: Value) -> None:
        stored = truth(value) if kind == "bit" else number(value)
        if kind == "int" and not math.isfinite(stored):
            raise ScriptFault("an integer register takes whole numbers", value=stored)
        core.outputs.write(kind, _address(kind, address), stored)

    return write


def _popup(
    core: Core,
    s: Value,
    title: Value = "Popup",
    warning: Value = False,
    error: Value = False,
    blocking: Value = False,
) -> Generator[None, None, None]:
    level = 1 if truth(error) else 2 if truth(warning) else 3
    waits = truth(blocking)
    core.say(shown(s), "program", level, MessageKind.POPUP, title=shown(title), blocking=waits)
    if waits:
        core.blocking_popup = True
        while core.blocking_popup:
            yield


def _rtde_set_watchdog(
    core: Core, variable_name: Value, min_frequency: Value, action: Value = "pause"
) -> None:
    name, wanted = shown(variable_name), shown(action).lower()
    if name not in INPUTS:
        raise ScriptFault("a watchdog needs an RTDE input", value=name)
    if wanted not in _ACTIONS:
        raise ScriptFault("action of a watchdog", value=wanted, limit=_ACTIONS)
    rate = within("frequency of a watchdog", min_frequency, 0, core.rate_hz)
    period = 1.0 / rate if rate > 0.0 else math.inf
    core.watchdogs[name] = InputWatchdog(name, period, wanted, core.now)


def _digital_out(shift: int, count: int) -> Callable[[Core, Value, Value], None]:
    return lambda core, n, b: core.signals.masked(
        1, int(truth(b)), shift + whole("digital output", n, 0, count - 1)
    )


def _digital(shift: int, count: int, inputs: bool) -> Callable[[Core, Value], bool]:
    def get(core: Core, n: Value) -> bool:
        bits = core.signals.digital_in if inputs else core.signals.digital_out
        return bool(bits >> (shift + whole("digital signal", n, 0, count - 1)) & 1)

    return get


def _set_analog_out(core: Core, n: Value, f: Value) -> None:
    core.signals.analog_out[_pair(n)] = min(max(float(number(f)), 0.0), 1.0)


def _set_flag(core: Core, n: Value, b: Value) -> None:
    core.signals.flags[_flag(n)] = truth(b)


def _set_tool_voltage(core: Core, voltage: Value) -> None:
    if number(voltage) not in _TOOL_VOLTAGES:
        raise ScriptFault("tool voltage [V]", value=voltage, limit=_TOOL_VOLTAGES)
    core.signals.tool_voltage = int(voltage)


_REGISTERS = 128
"""Modbus signals of a program, and registers of one."""
_READ: dict[str, Callable[[Core, Value], Value]] = {
    "get_standard_analog_in": lambda core, n: core.signals.analog_in[_pair(n)],
    "get_standard_analog_out": lambda core, n: core.signals.analog_out[_pair(n)],
    "get_tool_analog_in": lambda core, n: 0.0 * _pair(n),
    "get_flag": lambda core, n: core.signals.flags[_flag(n)],
}
_ON_SIGNALS: dict[str, Any] = {
    **_READ,
    "rtde_set_watchdog": _rtde_set_watchdog,
    "get_analog_in": _READ["get_standard_analog_in"],
    "get_analog_out": _READ["get_standard_analog_out"],
    "set_standard_analog_out": _set_analog_out,
    "set_analog_out": _set_analog_out,
    "set_tool_voltage": _set_tool_voltage,
    "set_flag": _set_flag,
}
for _word, _kind in (("integer", "int"), ("float", "double"), ("boolean", "bit")):
    _ON_SIGNALS[f"read_input_{_word}_register"] = _reader(_kind, lambda core: core.inputs)
    _ON_SIGNALS[f"read_output_{_word}_register"] = _reader(_kind, lambda core: core.outputs)
    _ON_SIGNALS[f"write_output_{_word}_register"] = _writer(_kind)
_GROUPS = (("", 0, 18), ("standard_", 0, 8), ("configurable_", 8, 8), ("tool_", 16, 2))
for _group, _shift, _count in _GROUPS:
    _ON_SIGNALS[f"set_{_group}digital_out"] = _digital_out(_shift, _count)
    _ON_SIGNALS[f"get_{_group}digital_out"] = _digital(_shift, _count, inputs=False)
    _ON_SIGNALS[f"get_{_group}digital_in"] = _digital(_shift, _count, inputs=True)


def _add_signal(
    core: Core,
    IP: Value,
    slave_number: Value,
    signal_address: Value,
    signal_type: Value,
    signal_name: Value,
    sequential_mode: Value = False,
    register_count: Value = 1,
) -> bool:
    return _signal(core, signal_name, register_count)


def _add_rw_signal(
    core: Core,
    IP: Value,
    slave_number: Value,
    read_address: Value,
    read_register_count: Value,
    write_address: Value,
    write_register_count: Value,
    signal_name: Value,
    sequential_mode: Value = False,
) -> bool:
    return _signal(core, signal_name, read_register_count)


def _signal(core: Core, name: Value, count: Value) -> bool:
    # No device answers: inputs are zero, outputs what was written last.
    core.lacks("modbus")
    many = int(number(count))
    if not 1 <= many <= _REGISTERS or len(core.signals.modbus) >= _REGISTERS:
        raise ScriptFault("registers of a Modbus signal, or signals", limit=(1, _REGISTERS))
    core.signals.modbus[shown(name)] = 0 if many == 1 else [0] * many
    return True


def _signal_status(core: Core, signal_name: Value, is_secondary_program: Value = False) -> Value:
    value = core.signals.modbus.get(shown(signal_name), 0)
    return [*value] if value.__class__ is list else value


def _set_signal(
    core: Core, signal_name: Value, register_value: Value, is_secondary_program: Value = False
) -> bool:
    name = shown(signal_name)
    known = name in core.signals.modbus
    if known:
        core.signals.modbus[name] = register_value
    return known


def _set_digital_signal(
    core: Core, signal_name: Value, digital_value: Value, is_secondary_program: Value = False
) -> bool:
    return _set_signal(core, signal_name, digital_value)


def _delete_signal(core: Core, signal_name: Value) -> bool:
    return core.signals.modbus.pop(shown(signal_name), None) is not None


_TEXTMSG: dict[str, Callable[[Core, Value, Value], None]] = {
    "textmsg": lambda core, s1, s2="": core.say(shown(s1) + shown(s2))
}
IO: dict[str, Any] = {
    **_ON_SIGNALS,
    **_TEXTMSG,
    "popup": _popup,
    "modbus_add_signal": _add_signal,
    "modbus_add_rw_signal": _add_rw_signal,
    "modbus_delete_signal": _delete_signal,
    "modbus_get_signal_status": _signal_status,
    "modbus_set_output_register": _set_signal,
    "modbus_set_output_signal": _set_digital_signal,
}
"""Built-ins that read and write what RTDE shows."""


_YES: dict[int, str] = {
    0: """end_screw_driving stop_conveyor_tracking set_input_actions_to_default powerdown
        high_holding_torque_disable high_holding_torque_enable""",
    1: """set_tool_output_mode
        set_runstate_outputs set_safety_mode_transition_hardness reset_revolution_counter set_pos
        encoder_set_tick_count encoder_enable_set_tick_count path_offset_disable
        path_offset_set_alpha_filter pause_on_error_code""",
    2: """set_conveyor_tick_count set_standard_analog_input_domain
        set_analog_outputdomain set_analog_inputrange set_tool_analog_input_domain
        position_deviation_warning set_tool_digital_output_mode
        set_standard_digital_input_action set_configurable_digital_input_action
        set_tool_digital_input_action set_gp_boolean_input_action
        set_runstate_standard_digital_output_to_value
        set_runstate_configurable_digital_output_to_value
        set_runstate_tool_digital_output_to_value set_runstate_gp_boolean_output_to_value
        set_runstate_standard_analog_output_to_value set_euromap_output
        set_euromap_runstate_dependent_choice write_port_bit write_port_register screw_driving
        path_offset_enable path_offset_set""",
    3: """track_conveyor_linear modbus_set_digital_input_action path_offset_set_max_offset""",
    4: """ft_rtde_input_enable enable_external_ft_sensor track_conveyor_circular
        conveyor_pulse_decode encoder_enable_pulse_decode""",
    6: "set_tool_communication",
}
_NOUGHT: dict[int, str] = {
    0: "get_conveyor_tick_count get_tool_current",
    1: """encoder_get_tick_count get_euromap_input get_euromap_output read_port_bit
        read_port_register""",
    2: "encoder_unwind_delta_tick_count",
}
_BY_NAME: dict[str, tuple[bool | int, str]] = {
    "modbus_get_error": (0, "signal_name"),
    "modbus_get_time_since_signal_invalid": (0, "signal_name"),
    "modbus_send_custom_command": (True, "IP slave_number function_code data"),
    "modbus_set_signal_update_frequency": (True, "signal_name update_frequency"),
    "modbus_set_signal_watchdog": (True, "signal_name timeout"),
}
"""Those whose arguments programs name: the answer, and the names."""


def _absent(name: str, answer: bool | int, names: Sequence[str]) -> Builtin:
    def say(core: Core, *_: Value) -> Value:
        core.lacks(name)
        return answer

    return Builtin(say, tuple(names), dict.fromkeys(names, 0), controls=True, takes_time=False)


ABSENT = {
    **{
        name: _absent(name, answer, [f"argument{k + 1}" for k in range(count)])
        for answer, table in ((True, _YES), (0, _NOUGHT))
        for count, names in table.items()
        for name in names.split()
    },
    **{name: _absent(name, answer, names.split()) for name, (answer, names) in _BY_NAME.items()},
}
"""Built-ins that do nothing."""
