"""Built-ins that exist so that programs compile: each says once that it is not simulated."""

from __future__ import annotations

from typing import Any

from dynid.simulation.controller.machine_core import Core
from dynid.simulation.controller.urscript.builtin import Builtin, Kind
from dynid.simulation.controller.urscript.values import Value

_WEIGHT = 20
_YES: dict[int, str] = {
    0: "end_screw_driving stop_conveyor_tracking set_input_actions_to_default powerdown",
    1: """set_tool_output_mode
        set_runstate_outputs set_safety_mode_transition_hardness reset_revolution_counter set_pos
        encoder_set_tick_count encoder_enable_set_tick_count path_offset_disable
        path_offset_set_alpha_filter modbus_delete_signal pause_on_error_code""",
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
        modbus_set_signal_update_frequency path_offset_enable path_offset_set""",
    3: """track_conveyor_linear modbus_set_output_signal modbus_set_output_register
        modbus_set_digital_input_action path_offset_set_max_offset""",
    4: """ft_rtde_input_enable enable_external_ft_sensor track_conveyor_circular
        conveyor_pulse_decode encoder_enable_pulse_decode""",
    5: "modbus_add_signal modbus_send_custom_command",
    6: "set_tool_communication",
}
_NOUGHT: dict[int, str] = {
    0: "get_conveyor_tick_count get_tool_current",
    1: """encoder_get_tick_count get_euromap_input get_euromap_output read_port_bit
        read_port_register modbus_get_signal_status""",
    2: "encoder_unwind_delta_tick_count",
}


def _absent(name: str, answer: bool | int, parameters: int) -> Builtin:
    def say(core: Core, *_: Value) -> Value:
        core.lacks(name)
        return answer

    names = tuple(f"argument{k + 1}" for k in range(parameters))
    return Builtin(name, say, Kind.INSTANT, names, (0,) * parameters, _WEIGHT)


def _all(answer: bool | int, table: dict[int, str]) -> list[Any]:
    return [
        _absent(name, answer, count) for count, names in table.items() for name in names.split()
    ]


ABSENT: list[Builtin] = [*_all(True, _YES), *_all(0, _NOUGHT)]
"""Built-ins that do nothing."""
