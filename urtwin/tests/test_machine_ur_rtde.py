"""ur_rtde's own control script, from the installed package, driven through its mailbox."""

import numpy as np
import pytest

from dynid.simulation import SimulatedArm
from scripts import said, ticks
from urtwin import ControllerMachine
from urtwin.safety import WatchedLimits

script_client = pytest.importorskip("script_client", reason="needs ur_rtde")

READY, DONE = 1, 2
GOAL = [0.3, -1.4, 1.2, -1.3, -1.2, 0.3]
TRACKING = 2e-3
"""Standing error under friction, with a servo without an integral part [rad]."""
TARGET = 1e-6
VERSIONS = [(3, 15), (3, 5), (5, 11), (5, 26)]


def control_script(version: tuple[int, int], offset: int = 0) -> str:
    """What ur_rtde sends, with its injections and its version filter."""
    text = script_client.ScriptClient("127.0.0.1", *version).getScript()
    for mark in ("# float register offset\n", "# int register offset\n"):
        assert mark in text
        text = text.replace(mark, f"{mark}{offset}", 1)
    return f"def rtde_control():\n{text}end\n"


class Mailbox:
    """The client's side of the handshake."""

    def __init__(self, machine: ControllerMachine, offset: int = 0) -> None:
        self.machine, self.offset = machine, offset

    def wait(self, state: int, seconds: float = 30.0) -> None:
        for _ in range(round(seconds / self.machine.cycle)):
            self.machine.tick()
            if self.machine.output(f"output_int_register_{self.offset}") == state:
                return
        raise AssertionError(f"state {state} never came; {said(self.machine)}")

    def write(self, command: int, doubles: list[float], integers: list[int]) -> None:
        for k, value in enumerate(doubles):
            self.machine.set_input(f"input_double_register_{self.offset + k}", value)
        for k, value in enumerate(integers):
            self.machine.set_input(f"input_int_register_{self.offset + 1 + k}", value)
        self.machine.set_input(f"input_int_register_{self.offset}", command)

    def send(
        self, command: int, doubles: list[float] | None = None, integers: list[int] | None = None
    ) -> None:
        """A command that answers when it is done."""
        self.write(command, doubles or [], integers or [])
        self.wait(DONE)
        self.clear()

    def stream(self, command: int, doubles: list[float], integers: list[int] | None = None) -> None:
        """A command that goes on: one cycle each."""
        self.write(command, doubles, integers or [])
        self.machine.tick()

    def clear(self) -> None:
        self.machine.set_input(f"input_int_register_{self.offset}", 0)
        self.wait(READY)

    def doubles(self, count: int) -> list[float]:
        return [
            self.machine.output(f"output_double_register_{self.offset + k}") for k in range(count)
        ]


@pytest.fixture
def mailbox(arm: SimulatedArm) -> Mailbox:
    machine = ControllerMachine(arm, pose=GOAL)
    machine.run_script(control_script((3, 15)))
    box = Mailbox(machine)
    box.wait(READY, 0.1)
    return box


def off(machine: ControllerMachine, name: str, goal: list[float]) -> float:
    return float(np.abs(np.array(machine.output(name)) - goal).max())


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("offset", [0, 24])
def test_the_script_of_every_version_starts(
    arm: SimulatedArm, version: tuple[int, int], offset: int
) -> None:
    rate = 125.0 if version[0] == 3 else 500.0
    machine = ControllerMachine(arm, rate_hz=rate, version=(*version, 0, 0))
    machine.run_script(control_script(version, offset))
    Mailbox(machine, offset).wait(READY, 0.1)
    assert machine.output("runtime_state") == 2
    assert machine.output("robot_status_bits") == 3
    assert any("RTDE Control Script Loaded" in text for text in said(machine))


def test_movej(mailbox: Mailbox) -> None:
    goal = [value + 0.2 for value in GOAL]
    mailbox.send(1, [*goal, 1.05, 1.4], [0])
    assert off(mailbox.machine, "target_q", goal) < TARGET * 20
    assert off(mailbox.machine, "actual_q", goal) < TRACKING


def test_movej_in_the_background_and_its_stop(mailbox: Mailbox) -> None:
    goal = [value + 0.5 for value in GOAL]
    mailbox.send(1, [*goal, 0.5, 1.0], [1])
    progress = mailbox.machine.output("output_int_register_2")
    assert progress & 1 << 15, "an operation runs"
    ticks(mailbox.machine, 0.5)
    assert max(mailbox.machine.output("target_qd")) > 0.3
    mailbox.send(34, [5.0], [0])
    assert off(mailbox.machine, "target_qd", [0.0] * 6) < 1e-3
    assert off(mailbox.machine, "actual_q", goal) > 0.1, "it stopped on the way"
    assert not mailbox.machine.output("output_int_register_2") & 1 << 15


def test_movel(mailbox: Mailbox) -> None:
    goal = mailbox.machine.output("target_TCP_pose")
    goal = [goal[0], goal[1], goal[2] - 0.1, *goal[3:]]
    mailbox.send(3, [*goal, 0.25, 1.2], [0])
    assert off(mailbox.machine, "target_TCP_pose", goal) < 1e-5


def test_servoj_follows_and_servo_stop_ends_it(mailbox: Mailbox) -> None:
    machine = mailbox.machine
    for k in range(125):
        mailbox.stream(11, [*(q + 0.1 * np.sin(0.03 * k) for q in GOAL), 0, 0, 0.008, 0.03, 500])
    late = round(0.03 / machine.cycle)
    expected = [q + 0.1 * np.sin(0.03 * (124 - late)) for q in GOAL]
    assert off(machine, "target_q", expected) < 3e-3, "the target follows by the lookahead"
    mailbox.clear()
    mailbox.send(16, [10.0])
    assert off(machine, "target_qd", [0.0] * 6) < 1e-3
    stood = machine.output("target_q")
    ticks(machine, 0.2)
    assert off(machine, "target_q", stood) < TARGET


