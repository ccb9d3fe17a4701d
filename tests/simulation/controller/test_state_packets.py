"""The packets of 30001 to 30003, taken apart by the tables of UR's guide, not by our packer."""

import socket
import struct

import numpy as np
import pytest
from rtde_client import TIMEOUT_S

from dynid.simulation.controller.primary import (
    realtime_state,
    robot_state,
    text_message,
    version_message,
)

HEAD = struct.Struct(">iB")
SIZES = {0: 47, 1: 251, 2: 37, 3: 75, 4: 101}
"""Sizes of the packages of software 3.5 and later [bytes]."""


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


def test_sizes_are_those_of_the_guide(machine):
    machine.tick()
    found = packages(robot_state(machine))
    assert {kind: len(body) + HEAD.size for kind, body in found.items()} == SIZES


def test_robot_mode_data(machine):
    machine.tick()
    (stamp, *flags, mode, control, target, scaling, limit, _) = struct.unpack(
        ">Q7?BBdddB", packages(robot_state(machine))[0]
    )
    assert stamp == round(1e6 * machine.output("timestamp"))
    assert flags == [True, True, True, False, False, False, False]
    assert (mode, control, target, scaling, limit) == (7, 0, 1.0, 1.0, 1.0)
    machine.protective_stop("test")
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


@pytest.mark.parametrize(("which", "size"), [("machine", 1220), ("e_machine", 1220)])
def test_the_real_time_packet_has_the_size_of_its_software(which, size, request):
    machine = request.getfixturevalue(which)
    machine.tick()
    packet = realtime_state(machine)
    assert struct.unpack_from(">i", packet) == (size,)
    assert len(packet) == size
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
    assert text_message("hello", 1.0)[15:] == b"hello"


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


@pytest.mark.parametrize("port", [30001, 30002])
def test_states_come_ten_times_a_second_after_the_version(real, port):
    with socket.create_connection((real.host, port), timeout=TIMEOUT_S) as sock:
        assert packet_of(sock)[4] == 20
        states = []
        while len(states) < 6:
            packet = packet_of(sock)
            if packet[4] == 16:
                states.append(packages(packet))
    stamps = [struct.unpack_from(">Q", state[0])[0] * 1e-6 for state in states]
    np.testing.assert_allclose(np.diff(stamps), 0.1, atol=0.0081)


def test_the_real_time_port_sends_every_cycle(real):
    with socket.create_connection((real.host, 30003), timeout=TIMEOUT_S) as sock:
        stamps = [struct.unpack_from(">d", packet_of(sock), 4)[0] for _ in range(30)]
    np.testing.assert_allclose(np.diff(stamps), 0.008, rtol=0, atol=1e-12)
