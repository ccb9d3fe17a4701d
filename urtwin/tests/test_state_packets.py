"""The packets of 30001 to 30003, taken apart by the tables of UR's guide, not by our packer."""

import socket
import struct

import numpy as np
import pytest

from dynid.protocol import RobotMode, RuntimeState
from dynid.robot import load_robot
from dynid.simulation import simulated_arm
from rtde_client import TIMEOUT_S, RtdeClient, send_script
from urtwin import ControllerMachine
from urtwin.primary import packets, realtime_state, robot_state, version_message

HEAD = struct.Struct(">iB")
# A robot state of software 5.8, recorded by UR: Universal_Robots_Client_Library,
# tests/test_primary_parser.cpp.
FIRST = {
    0: 47, 1: 251, 4: 101, 5: 225, 9: 53, 3: 75, 2: 37,
    6: 445, 7: 61, 8: 9, 10: 43, 11: 26, 12: 8,
}  # fmt: skip
"""Sizes of the packages in the first state that a client reads, in their order [bytes]."""
# python-urx, urx/ursecmon.py, knows software 3.0 and 3.2 by the size of the first package.
OLDER = {(3, 0): {0: 38, 4: 53, 3: 72, 8: 7}, (3, 4): {0: 46, 4: 101, 3: 74, 8: 7}}


def of_software(*version, robot="ur5"):
    arm = simulated_arm(load_robot(robot))
    rate = 125.0 if version[0] < 5 else 500.0
    machine = ControllerMachine(arm, rate_hz=rate, version=(*version, 0, 0)[:4])
    machine.tick()
    return machine


def sizes(packet):
    return {kind: len(body) + HEAD.size for kind, body in packages(packet).items()}


def packages(packet):
    """Packages of a robot state by type."""
    size, kind = HEAD.unpack_from(packet)
    assert (size, kind) == (len(packet), 16)
    found, at = {}, HEAD.size
    while at < size:
        length, kind = HEAD.unpack_from(packet, at)
        found[kind] = packet[at + HEAD.size : at + length]
        at += length
    assert at == size
    return found


def test_the_first_state_is_laid_out_as_one_recorded_from_a_robot(e_machine):
    e_machine.tick()
    assert list(sizes(robot_state(e_machine, first=True)).items()) == list(FIRST.items())


def test_later_states_leave_out_what_does_not_change(e_machine):
    e_machine.tick()
    later = {kind: size for kind, size in FIRST.items() if kind not in (5, 6)}
    assert list(sizes(robot_state(e_machine)).items()) == list(later.items())


@pytest.mark.parametrize("version", OLDER)
def test_software_before_3_5_has_shorter_packages(version):
    found = sizes(robot_state(of_software(*version), first=True))
    assert found.items() >= OLDER[version].items()
    assert not {10, 11, 12}.intersection(found)


@pytest.mark.parametrize(
    ("robot", "a", "d"),
    [
        ("ur5", [0, -0.425, -0.39225, 0, 0, 0], [0.089159, 0, 0, 0.10915, 0.09465, 0.0823]),
        ("ur5e", [0, -0.425, -0.3922, 0, 0, 0], [0.1625, 0, 0, 0.1333, 0.0997, 0.0996]),
    ],
)
def test_the_kinematics_are_the_dh_table_of_the_arm(robot, a, d):
    # src/primary/robot_state/kinematics_info.cpp and configuration_data.cpp of the same library.
    found = packages(robot_state(of_software(5, 12, robot=robot), first=True))
    *checksums, status = struct.unpack(">6I", found[5][:24]) + struct.unpack(">I", found[5][-4:])
    assert (set(checksums), status) == ({0xFFFFFFFF}, 0)
    alpha = [np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0]
    table = np.reshape(struct.unpack(">24d", found[5][24:-4]), (4, 6))
    np.testing.assert_allclose(table, [[0] * 6, a, d, alpha], rtol=0, atol=1e-12)
    numbers = struct.unpack(">53d4i", found[6])
    np.testing.assert_allclose(numbers[:12:2], -2 * np.pi)
    np.testing.assert_allclose(numbers[12:24:2], np.pi)
    np.testing.assert_allclose(
        np.reshape(numbers[29:53], (4, 6)), [a, d, alpha, [0] * 6], rtol=0, atol=1e-12
    )
    assert numbers[55] == 1, "the type of a UR5"


def test_robot_mode_data(machine):
    machine.tick()
    (stamp, *flags, mode, control, target, scaling, limit, _) = struct.unpack(
        ">Q7?BBdddB", packages(robot_state(machine))[0]
    )
    assert stamp == round(1e6 * machine.output("timestamp"))
    assert flags == [True, True, True, False, False, False, False]
    assert (mode, control, target, scaling, limit) == (7, 0, 1.0, 1.0, 1.0)
    machine.core.protective_stop("test")
    machine.tick()
    flags = struct.unpack_from(">Q7?", packages(robot_state(machine))[0])[1:]
    assert flags[4]


