"""The controller's side of RTDE, byte by byte, without a socket."""

import struct

import numpy as np
import pytest

from dynid.protocol import INPUTS, OUTPUTS, Framer, Kind, ProtocolError, Recipe, rtde
from dynid.protocol.rtde import frame
from dynid.robot import load_robot
from dynid.simulation import simulated_arm
from urtwin import ControllerMachine
from urtwin.rtde import LONGEST, Owners, RtdeSession


@pytest.fixture
def owners():
    return Owners()


@pytest.fixture
def session(machine, owners):
    session = RtdeSession(machine, owners)
    assert session.receive(rtde.request_protocol(2)) == rtde.answer(
        Kind.REQUEST_PROTOCOL_VERSION, True
    )
    return session


def package(machine, recipe):
    return recipe.packet(machine.numbers(*recipe.names))


def answers(session, request):
    return Framer().feed(session.receive(request))


def outputs(session, names, frequency=125.0):
    ((_, payload),) = answers(session, rtde.request_outputs(names, frequency))
    return rtde.read_setup_answer(Kind.SETUP_OUTPUTS, payload, session.protocol)


def inputs(session, names):
    ((_, payload),) = answers(session, rtde.request_inputs(names))
    return rtde.read_setup_answer(Kind.SETUP_INPUTS, payload, session.protocol)


@pytest.mark.parametrize(("version", "accepted"), [(0, 0), (1, 1), (2, 1), (3, 0)])
def test_protocols_one_and_two_are_spoken(machine, owners, version, accepted):
    session = RtdeSession(machine, owners)
    assert session.receive(rtde.request_protocol(version)) == b"\x00\x04V" + bytes((accepted,))
    assert session.protocol == (2 if version == 2 else 1)


def test_the_software_version_is_told(session):
    ((kind, payload),) = answers(session, rtde.frame(rtde.Kind.GET_URCONTROL_VERSION))
    assert (kind, struct.unpack(">4I", payload)) == (Kind.GET_URCONTROL_VERSION, (3, 15, 8, 106339))


def test_a_comma_at_the_end_is_no_variable(session):
    request = frame(Kind.SETUP_OUTPUTS, struct.pack(">d", 125.0) + b"timestamp,actual_q,")
    assert session.receive(request) == b"\x00\x13O\x01DOUBLE,VECTOR6D"
    assert (
        session.receive(frame(Kind.SETUP_INPUTS, b"input_int_register_0,")) == b"\x00\x09I\x01INT32"
    )


def test_unknown_outputs_make_a_recipe_that_sends_nothing(session):
    assert outputs(session, ["timestamp", "nonsense"]) == (0, ("DOUBLE", "NOT_FOUND"))
    session.receive(rtde.frame(rtde.Kind.START))
    assert not session.streaming
    assert outputs(session, ["timestamp"]) == (1, ("DOUBLE",))
    assert session.streaming


def test_outputs_that_are_newer_than_the_software_are_unknown(session):
    assert outputs(session, ["actual_current_as_torque"]) == (0, ("NOT_FOUND",))
    assert outputs(session, ["payload_inertia"]) == (1, ("VECTOR6D",))


@pytest.mark.parametrize(
    ("frequency", "every"), [(125, 1), (126, 1), (500, 1), (63, 1), (62.5, 2), (40, 3), (1, 125)]
)
def test_every_so_many_cycles_on_the_cb_series(session, frequency, every):
    outputs(session, ["timestamp"], frequency)
    assert session.every == every


@pytest.mark.parametrize(
    ("frequency", "every"), [(500, 1), (200, 2), (125, 4), (100, 5), (0.2, 500)]
)
def test_every_so_many_cycles_on_the_e_series(e_machine, frequency, every):
    session = RtdeSession(e_machine, Owners())
    session.receive(rtde.request_protocol(2))
    outputs(session, ["timestamp"], frequency)
    assert session.every == every


@pytest.mark.parametrize("frequency", [0.0, -1.0, float("nan"), float("inf")])
def test_a_frequency_that_is_none_is_refused_in_words(session, frequency):
    text, setup = answers(session, rtde.request_outputs(["timestamp"], frequency))
    assert "no frequency" in rtde.read_text_message(text.payload, 2).message
    assert setup.payload[0] == 0


