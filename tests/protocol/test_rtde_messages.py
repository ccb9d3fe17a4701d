"""Messages against bytes laid out by hand from the guide, and against their own inverse."""

import contextlib
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.protocol import INPUTS, OUTPUTS, DataType, Framer, Kind, ProtocolError, Recipe, rtde


def payload_of(packet: bytes) -> bytes:
    (found,) = Framer().feed(packet)
    return found.payload


def test_requests_are_the_bytes_of_the_guide():
    assert rtde.request_protocol(2) == b"\x00\x05V\x00\x02"
    assert rtde.frame(Kind.GET_URCONTROL_VERSION) == b"\x00\x03v"
    assert rtde.frame(Kind.START) == b"\x00\x03S"
    assert rtde.request_outputs(["a", "b"], None) == b"\x00\x06Oa,b"
    assert (
        rtde.request_outputs(["a", "b"], 125.0) == b"\x00\x0eO" + struct.pack(">d", 125.0) + b"a,b"
    )
    assert rtde.request_inputs(["a"]) == b"\x00\x04Ia"


def test_answers_are_the_bytes_of_the_guide():
    assert rtde.answer(Kind.START, True) == b"\x00\x04S\x01"
    assert rtde.answer_software_version(3, 15, 8, 106339) == b"\x00\x13v" + struct.pack(
        ">4I", 3, 15, 8, 106339
    )
    assert rtde.answer_setup(Kind.SETUP_INPUTS, ["INT32"], 7) == b"\x00\x09I\x07INT32"
    assert rtde.answer_setup(Kind.SETUP_OUTPUTS, ["INT32"], None) == b"\x00\x08OINT32"


@pytest.mark.parametrize("protocol", rtde.PROTOCOLS)
def test_setups_return_to_what_was_asked(protocol):
    frequency = None if protocol == 1 else 250.0
    packet = payload_of(rtde.request_outputs(["timestamp", "actual_q", ""], frequency))
    setup = rtde.read_output_setup(packet, protocol)
    assert setup == (("timestamp", "actual_q"), frequency)
    number = None if protocol == 1 else 1
    reply = payload_of(rtde.answer_setup(Kind.SETUP_OUTPUTS, ["DOUBLE", "VECTOR6D"], number))
    assert rtde.read_setup_answer(Kind.SETUP_OUTPUTS, reply, protocol) == (
        number,
        ("DOUBLE", "VECTOR6D"),
    )


def test_text_messages_of_both_protocols():
    message = rtde.TextMessage("stop", "script", rtde.MessageLevel.ERROR)
    assert rtde.text_message(message, 2) == b"\x00\x10M\x04stop\x06script\x01"
    assert rtde.text_message(message, 1) == b"\x00\x08M\x01stop"
    assert rtde.read_text_message(payload_of(rtde.text_message(message, 2)), 2) == message
    in_one = rtde.read_text_message(payload_of(rtde.text_message(message, 1)), 1)
    assert in_one == rtde.TextMessage("stop", "", rtde.MessageLevel.ERROR)


@given(junk=st.binary(max_size=40), protocol=st.sampled_from(rtde.PROTOCOLS))
def test_junk_is_read_or_refused_in_words(junk, protocol):
    for read in (
        lambda: rtde.read_text_message(junk, protocol),
        lambda: rtde.read_output_setup(junk, protocol),
        lambda: rtde.read_names(junk),
        lambda: rtde.read_protocol_request(junk),
        lambda: rtde.read_software_version(junk),
        lambda: rtde.read_setup_answer(Kind.SETUP_INPUTS, junk, protocol),
        lambda: rtde.read_answer(junk),
    ):
        # Whatever else it raises fails the test.
        with contextlib.suppress(ProtocolError):
            read()


ONE_OF_EACH = ("VECTOR6D", "BOOL", "UINT8", "INT32", "UINT64", "VECTOR3D", "UINT32", "VECTOR6INT32")
NUMBERS = (0.1, -2.0, 3.0, 4.0, 5.0, 6.5, True, 200, -7, 2**40, 1.0, 2.0, 3.0, 2**31, *range(-3, 3))


def test_a_data_package_is_packed_big_endian_in_order():
    recipe = Recipe.of("abcdefgh", ONE_OF_EACH, 3)
    expected = b"\x03" + struct.pack(">6d?BiQ3dI6i", *NUMBERS)
    assert recipe.pack_numbers(NUMBERS) == expected
    assert payload_of(recipe.packet(NUMBERS)) == expected
    assert recipe.numbers(expected) == NUMBERS
    values = recipe.unpack(expected)
    assert values["a"] == NUMBERS[:6]
    assert values["e"] == 2**40