def test_joint_data(machine):
    machine.tick()
    body = packages(robot_state(machine))[1]
    joints = [struct.unpack_from(">dddffffB", body, 41 * k) for k in range(6)]
    columns = list(zip(*joints, strict=True))
    assert list(columns[0]) == machine.output("actual_q")
    assert list(columns[1]) == machine.output("target_q")
    np.testing.assert_allclose(columns[3], machine.output("actual_current"), atol=1e-6)
    np.testing.assert_allclose(columns[5], machine.output("joint_temperatures"), rtol=1e-6)
    assert set(columns[7]) == {253}


def test_cartesian_info(machine):
    machine.tick()
    numbers = struct.unpack(">12d", packages(robot_state(machine))[4])
    assert list(numbers[:6]) == machine.output("actual_TCP_pose")


@pytest.mark.parametrize(
    ("version", "size"),
    [
        *(((3, 0), 1044), ((3, 2), 1060), ((3, 5), 1108), ((3, 10), 1116), ((3, 15), 1220)),
        *(((5, 0), 1108), ((5, 4), 1116), ((5, 10), 1220)),
    ],
)
def test_the_real_time_packet_has_the_size_of_its_software(version, size):
    packet = realtime_state(of_software(*version))
    assert struct.unpack_from(">i", packet) == (size,)
    assert len(packet) == size


def test_the_real_time_packet_holds_what_clients_look_for_at_its_places(machine):
    machine.tick()
    packet = realtime_state(machine)
    # The slices of many small clients, ur_aj 0.1.5 and UR_TCP_RTDE 0.0.1 among them.
    assert list(struct.unpack("!6d", packet[252:300])) == machine.output("actual_q")
    assert list(struct.unpack("!6d", packet[300:348])) == machine.output("actual_qd")
    assert list(struct.unpack("!6d", packet[444:492])) == machine.output("actual_TCP_pose")
    assert list(struct.unpack("!6d", packet[492:540])) == machine.output("actual_TCP_speed")
    values = struct.unpack_from(">139d", packet, 4)
    assert values[0] == machine.output("timestamp")
    assert list(values[31:37]) == machine.output("actual_q")
    assert list(values[86:92]) == machine.output("joint_temperatures")
    assert values[94] == 7.0
    assert values[131] == machine.output("runtime_state")


def test_messages():
    packet = version_message((3, 15, 8, 106339), 61.5)
    size, kind, stamp, _, message = struct.unpack_from(">iBQbb", packet)
    assert (size, kind, stamp, message) == (len(packet), 20, 61_500_000, 3)
    length = packet[15]
    assert packet[16 : 16 + length] == b"URControl"
    assert struct.unpack_from(">BBii", packet, 16 + length) == (3, 15, 8, 106339)


def heard(machine, kind):
    """The bodies of all messages of a kind that clients of 30001 read."""
    found = []
    for message in machine.messages:
        data = packets(message)
        while data:
            size, sort, _, source, what = struct.unpack_from(">iBQbb", data)
            assert sort == 20
            if what == kind:
                found.append((source, data[15:size]))
            data = data[size:]
    return found


TEXT, POPUP, SAFETY_MODE, ERROR_CODE, KEY, EXCEPTION = 0, 2, 5, 6, 7, 10


def test_texts_keys_and_popups_are_laid_out_as_in_ur_s_library(machine):
    # src/primary/robot_message/key_message.cpp; popups: python-urx, urx/ursecmon.py, and UR's
    # guide for what stands before the flags.
    machine.run_script(
        'def swing():\n textmsg("joint ", 3)\n popup("look", title="Stop!", warning=True)\nend\n'
    )
    for _ in range(5):
        machine.tick()
    assert (-3, b"joint 3") in heard(machine, TEXT)
    keys = [body for _, body in heard(machine, KEY)]
    titles = (b"PROGRAM_XXX_STARTED", b"PROGRAM_XXX_STOPPED")
    assert keys == [struct.pack(">iiB", 0, 0, 19) + title + b"swing" for title in titles]
    ((_, popup),) = heard(machine, POPUP)
    _, _, warning, error, blocking, length = struct.unpack_from(">IB???B", popup)
    assert (warning, error, blocking, length) == (True, False, False, 5)
    assert popup[9:] == b"Stop!look"


@pytest.mark.parametrize(
    ("script", "line", "words"),
    [
        # The words for an unknown name are those recorded in tests/test_primary_parser.cpp.
        ("def f():\n\n txtmsg(1)\nend\n", 3, b"compile_error_name_not_found:txtmsg:"),
        ("def f():\n a = b\nend\n", 2, b"compile_error_name_not_found:b:"),
        ("def f():\n a = )\nend\n", 2, b"syntax_error_on_line:2:):"),
    ],
)
def test_a_script_that_does_not_compile_is_answered_by_an_exception(machine, script, line, words):
    machine.run_script(script)
    assert heard(machine, EXCEPTION) == [(-3, struct.pack(">ii", line, 1) + words)]
    assert heard(machine, TEXT), "our own words follow"


