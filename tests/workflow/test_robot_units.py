"""Degrees, millimetres and grams in robot files certify nothing; real arms are not suspected."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.constraints import SPHERE, Scene, Shape, doubted_units, safe_constraints
from dynid.robot import from_xyz_rpy

EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "robots").glob("*.toml"))
ARM = """
name = "arm"
[dh]
convention = "standard"
a = [0.0, {length}, 0.3]
d = [0.2, 0.0, 0.0]
alpha = [1.5707963267948966, 0.0, 0.0]
theta = [0.0, 0.0, 0.0]
[limits]
lower = [-{turn}, -1.0, -1.0]
upper = [{turn}, 1.0, 1.0]
velocity = [2.0, {speed}, 2.0]
"""


def written(path: Path, *, length: float = 0.4, turn: float = 3.0, speed: float = 2.0) -> Path:
    path.write_text(ARM.format(length=length, turn=turn, speed=speed))
    return path


def test_what_is_not_si_is_named(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    for change, said in (
        ({"turn": 180.0}, "position limits of joint 1 reach 180 rad"),
        ({"speed": 150.0}, "velocity limits of joint 2 reach 150 rad/s"),
        ({"length": 400.0}, "look like millimetres"),
    ):
        (doubt,) = doubted_units(dynid.load_robot(written(path, **change)))
        assert said in doubt.message
    for change, said in (
        ({"turn": 500.0}, "position limits of joint 1 reach 500 m, and look like millimetres"),
        ({"speed": 250.0}, "velocity limits of joint 2 reach 250 m/s, and look like millimetres"),
    ):
        sliding = (
            written(path, **change)
            .read_text()
            .replace("[limits]", 'joint_types = ["prismatic", "prismatic", "revolute"]\n[limits]')
        )
        path.write_text(sliding)
        (doubt,) = doubted_units(dynid.load_robot(path))
        assert said in doubt.message
    assert doubted_units(dynid.load_robot(written(path))) == []
    ur5 = dynid.load_robot("ur5")
    (doubt,) = doubted_units(replace(ur5, inertias=1000.0 * ur5.inertias))
    assert "look like grams" in doubt.message
    assert doubt.kind == "torque"
    (doubt,) = doubted_units(replace(ur5, inertias=0.001 * ur5.inertias))
    assert "look like placeholders" in doubt.message
    bodies = [
        replace(body, points=body.points / 1000, radius=body.radius / 1000)
        if body.link == 4
        else body
        for body in ur5.bodies
    ]
    tiny = replace(ur5, bodies=tuple(bodies))
    assert [item.kind for item in doubted_units(tiny)] == ["self_collision", "environment"]
    assert "what wrist_1_joint moves" in doubted_units(tiny)[0].message
    assert [item.kind for item in safe_constraints(tiny, floor="none").unjudged] == [
        "self_collision"
    ]


def test_doubts_do_not_depend_on_where_link_frames_stand() -> None:
    ur5 = dynid.load_robot("ur5")
    moved, placements = 4.0 * ur5.axes, ur5.placements.copy()
    placements[:, :3, 3] += np.einsum("nij,nj->ni", placements[:, :3, :3], moved)
    placements[1:, :3, 3] -= moved[:-1]
    bodies = tuple(
        replace(body, points=body.points - moved[body.link - 1]) if body.link else body
        for body in ur5.bodies
    )
    elsewhere = replace(ur5, placements=placements, bodies=bodies)
    assert doubted_units(elsewhere) == []
    shapes = (
        Shape(name="ball", kind=SPHERE, pose=from_xyz_rpy([4, 0, 0], [0, 0, 0]), size=[0.1, 0, 0]),
    )
    for robot in (ur5, elsewhere):
        told = safe_constraints(robot, Scene(shapes=shapes)).notes
        assert any("'ball' is out of reach, about 3" in note for note in told)


def test_analyses_designs_and_checks_say_it(tmp_path: Path) -> None:
    arm = dynid.load_robot(written(tmp_path / "arm.toml", turn=180.0))
    settings = dynid.DesignSettings(starts=1, harmonics=2, period_s=4.0)
    file = tmp_path / "design.json"
    found = dynid.design(tmp_path / "arm.toml", settings, output=file)
    assert "look like degrees" in dynid.analyze(arm).to_json()["notes"][0]
    for judged in (found, dynid.check(file), dynid.check(file, limits="paper")):
        document = judged.to_json()
        assert document["certificate"] == "unjudged"
        assert not document["feasible"]
        assert "look like degrees" in document["unjudged"][0]["message"]


def test_where_no_motion_is_found_the_probable_cause_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynid.excitation.purpose.free_poses", lambda *_: np.zeros((0, 3)))
    settings = dynid.DesignSettings(starts=1, harmonics=2, period_s=4.0)
    with pytest.raises(dynid.InputError, match=r"keeps the limits.*look like millimetres"):
        dynid.design(written(tmp_path / "arm.toml", length=400.0), settings)


@pytest.mark.parametrize("robot", [*EXAMPLES, *(known.name for known in dynid.robots())], ids=str)
def test_real_arms_are_not_suspected(robot: object) -> None:
    model = dynid.load_robot(robot if isinstance(robot, Path) else str(robot))
    assert doubted_units(model) == []


def test_limits_that_stand_for_none_are_unknown_in_robot_files_too(tmp_path: Path) -> None:
    robot = dynid.load_robot(written(tmp_path / "arm.toml", turn=1e4, speed=1e5))
    assert np.isnan([robot.limits.lower[0], robot.limits.upper[0], robot.limits.velocity[1]]).all()
    assert doubted_units(robot) == []
    judge = safe_constraints(robot, collision=False)
    assert any("no position limits are known of joint_1" in note for note in judge.notes)
    assert "velocity" in {item.kind for item in judge.unjudged}


def test_joints_without_limits_are_not_suspected() -> None:
    robot = dynid.load_robot("ur5")
    for value in (np.inf, np.nan, 1e16):
        wide = replace(robot.limits, velocity=np.full(6, value))
        assert doubted_units(replace(robot, limits=wide)) == []
