"""Blends and arcs of the machine against what their words promise."""

import numpy as np
import pytest

from dynid.core import Array
from dynid.simulation import SimulatedArm
from scripts import HOME, said, ticks
from test_machine_motion import recorded
from urtwin import ControllerMachine
from urtwin.kinematics import arc_through

START = HOME.tolist()
ON_THE_WAY = 2e-4
"""How far the servo's target may be beside its way [m]."""
RADIUS = 0.03


@pytest.fixture
def machine(arm: SimulatedArm) -> ControllerMachine:
    return ControllerMachine(arm, pose=START)


def turned(angle: float) -> list[float]:
    """Where the arm begins, turned about its base [rad]."""
    return [START[0] + angle, *START[1:]]


def corner(machine: ControllerMachine, radius: float) -> tuple[str, Array, Array]:
    """Two straight moves at a right angle, their way point and their end."""
    first = np.array(machine.output("target_TCP_pose"))
    via, end = first.copy(), first.copy()
    via[0] += 0.12
    end[[0, 2]] += [0.12, -0.12]
    text = (
        f"def p():\n movel(p{via.tolist()}, a=0.8, v=0.2, r={radius})\n"
        f" movel(p{end.tolist()}, a=0.8, v=0.2)\nend\n"
    )
    return text, via, end


def test_a_blend_rounds_the_way_point_and_saves_the_stop(machine: ControllerMachine) -> None:
    text, via, end = corner(machine, RADIUS)
    blended = recorded(machine, text, "target_TCP_pose", "target_TCP_speed", "target_qdd")
    points = blended["target_TCP_pose"][:, :3]
    nearest = np.linalg.norm(points - via[:3], axis=1).min()
    assert 1e-3 < nearest < RADIUS
    assert points[-1] == pytest.approx(end[:3], abs=ON_THE_WAY)
    speed = np.linalg.norm(blended["target_TCP_speed"][:, :3], axis=1)
    moving = np.flatnonzero(speed > 0.1)
    assert speed[moving[0] : moving[-1]].min() > 0.05, "the arm stops at the way point"
    # Outside the radius the arm is on one of the two lines.
    outside = np.linalg.norm(points - via[:3], axis=1) > RADIUS
    beside = np.minimum(np.abs(points[:, 0] - via[0]), np.abs(points[:, 2] - via[2]))
    assert beside[outside].max() < ON_THE_WAY
    assert np.abs(blended["target_qdd"]).max() < 10.0


def test_without_a_radius_the_arm_stops_at_the_way_point(machine: ControllerMachine) -> None:
    text, via, _ = corner(machine, 0.0)
    rows = recorded(machine, text, "target_TCP_pose")
    nearest = np.linalg.norm(rows["target_TCP_pose"][:, :3] - via[:3], axis=1).min()
    assert nearest < ON_THE_WAY


def test_a_blend_saves_time_in_joint_space_and_keeps_the_speed(machine: ControllerMachine) -> None:
    via, end = turned(0.4), turned(0.8)
    text = "def p():\n movej({}, a=2, v=0.5, r={})\n movej({}, a=2, v=0.5)\nend\n"
    blended = recorded(machine, text.format(via, 0.2, end), "target_qd", "target_q")
    assert blended["target_q"][-1] == pytest.approx(end, abs=1e-4)
    assert blended["target_qd"][:, 0].max() == pytest.approx(0.5, rel=2e-2)
    between = np.flatnonzero(blended["target_qd"][:, 0] > 0.45)
    # On a straight way nothing is lost.
    assert blended["target_qd"][between[0] : between[-1], 0].min() > 0.45
    machine.run_script(f"movej({START})")
    ticks(machine, 5.0)
    stopping = recorded(machine, text.format(via, 0.0, end), "target_qd")
    saved = (len(stopping["target_qd"]) - len(blended["target_qd"])) * machine.cycle
    assert saved > 0.2


@pytest.mark.parametrize("between", ["", " set_digital_out(1, True)\n", " sleep(0.5)\n"])
def test_a_move_that_nothing_follows_ends_at_its_way_point(
    machine: ControllerMachine, between: str
) -> None:
    goal = (HOME + 0.3).tolist()
    text = f"def p():\n movej({goal}, a=2, v=0.5, r=0.2)\n{between}end\n"
    rows = recorded(machine, text, "target_q", "target_qdd")
    ticks(machine, 0.5)
    assert machine.output("target_q") == pytest.approx(goal, abs=1e-4)
    assert np.abs(rows["target_qdd"]).max() < 2.5