def test_a_fault_names_its_line(machine):
    machine.run_script("def f():\n sync()\n a = 1 / 0\nend\n")
    for _ in range(5):
        machine.tick()
    ((_, body),) = heard(machine, EXCEPTION)
    assert struct.unpack_from(">i", body) == (3,)
    assert b"division by zero" in body


def test_a_stop_has_its_code_and_its_mode(machine):
    # src/primary/robot_message/error_code_message.cpp and safety_mode_message.cpp
    machine.core.protective_stop("C191A33: Joint 1 speed violation")
    ((_, code),) = heard(machine, ERROR_CODE)
    assert struct.unpack_from(">iii", code) == (191, 33, 3)
    assert code[20:] == b"C191A33: Joint 1 speed violation"
    ((_, mode),) = heard(machine, SAFETY_MODE)
    assert struct.unpack(">iiBII", mode)[:3] == (191, 33, 3)


def read(sock, count):
    data = b""
    while len(data) < count:
        piece = sock.recv(count - len(data))
        assert piece
        data += piece
    return data


def packet_of(sock):
    head = read(sock, 4)
    return head + read(sock, struct.unpack(">i", head)[0] - 4)


@pytest.mark.parametrize("port", [30001, 30002, 30011, 30012])
def test_states_come_ten_times_a_second_after_the_version(real, port):
    with socket.create_connection((real.host, port), timeout=TIMEOUT_S) as sock:
        assert packet_of(sock)[4] == 20
        states = []
        while len(states) < 6:
            packet = packet_of(sock)
            if packet[4] == 16:
                states.append(packages(packet))
    assert [5 in state and 6 in state for state in states] == [True] + [False] * 5
    stamps = [struct.unpack_from(">Q", state[0])[0] * 1e-6 for state in states]
    np.testing.assert_allclose(np.diff(stamps), 0.1, atol=0.0081)


@pytest.mark.parametrize("port", [30003, 30013])
def test_the_real_time_port_sends_every_cycle(real, port):
    with socket.create_connection((real.host, port), timeout=TIMEOUT_S) as sock:
        stamps = [struct.unpack_from(">d", packet_of(sock), 4)[0] for _ in range(30)]
    np.testing.assert_allclose(np.diff(stamps), 0.008, rtol=0, atol=1e-12)


def test_ports_that_are_read_only_do_not_listen(fast):
    script = "def quiet():\n  write_output_integer_register(30, {})\nend\n"
    with RtdeClient(fast.host) as client:
        client.read_outputs(["timestamp", "output_int_register_30"])
        client.start()
        for port in (30011, 30012, 30013):
            send_script(fast.host, script.format(port), port)
        send_script(fast.host, script.format(7), 30002)
        rows = [client.row()["output_int_register_30"] for _ in range(5)]
        while rows[-1] != 7:
            rows.append(client.row()["output_int_register_30"])
    assert set(rows) == {0, 7}


def test_lines_that_pendants_and_drivers_send_are_obeyed(fast):
    # src/primary/primary_client.cpp of UR's client library
    def tell(line):
        send_script(fast.host, line + "\n", 30001)

    with RtdeClient(fast.host) as client:
        client.read_outputs(["timestamp", "robot_mode", "runtime_state", "target_speed_fraction"])
        client.start()
        tell("power off")
        client.until(lambda row: row["robot_mode"] == RobotMode.POWER_OFF)
        tell("power on")
        client.until(lambda row: row["robot_mode"] == RobotMode.IDLE)
        tell("set robotmode run")
        client.until(lambda row: row["robot_mode"] == RobotMode.RUNNING)
        send_script(fast.host, "def f():\n while True:\n sync()\n end\nend\n")
        client.until(lambda row: row["runtime_state"] == RuntimeState.PLAYING)
        tell("pause program")
        client.until(lambda row: row["runtime_state"] == RuntimeState.PAUSED)
        tell("resume program")
        client.until(lambda row: row["runtime_state"] == RuntimeState.PLAYING)
        tell("set speed 0.4")
        client.until(lambda row: row["target_speed_fraction"] == 0.4)
        tell("set speed 1")
        client.until(lambda row: row["target_speed_fraction"] == 1.0)
        tell("stop program")
        client.until(lambda row: row["runtime_state"] == RuntimeState.STOPPED)


@pytest.mark.parametrize("volts", ["-1", "13", "300"])
def test_a_tool_voltage_that_a_robot_lacks_stops_the_program_not_the_states(machine, volts):
    machine.run_script(f"def f():\n set_tool_voltage({volts})\nend\n")
    machine.tick()
    assert any("tool voltage" in message.text for message in machine.messages)
    assert packages(robot_state(machine))