def test_speedj_and_speed_stop(mailbox: Mailbox) -> None:
    mailbox.stream(9, [0.2, 0, 0, 0, 0, 0, 0.5, 0.0])
    ticks(mailbox.machine, 1.0)
    assert mailbox.machine.output("target_qd")[0] == pytest.approx(0.2, abs=1e-6)
    mailbox.clear()
    mailbox.send(15, [10.0])
    assert off(mailbox.machine, "target_qd", [0.0] * 6) < 1e-3


def test_speedl_moves_the_tool_straight(mailbox: Mailbox) -> None:
    mailbox.stream(10, [0.0, 0.0, -0.05, 0, 0, 0, 0.5, 0.0])
    ticks(mailbox.machine, 1.0)
    speed = mailbox.machine.output("target_TCP_speed")
    assert speed == pytest.approx([0, 0, -0.05, 0, 0, 0], abs=1e-3)
    mailbox.clear()
    mailbox.send(15, [10.0])
    assert off(mailbox.machine, "target_qd", [0.0] * 6) < 1e-3


def test_questions(mailbox: Mailbox) -> None:
    machine = mailbox.machine
    ticks(machine, 0.6)
    mailbox.send(47)
    assert machine.output("output_int_register_1") == 1, "it stands still"
    mailbox.send(43)
    assert mailbox.doubles(6) == pytest.approx(machine.output("actual_TCP_pose"), abs=1e-9)
    pose = mailbox.doubles(6)
    mailbox.send(30, [*pose, *(q + 0.05 for q in GOAL), 1e-9, 1e-9])
    assert mailbox.doubles(6) == pytest.approx(machine.output("target_q"), abs=TRACKING)
    mailbox.send(37, [9.0, 0, 0, 0, 0, 0])
    assert machine.output("output_int_register_1") == 0, "beyond a joint's range"
    mailbox.send(36, pose)
    assert machine.output("output_int_register_1") == 1
    mailbox.send(17, [1.5, 0.0, 0.0, 0.05])
    assert machine.output("payload") == 1.5
    assert machine.output("payload_cog") == [0.0, 0.0, 0.05]
    mailbox.send(29, [0, 0, 0.1, 0, 0, 0])
    assert machine.output("tcp_offset") == [0, 0, 0.1, 0, 0, 0]
    mailbox.send(39, [0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0])
    assert mailbox.doubles(6) == pytest.approx([1, 0, 1, 0, 0, 0])


def test_teach_mode_is_on_until_it_is_ended(mailbox: Mailbox) -> None:
    mailbox.send(18)
    assert int(mailbox.machine.output("robot_status_bits")) & 4
    mailbox.send(19)
    assert not int(mailbox.machine.output("robot_status_bits")) & 4


def test_direct_torque_lasts_a_cycle_and_says_that_it_does_nothing(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, rate_hz=500.0, version=(5, 26, 0, 0), pose=GOAL)
    machine.run_script(control_script((5, 26)))
    box = Mailbox(machine)
    box.wait(READY, 0.1)
    for _ in range(5):
        box.stream(66, [0.0] * 18)
    assert machine.program_running, said(machine)
    assert any("direct_torque is not simulated" in text for text in said(machine))


def test_a_starved_watchdog_stops_the_program_and_the_arm(mailbox: Mailbox) -> None:
    machine = mailbox.machine
    mailbox.send(35, [10.0])
    for _ in range(50):
        mailbox.stream(9, [1.0, 0, 0, 0, 0, 0, 5.0, 0.0])
    last_fed = machine.output("timestamp")
    while machine.program_running:
        machine.tick()
    assert machine.output("timestamp") - last_fed == pytest.approx(0.1, abs=2 * machine.cycle)
    ticks(machine, 0.1)
    assert abs(machine.output("actual_qd")[0]) < 0.02, "stopped 0.1 s later"
    assert any("watchdog" in text for text in said(machine))


def test_protective_stop_unlock_and_the_script_again(mailbox: Mailbox) -> None:
    machine = mailbox.machine
    mailbox.write(31, [], [])
    ticks(machine, 0.1)
    assert machine.output("safety_mode") == 3
    assert machine.output("safety_status_bits") == (1 << 2 | 1 << 10)
    assert machine.output("runtime_state") == 1
    assert not machine.unlock_protective_stop(), "not in its first five seconds"
    machine.set_input("input_int_register_0", 0)
    ticks(machine, WatchedLimits().unlock_after)
    assert machine.unlock_protective_stop()
    machine.run_script(control_script((3, 15)))
    mailbox.wait(READY, 0.1)
    mailbox.send(1, [*GOAL, 1.05, 1.4], [0])


def test_stop_script(mailbox: Mailbox) -> None:
    mailbox.write(255, [], [])
    ticks(mailbox.machine, 0.1)
    assert mailbox.machine.output("runtime_state") == 1


@pytest.mark.parametrize("command", [67, 68, 69, 70, 71])
def test_the_model_of_the_newest_software(arm: SimulatedArm, command: int) -> None:
    machine = ControllerMachine(arm, rate_hz=500.0, version=(5, 26, 0, 0), pose=GOAL)
    machine.run_script(control_script((5, 26)))
    box = Mailbox(machine)
    box.wait(READY, 0.1)
    for _ in range(5):
        box.stream(command, [])
    assert machine.program_running, said(machine)
    if command in (67, 70):
        assert max(map(abs, box.doubles(24))) > 0.01