def test_protocol_one_sends_values_alone():
    recipe = Recipe.of(["a"], ["DOUBLE"], None)
    assert recipe.pack_numbers([1.5]) == struct.pack(">d", 1.5)
    assert recipe.unpack(struct.pack(">d", 1.5)) == {"a": 1.5}


def test_refused_variables_are_named():
    with pytest.raises(ProtocolError, match=r"c NOT_FOUND.*no such variable"):
        Recipe.of(["a", "c"], ["DOUBLE", "NOT_FOUND"])
    with pytest.raises(ProtocolError, match="1 types; allowed: 2 variables"):
        Recipe.of(["a", "c"], ["DOUBLE"])


def test_packages_of_another_recipe_are_refused():
    recipe = Recipe.of(["a"], ["DOUBLE"], 1)
    with pytest.raises(ProtocolError, match="another recipe; got 2"):
        recipe.unpack(b"\x02" + bytes(8))
    with pytest.raises(ProtocolError, match="10 bytes; allowed: 9 bytes"):
        recipe.unpack(bytes(10))
    with pytest.raises(ProtocolError, match="do not fit"):
        recipe.pack_numbers([1.0, 2.0])


def test_every_type_packs_what_it_counts():
    for kind in DataType:
        assert Recipe(("x",), (kind,), None).size == struct.calcsize(f">{kind.count}{kind.code}")


def test_the_variables_of_the_guide_by_version():
    cb_2015, cb_last, e_first, e_last = (3, 4, 5), (3, 15, 8), (5, 0, 0), (5, 12, 0)
    has = lambda name, version: OUTPUTS[name].exists_in(version)  # noqa: E731
    assert has("actual_q", cb_2015)
    assert has("output_int_register_0", cb_2015)
    assert not has("output_int_register_24", cb_2015)
    assert has("output_int_register_24", cb_last)
    assert has("payload_inertia", cb_last)
    assert not has("payload_inertia", e_first)
    assert has("ft_raw_wrench", e_last)
    assert not has("ft_raw_wrench", cb_last)
    assert not has("actual_current_as_torque", e_last)
    assert has("actual_current_as_torque", (10, 11, 0))
    assert not has("actual_current_as_torque", (10, 10, 0))
    assert has("ft_raw_wrench", (10, 10, 0))
    assert len([name for name in INPUTS if "register" in name]) == 2 + 64 + 2 * 48


# Universal_Robots_Client_Library, tests/fake_rtde_server.cpp, in 2026: all outputs of UR's
# software and their types, registers apart.
UR_TYPES = {
    "DOUBLE": """timestamp actual_execution_time target_execution_time speed_scaling
        target_speed_fraction actual_momentum actual_main_voltage actual_robot_voltage
        actual_robot_current standard_analog_input0 standard_analog_input1
        standard_analog_output0 standard_analog_output1 io_current euromap67_24V_voltage
        euromap67_24V_current tool_analog_input0 tool_analog_input1 tool_output_current
        tool_temperature tcp_force_scalar joint_position_deviation_ratio
        collision_detection_ratio payload actual_robot_energy_consumed
        actual_robot_braking_energy_dissipated""",
    "VECTOR6D": """target_q target_qd target_qdd target_current target_moment actual_q actual_qd
        actual_current actual_current_window actual_current_as_torque joint_control_output
        actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose target_TCP_speed
        tcp_offset actual_TCP_acceleration target_TCP_acceleration joint_temperatures
        actual_joint_voltage ft_raw_wrench wrench_calc_from_currents payload_inertia
        target_base_acceleration target_base_wrench""",
    "VECTOR3D": """actual_tool_accelerometer elbow_position elbow_velocity payload_cog
        target_gravity""",
    "VECTOR6INT32": "joint_mode",
    "INT32": """robot_mode safety_mode safety_status tool_output_voltage time_scale_source
        encoder0_raw encoder1_raw""",
    "UINT32": """runtime_state robot_status_bits safety_status_bits analog_io_types
        euromap67_input_bits euromap67_output_bits tool_mode tool_analog_input_types
        script_control_line input_bit_registers0_to_31 input_bit_registers32_to_63
        output_bit_registers0_to_31 output_bit_registers32_to_63""",
    "UINT64": """actual_digital_input_bits actual_configurable_digital_input_bits
        actual_digital_output_bits actual_configurable_digital_output_bits control_step""",
    "UINT8": "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode",
}


def test_every_output_has_the_type_that_ur_s_library_expects():
    expected = {name: kind for kind, names in UR_TYPES.items() for name in names.split()}
    for side in ("input", "output"):
        expected |= {f"{side}_bit_register_{k}": "BOOL" for k in range(64, 128)}
        expected |= {f"{side}_int_register_{k}": "INT32" for k in range(48)}
        expected |= {f"{side}_double_register_{k}": "DOUBLE" for k in range(48)}
    assert {name: field.type.name for name, field in OUTPUTS.items()} == expected