def test_protocol_one_has_no_recipe_numbers(machine, owners):
    session = RtdeSession(machine, owners)
    # A client's text has the form of protocol 2 all the same.
    assert session.receive(rtde.text_message(rtde.TextMessage("hello", "me"), 2)) == b""
    assert (
        session.receive(frame(Kind.SETUP_OUTPUTS, b"timestamp,actual_q"))
        == b"\x00\x12ODOUBLE,VECTOR6D"
    )
    session.receive(rtde.frame(rtde.Kind.START))
    machine.tick()
    packet = package(machine, session.outputs)
    assert packet[:3] == b"\x00\x3bU"
    assert struct.unpack_from(">d", packet, 3)[0] == machine.output("timestamp")
    assert Recipe.of(["a"], ["INT32"], 1).packet([5])[:4] == b"\x00\x08U\x01"


def test_inputs_belong_to_one_client_until_it_leaves(machine, owners, session):
    other = RtdeSession(machine, owners)
    assert inputs(session, ["input_int_register_0", "input_double_register_0"])[0] == 1
    # The same client may name a variable again.
    assert inputs(session, ["input_int_register_0"])[0] == 2
    assert inputs(other, ["input_int_register_1", "input_int_register_0"]) == (
        0,
        ("INT32", "IN_USE"),
    )
    # What was refused as a whole belongs to nobody.
    assert inputs(session, ["input_int_register_1"])[0] == 3
    session.close()
    assert inputs(other, ["input_int_register_0"])[0] == 1


def test_inputs_reach_the_machine(machine, session):
    inputs(session, ["input_int_register_24", "input_double_register_3"])
    recipe = Recipe.of(["i", "d"], ["INT32", "DOUBLE"], 1)
    assert session.receive(recipe.packet([-7, 0.25])) == b""
    machine.tick()
    assert machine.output("input_int_register_24") == -7
    assert machine.output("input_double_register_3") == 0.25


def test_a_package_longer_than_its_recipe_is_read_like_a_real_controller_does(machine, session):
    # ur_rtde 1.6.5 sends getForwardKinematics(q, tcp) so.
    inputs(session, ["input_int_register_24"])
    session.receive(frame(Kind.DATA_PACKAGE, b"\x01" + struct.pack(">i", 9) + bytes(48)))
    machine.tick()
    assert machine.output("input_int_register_24") == 9


@pytest.mark.parametrize("payload", [b"", b"\x00", b"\x07abcd", b"\x01\x00"])
def test_packages_of_no_recipe_are_refused_in_words(session, payload):
    inputs(session, ["input_int_register_24"])
    ((kind, words),) = answers(session, frame(Kind.DATA_PACKAGE, payload))
    assert kind == Kind.TEXT_MESSAGE
    assert rtde.read_text_message(words, 2).level == rtde.MessageLevel.ERROR


def test_a_client_that_never_learns_is_given_up(session):
    with pytest.raises(ProtocolError, match="too many mistakes"):
        session.receive(frame(Kind.DATA_PACKAGE, b"\x09") * 101)


def test_bounds_of_recipes(session):
    with pytest.raises(ProtocolError, match=f"allowed: {rtde.NAMES_LIMIT} bytes"):
        session.receive(rtde.request_outputs(["timestamp"] * 1229, 125.0))
    for number in range(1, 256):
        assert inputs(session, ["input_int_register_24"])[0] == number
    text, setup = answers(session, rtde.request_inputs(["input_int_register_24"]))
    assert "255" in rtde.read_text_message(text.payload, 2).message
    assert setup.payload[0] == 0


def test_pause_stops_the_stream(session):
    outputs(session, ["timestamp"])
    assert session.receive(rtde.frame(rtde.Kind.START)) == b"\x00\x04S\x01"
    assert session.streaming
    assert session.receive(rtde.frame(rtde.Kind.PAUSE)) == b"\x00\x04P\x01"
    assert not session.streaming


def test_every_output_of_the_guide_can_be_packed(machine, e_machine):
    for controller in (machine, e_machine):
        controller.tick()
        session = RtdeSession(controller, Owners())
        session.receive(rtde.request_protocol(2))
        for name, field in OUTPUTS.items():
            if field.exists_in(controller.core.version[:3]):
                assert outputs(session, [name]) == (1, (field.type.name,))
                recipe = session.outputs
                assert len(package(controller, recipe)) == 3 + recipe.size


def test_every_input_of_the_guide_can_be_written(machine, session):
    for name, field in INPUTS.items():
        number, types = inputs(session, [name])
        assert (types, number > 0) == ((field.type.name,), True)
        zero = Recipe((name,), (field.type,), number).packet([0] * field.type.count)
        assert session.receive(zero) == b"", name
    machine.tick()