def test_another_motion_takes_over_from_a_blend(machine: ControllerMachine) -> None:
    goal = turned(0.5)
    text = f"def p():\n movej({goal}, a=2, v=0.5, r=0.2)\n stopj(8.0)\n sleep(0.5)\nend\n"
    rows = recorded(machine, text, "target_q")
    assert rows["target_q"][-1][0] < goal[0] - 0.01


def test_a_pause_within_a_blend_loses_nothing(machine: ControllerMachine) -> None:
    text, _, end = corner(machine, RADIUS)
    machine.run_script(text)
    ticks(machine, 0.8)
    machine.pause()
    ticks(machine, 0.5)
    assert max(map(abs, machine.output("target_qd"))) < 1e-3
    machine.play()
    ticks(machine, 4.0)
    assert machine.output("target_TCP_pose") == pytest.approx(end, abs=ON_THE_WAY), said(machine)


def test_movec_keeps_to_its_circle(machine: ControllerMachine) -> None:
    first = np.array(machine.output("target_TCP_pose"))
    radius = 0.06
    centre = first[:3] + np.array([radius, 0, 0])
    via, end = first.copy(), first.copy()
    via[:3] = centre + np.array([0, 0, radius])
    end[:3] = centre + np.array([radius, 0, 0])
    text = f"movec(p{via.tolist()}, p{end.tolist()}, a=1.0, v=0.1)"
    rows = recorded(machine, text, "target_TCP_pose", "target_TCP_speed")
    points = rows["target_TCP_pose"][:, :3]
    assert np.linalg.norm(points - centre, axis=1) == pytest.approx(radius, abs=ON_THE_WAY)
    assert np.linalg.norm(points - via[:3], axis=1).min() < 1e-3
    assert points[-1] == pytest.approx(end[:3], abs=ON_THE_WAY)
    speed = np.linalg.norm(rows["target_TCP_speed"][:, :3], axis=1)
    assert speed.max() == pytest.approx(0.1, rel=2e-2)
    # The orientation of the goal is the one it began with.
    assert rows["target_TCP_pose"][:, 3:] == pytest.approx(
        np.broadcast_to(first[3:], (len(points), 3)), abs=2e-3
    )


def test_a_fixed_tool_turns_with_the_arc(machine: ControllerMachine) -> None:
    first = np.array(machine.output("target_TCP_pose"))
    via, end = first.copy(), first.copy()
    via[[0, 1]] += [0.04, 0.04]
    end[0] += 0.08
    text = f"movec(p{via.tolist()}, p{end.tolist()}, a=1.0, v=0.1, mode=1)"
    rows = recorded(machine, text, "target_TCP_pose", "target_TCP_speed")
    turned = rows["target_TCP_speed"][:, 3:]
    moving = np.linalg.norm(rows["target_TCP_speed"][:, :3], axis=1) > 0.0985
    # About the vertical, as fast as the radius asks for.
    assert np.abs(turned[moving, 2]) == pytest.approx(0.1 / 0.04, rel=5e-2)


def test_points_in_line_are_no_arc(machine: ControllerMachine) -> None:
    first = np.array(machine.output("target_TCP_pose"))
    via, end = first.copy(), first.copy()
    via[0], end[0] = via[0] + 0.05, end[0] + 0.1
    machine.run_script(f"movec(p{via.tolist()}, p{end.tolist()})")
    ticks(machine, 0.5)
    assert any("in line" in text for text in said(machine))


def test_arcs_pass_their_points_in_order() -> None:
    generator = np.random.default_rng(5)
    for _ in range(50):
        start, via, end = generator.normal(size=(3, 3))
        arc = arc_through(start, via, end)
        radius = np.linalg.norm(arc.first)
        assert arc.point(0.0) == pytest.approx(start)
        assert arc.point(1.0) == pytest.approx(end, abs=1e-6 * max(1.0, radius))
        way = np.array([arc.point(share) for share in np.linspace(0, 1, 2001)])
        step = arc.length / 2000
        assert np.linalg.norm(way - via, axis=1).min() <= step
