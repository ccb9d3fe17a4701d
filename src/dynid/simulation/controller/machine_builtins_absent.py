"""Built-ins that exist so that programs compile: each says once that it is not simulated."""

from __future__ import annotations

from typing import Any

from dynid.simulation.controller.machine_core import Core
from dynid.simulation.controller.urscript.builtin import Builtin, Kind
from dynid.simulation.controller.urscript.values import Value

_WEIGHT = 20
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
    "modbus_add_signal": (
        True,
        "IP slave_number signal_address signal_type signal_name sequential_mode",
    ),
    "modbus_delete_signal": (True, "signal_name"),
    "modbus_get_signal_status": (0, "signal_name is_secondary_program"),
    "modbus_send_custom_command": (True, "IP slave_number function_code data"),
    "modbus_set_output_register": (True, "signal_name register_value is_secondary_program"),
    "modbus_set_output_signal": (True, "signal_name digital_value is_secondary_program"),
    "modbus_set_signal_update_frequency": (True, "signal_name update_frequency"),
}
"""Those whose arguments programs name: the answer, and the names."""


def _absent(name: str, answer: bool | int, names: tuple[str, ...]) -> Builtin:
    def say(core: Core, *_: Value) -> Value:
        core.lacks(name)
        return answer

    return Builtin(name, say, Kind.INSTANT, names, (0,) * len(names), _WEIGHT)


def _all(answer: bool | int, table: dict[int, str]) -> list[Any]:
    return [
        _absent(name, answer, tuple(f"argument{k + 1}" for k in range(count)))
        for count, names in table.items()
        for name in names.split()
    ]


ABSENT: list[Builtin] = [
    *_all(True, _YES),
    *_all(0, _NOUGHT),
    *(_absent(name, answer, tuple(names.split())) for name, (answer, names) in _BY_NAME.items()),
]
"""Built-ins that do nothing."""