@pytest.mark.parametrize("number", [float("nan"), float("inf"), -float("inf"), 1e300, -1.0])
def test_no_number_in_an_input_breaks_the_controller(machine, session, number):
    machine.run_script("def p():\n while True:\n servoj([0,-1.57,0,-1.57,0,0])\n end\nend\n")
    for name, field in INPUTS.items():
        recipe_number, _ = inputs(session, [name])
        recipe = Recipe((name,), (field.type,), recipe_number)
        extreme = number if field.type.code == "d" else 255 if field.type.code in "BI" else -1
        session.receive(recipe.packet([extreme] * field.type.count))
    for _ in range(20):
        machine.tick()
    for name in ("speed_scaling", "target_q", "actual_q", "standard_analog_output0"):
        outputs(session, [name])
        values = session.outputs.unpack(package(machine, session.outputs)[3:])
        assert np.isfinite(values[name]).all(), name


def test_in_virtual_time_one_package_of_each_recipe_acts_in_a_cycle(machine):
    session = RtdeSession(machine, Owners(), orderly=True)
    session.receive(rtde.request_protocol(2))
    session.receive(rtde.request_inputs(["input_int_register_24"]))
    session.receive(rtde.request_inputs(["input_int_register_25"]))
    one, two = (Recipe.of([f"input_int_register_{24 + k}"], ["INT32"], k + 1) for k in range(2))
    for value in (1, 2, 3):
        session.receive(one.packet([value]) + two.packet([-value]))
    seen = []
    for _ in range(4):
        session.queue.apply_next(guided=True)
        seen.append([machine.output(f"input_int_register_{k}") for k in (24, 25)])
    assert seen == [[1, -1], [2, -2], [3, -3], [3, -3]]


def test_set_points_are_not_late_behind_signs_of_life(machine):
    session = RtdeSession(machine, Owners(), orderly=True)
    session.receive(rtde.request_protocol(2))
    number, _ = inputs(session, ["input_double_register_0"])
    point = Recipe.of(["input_double_register_0"], ["DOUBLE"], number)
    number, _ = inputs(session, ["input_int_register_25"])
    life = Recipe.of(["input_int_register_25"], ["INT32"], number)
    moved, alive = point.packet([1.0]), life.packet([0])
    session.receive(moved + life.packet([7]) + 20 * alive + point.packet([2.0]) + moved)
    seen = []
    for _ in range(4):
        session.queue.apply_next(guided=True)
        seen.append(machine.output("input_double_register_0"))
    assert seen == [1.0, 2.0, 1.0, 1.0]
    # What another client says belongs to one set point each, equal or not.
    other = RtdeSession(machine, Owners(), orderly=True)
    number, _ = inputs(other, ["input_int_register_24"])
    index = Recipe.of(["input_int_register_24"], ["INT32"], number)
    other.receive(2 * index.packet([3]) + index.packet([4]))
    seen = []
    for _ in range(3):
        other.queue.apply_next(guided=True)
        seen.append(machine.output("input_int_register_24"))
    assert seen == [3, 3, 4]


def test_of_a_client_that_writes_too_much_the_newest_act(machine):
    session = RtdeSession(machine, Owners(), orderly=True)
    session.receive(rtde.request_protocol(2))
    session.receive(rtde.request_inputs(["input_int_register_24"]))
    recipe = Recipe.of(["input_int_register_24"], ["INT32"], 1)
    for value in range(1, 10 * LONGEST + 1):
        session.receive(recipe.packet([value]))
    session.queue.apply_next(guided=True)
    assert machine.output("input_int_register_24") == 9 * LONGEST + 1
    session.close()
    assert machine.output("input_int_register_24") == 10 * LONGEST


def test_without_a_stream_all_acts_at_once(machine):
    session = RtdeSession(machine, Owners(), orderly=True)
    session.receive(rtde.request_protocol(2))
    session.receive(rtde.request_inputs(["input_int_register_24"]))
    recipe = Recipe.of(["input_int_register_24"], ["INT32"], 1)
    # A wish to stop behind signs of life that came in a bunch.
    for value in range(1, 40):
        session.receive(recipe.packet([value]))
    session.queue.apply_next(guided=False)
    assert machine.output("input_int_register_24") == 39


def test_all_outputs_of_the_newest_software_fit_one_recipe():
    arm = simulated_arm(load_robot("ur5e"))
    machine = ControllerMachine(arm, rate_hz=500.0, version=(5, 25, 0, 0))
    machine.tick()
    session = RtdeSession(machine, Owners())
    session.receive(rtde.request_protocol(2))
    answer = session.receive(rtde.request_outputs(list(OUTPUTS), 500.0))
    ((_, payload),) = Framer().feed(answer)
    number, types = rtde.read_setup_answer(Kind.SETUP_OUTPUTS, payload, 2)
    assert number == 1
    recipe = Recipe.of(OUTPUTS, types, number)
    packed = package(machine, recipe)
    assert recipe.unpack(packed[3:])["robot_mode"] == 7
