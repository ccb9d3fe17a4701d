import math
from pathlib import Path

import pytest

from dynid.core import RobotError
from dynid.robot import SafetyLimits, load_robot
from dynid.robot.robotfile import robot_from_toml

CHAIN = """
name = "two"
[[joint]]
name = "a"
[[joint]]
name = "b"
xyz = [0.5, 0, 0]
"""


def robot_of(text: str):
    return robot_from_toml((CHAIN + text).encode(), Path("two.toml"))


def test_safety_limits_are_read() -> None:
    robot = robot_of('[safety]\ntcp_speed = 1.5\nelbow_speed = 1.0\nelbow = "b"\nsource = "me"\n')
    assert robot.safety.tcp_speed == 1.5
    assert robot.safety.elbow == 2
    assert math.isnan(robot.safety.momentum)
    assert "safety: me" in robot.source


def test_pairs_that_release_0_1_took_on_trust_are_judged() -> None:
    robot = robot_of('[collision]\napart = [["b", "base"], ["a", "b"]]\n')
    assert any("count no more" in note for note in robot.notes)
    assert not robot.body_notes


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[safety]\ntcp_speed = -1\n", "tcp_speed must be positive"),
        ("[safety]\ntcp_sped = 1\n", "unknown key 'tcp_sped'.*Did you mean tcp_speed"),
        ("[safety]\nelbow_speed = 1\n", "needs 'elbow'"),
        ('[safety]\nelbow = "c"\n', "'elbow' unknown word"),
    ],
)
def test_wrong_tables_are_named(text: str, message: str) -> None:
    with pytest.raises(RobotError, match=message):
        robot_of(text)


def test_wrong_values_are_refused() -> None:
    with pytest.raises(RobotError, match="momentum must be positive"):
        SafetyLimits(momentum=math.inf)
    with pytest.raises(RobotError, match="counted from 1"):
        SafetyLimits(elbow=-1)


@pytest.mark.parametrize("name", ["ur10", "ur10e", "ur16e", "ur3", "ur3e", "ur5", "ur5e"])
def test_the_library_knows_safety_limits_and_shapes(name: str) -> None:
    robot = load_robot(name)
    assert (robot.safety.tcp_speed, robot.safety.momentum, robot.safety.power) == (1.5, 25.0, 300.0)
    assert robot.safety.elbow == 3
    assert {item.link for item in robot.bodies} == set(range(7))
    for group in ("safety:", "body:"):
        assert group in robot.source
