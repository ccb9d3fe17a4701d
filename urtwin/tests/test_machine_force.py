"""Force mode of an arm that touches nothing, and the modes in which a hand would move it."""

import numpy as np
import pytest

from dynid.simulation import SimulatedArm
from scripts import HOME, said, ticks
from urtwin import ControllerMachine
from urtwin.primary import packets

ASIDE = 2e-4
"""How far the tool may leave the axis that gives way [m]."""
SPEED = 2e-2
"""Relative error of a speed that has settled."""


@pytest.fixture
def machine(arm: SimulatedArm) -> ControllerMachine:
    return ControllerMachine(arm, pose=HOME.tolist())


def force(
    machine: ControllerMachine,
    wrench: str,
    limit: float,
    *,
    frame: str = "p[0, 0, 0, 0, 0, 0]",
    kind: int = 2,
    axes: str = "[0, 0, 1, 0, 0, 0]",
) -> tuple[np.ndarray, np.ndarray]:
    """Half a second of it: how far the tool went, and how fast it was in the end."""
    text = f"force_mode({frame}, {axes}, {wrench}, {kind}, [{', '.join([str(limit)] * 6)}])"
    start = np.array(machine.output("target_TCP_pose"))
    machine.run_script(f"def p():\n {text}\n sleep(10)\nend\n")
    ticks(machine, 0.5)
    assert machine.program_running, said(machine)
    way = np.array(machine.output("target_TCP_pose")) - start
    return way, np.array(machine.output("target_TCP_speed"))


def test_the_tool_gives_way_along_the_axis_up_to_the_limit(machine: ControllerMachine) -> None:
    way, speed = force(machine, "[0, 0, -50, 0, 0, 0]", 0.05)
    assert speed[2] == pytest.approx(-0.05, rel=SPEED)
    assert np.abs(np.delete(way, 2)).max() < ASIDE
    assert way[2] < -0.01


def test_a_small_force_is_slower_than_the_limit_and_axes_that_are_stiff_stay(
    machine: ControllerMachine,
) -> None:
    _, speed = force(machine, "[30, 30, 4, 0, 0, 0]", 0.5)
    assert speed[2] == pytest.approx(0.02, rel=SPEED)
    assert np.abs(speed[:2]).max() < 1e-3


def test_the_task_frame_says_where_the_axis_points(machine: ControllerMachine) -> None:
    # A quarter turn about x: the frame's z is minus the base's y.
    way, speed = force(
        machine, "[0, 0, 20, 0, 0, 0]", 0.05, frame="p[0, 0, 0, 1.5707963267948966, 0, 0]"
    )
    assert speed[1] == pytest.approx(-0.05, rel=SPEED)
    assert np.abs(way[[0, 2]]).max() < ASIDE


def test_type_one_turns_the_frame_to_its_origin(machine: ControllerMachine) -> None:
    place = np.array(machine.output("target_TCP_pose"))[:3]
    target = place + np.array([0.1, 0.2, -0.1])
    frame = f"p[{target[0]}, {target[1]}, {target[2]}, 0, 0, 0]"
    way, _ = force(machine, "[0, 20, 0, 0, 0, 0]", 0.05, frame=frame, kind=1, axes="[0,1,0,0,0,0]")
    toward = (target - place) / np.linalg.norm(target - place)
    assert way[:3] @ toward > 0.01
    assert np.linalg.norm(way[:3] - (way[:3] @ toward) * toward) < ASIDE


def test_the_end_of_the_mode_and_of_the_program_stop_the_arm(machine: ControllerMachine) -> None:
    force(machine, "[0, 0, -50, 0, 0, 0]", 0.05)
    machine.stop()
    ticks(machine, 0.5)
    assert max(map(abs, machine.output("target_qd"))) < 1e-6
    # The next program begins without it.
    machine.run_script("sleep(0.5)")
    ticks(machine, 0.4)
    assert max(map(abs, machine.output("target_qd"))) < 1e-6
    text = "force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,20,0,0,0], 2, [1,1,0.05,1,1,1])"
    machine.run_script(f"def p():\n {text}\n sleep(0.3)\n end_force_mode()\n sleep(1)\nend\n")
    ticks(machine, 0.25)
    assert machine.output("target_TCP_speed")[2] > 0.03
    ticks(machine, 0.6)
    assert max(map(abs, machine.output("target_qd"))) < 1e-6
    assert machine.program_running


def test_a_move_within_the_mode_ends_where_it_was_sent(machine: ControllerMachine) -> None:
    text = "force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,20,0,0,0], 2, [1,1,0.05,1,1,1])"
    goal = (HOME + 0.1).tolist()
    machine.run_script(f"def p():\n {text}\n sleep(0.3)\n movej({goal})\n end_force_mode()\nend\n")
    ticks(machine, 3.0)
    assert not machine.program_running
    assert machine.output("target_q") == pytest.approx(goal, abs=1e-4)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ("force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,1,0,0,0], 4, [1,1,1,1,1,1])", "type of"),
        ("force_mode(p[0,0,0,0,0,0], [0,0,1], [0,0,1,0,0,0], 2, [1,1,1,1,1,1])", "a selection"),
        ("force_mode_set_damping(1.5)", "damping"),
        ("force_mode_set_gain_scaling(-1)", "gain"),
    ],
)
def test_numbers_that_make_no_mode_are_faults(
    machine: ControllerMachine, call: str, words: str
) -> None:
    machine.run_script(call)
    ticks(machine, 0.1)
    assert any(words in text for text in said(machine))


def test_freedrive_and_teach_mode_are_shown_and_end(machine: ControllerMachine) -> None:
    for begin, end in (("teach_mode", "end_teach_mode"), ("freedrive_mode", "end_freedrive_mode")):
        machine.run_script(f"def p():\n {begin}()\n sleep(0.2)\n {end}()\n sleep(0.2)\nend\n")
        ticks(machine, 0.1)
        assert int(machine.output("robot_status_bits")) & 4
        ticks(machine, 0.2)
        assert not int(machine.output("robot_status_bits")) & 4


def test_what_is_not_simulated_is_told_to_people_not_to_clients(machine: ControllerMachine) -> None:
    machine.run_script("screw_driving(1, 2)")
    ticks(machine, 0.1)
    notes = [message for message in machine.messages if "not simulated" in message.text]
    assert len(notes) == 1
    assert packets(notes[0]) == b""
