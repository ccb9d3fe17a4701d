import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chains_for_constraints import random_arm

from dynid.constraints import (
    BOX,
    HALF_SPACE,
    SPHERE,
    ConstraintSettings,
    Shape,
    safe_constraints,
    scene_from_json,
)
from dynid.core import InputError, JsonFields, MotionBounds, load_object
from dynid.robot import Body, load_robot
from dynid.trajectory import usable_bounds

BALL = {"type": "sphere", "radius": 0.1, "position": [1, 0, 0]}
BOX_1 = {"type": "box", "size": [1, 1, 1], "position": [2, 0, 0]}


def scene(*shapes: Any, **more: Any) -> Any:
    return scene_from_json(JsonFields({"shapes": list(shapes), **more}))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_a_scene_file_is_read(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "cell.json"
    path.write_text(
        json.dumps(
            {
                "shapes": [
                    {"type": "floor"},
                    {"type": "table", "name": "bench", "size": [1, 2], "position": [0, 0, 0.5]},
                ],
                "payload": [BALL],
            }
        ),
        encoding=encoding,
    )
    found = scene_from_json(load_object(path), str(path))
    assert [item.kind for item in found.shapes] == [HALF_SPACE, BOX]
    assert found.shapes[1].name == "bench"
    np.testing.assert_allclose(found.shapes[1].size, [0.5, 1.0, 0.025])
    np.testing.assert_allclose(found.shapes[1].pose[:3, 3], [0, 0, 0.475])
    assert found.payload[0].name == "sphere 1"
    assert found.source == str(path)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ({"type": "pyramid"}, "shapes 1: unknown shape.*pyramid.*floor, wall, table"),
        ({"type": "box", "size": [1, 1], "position": [0, 0, 0]}, "'size' must hold 3 numbers"),
        ({"type": "box", "size": [1, 1, -1], "position": [0, 0, 1]}, "sizes must be positive"),
        ({**BALL, "colour": "red"}, r"shapes 1 \(sphere\): unknown key 'colour'"),
        ({"type": "sphere", "position": [0, 0, 1]}, "'radius' is missing"),
        ({"type": "wall", "point": [0, 0, 0], "normal": [0, 0, 0]}, "no length"),
        ({"type": "floor", "height": "low"}, "height must be a number"),
        ({"type": "floor", "height": float("-inf")}, "height must be a finite number; got -inf"),
        ({**BALL, "position": [600, 500, 250]}, r"shapes 1 \(sphere\): .*in metres; got 600 m"),
        ({"type": "wall", "point": [900, 0, 0], "normal": [-1, 0, 0]}, "in metres; got 900 m"),
        ({"type": "floor", "height": -750}, "in metres; got 750 m"),
        ({**BOX_1, "rpy": [0, 0, 45]}, "'rpy' is in radians.*45"),
        ("floor", "must be a JSON object"),
    ],
)
def test_a_wrong_shape_is_named(shape: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        scene(shape)


def test_a_pose_that_scales_or_mirrors_is_refused() -> None:
    for diagonal in ([2, 2, 2, 1], [1, 1, -1, 1]):
        with pytest.raises(InputError, match="ball: a placement is not a rotation"):
            Shape(name="ball", kind=SPHERE, pose=np.diag(diagonal), size=[0.1, 0, 0])


def test_a_shape_that_no_pose_comes_near_is_told() -> None:
    robot = load_robot("ur5")
    judge = safe_constraints(robot, scene(BALL, {"type": "floor", "height": -75}))
    told = [note for note in judge.notes if "out of reach" in note]
    assert len(told) == 1
    assert "'floor 2' is out of reach, about 74" in told[0]
    assert "metres" in told[0]


def test_the_bodies_of_a_single_joint_count_for_its_length(tmp_path: Path) -> None:
    path = tmp_path / "table.urdf"
    path.write_text(
        """<robot name="table"><link name="a"/><link name="b">
        <collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.1 0.1"/></geometry></collision>
        </link><joint name="j" type="revolute"><parent link="a"/><child link="b"/>
        <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2"/>
        </joint></robot>"""
    )
    judge = safe_constraints(load_robot(path), scene({**BALL, "position": [0.45, 0.5, 0.3]}))
    assert not [note for note in judge.notes if "out of reach" in note]
    assert "environment" not in [item.kind for item in judge.unjudged]


def test_wrong_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "cell.json"
    for text, message in (
        ("{", "the file was cut short"),
        ("[]", "JSON object"),
        ("{}", "needs 'shapes' or 'payload'"),
        ('{"shape": []}', "unknown key 'shape'"),
        ('{"shapes": {}}', "must be a list"),
        ('{"payload": [{"type": "floor"}]}', "payload 1: unknown shape"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=message) as caught:
            scene_from_json(load_object(path), str(path))
        assert str(path) in str(caught.value)
    with pytest.raises(InputError, match="cannot be read"):
        load_object(tmp_path / "none.json")


def test_a_scene_that_encloses_the_robot_is_refused() -> None:
    around = {"type": "box", "name": "cell", "size": [4, 4, 4], "position": [0, 0, 0]}
    with pytest.raises(InputError, match=r"no room.*'cell' in every pose"):
        safe_constraints(load_robot("ur5"), scene(around))


def test_the_floor_that_the_robot_stands_on_is_allowed() -> None:
    judge = safe_constraints(load_robot("ur5"), scene({"type": "floor", "height": 0.0}))
    home = np.array([0.0, -1.2, 0.9, 0.0, -1.57, 0.0])
    judge.check_pose(home)
    with pytest.raises(InputError, match=r"floor.*start pose is in collision"):
        judge.check_pose(np.array([0.0, 0.6, 0.0, 0.0, 0.0, 0.0]))
    with pytest.raises(InputError, match="start pose is outside the position limits"):
        judge.check_pose(np.array([7.0, -1.2, 0.9, -1.2, -1.57, 0.0]))


def test_a_payload_is_carried_along() -> None:
    robot = load_robot("ur5")
    home = np.array([0.0, -0.6, 0.9, -1.87, -1.57, 0.0])
    floor = {"type": "floor", "height": -0.2}
    free = safe_constraints(robot, scene(floor))
    ball = {"type": "sphere", "radius": 0.1, "position": [0, 0, 0.25]}
    loaded = safe_constraints(robot, scene(floor, payload=[ball]))
    rest = np.zeros((1, 6))
    before, after = (
        judge.usage(home[None], rest, rest)["environment"].margin for judge in (free, loaded)
    )
    assert after < before - 0.1


def test_contradictory_limits_are_refused() -> None:
    robot = load_robot("ur5")
    bounds = usable_bounds(robot.limits)
    stuck = MotionBounds(
        lower=np.zeros(6),
        upper=np.zeros(6),
        velocity=bounds.velocity,
        acceleration=bounds.acceleration,
    )
    with pytest.raises(InputError, match="joint 1: the position limits leave no room"):
        ConstraintSettings(bounds=stuck)
    unknown = replace(bounds, velocity=np.full(6, np.nan))
    with pytest.raises(InputError, match="velocity bounds hold an unknown number"):
        ConstraintSettings(bounds=unknown)
    with pytest.raises(InputError, match="clearance"):
        ConstraintSettings(bounds=bounds, clearance=-0.1)


def test_a_scene_needs_bodies() -> None:
    with pytest.raises(InputError, match="no moving link has a collision body"):
        safe_constraints(replace(load_robot("ur5"), bodies=()), scene(BALL))


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ({"type": "box", "size": [1, 1, 1]}, "'position' is missing"),
        ({"type": "cylinder", "radius": 1, "position": [0, 0, 0]}, "'length' is missing"),
        ({"type": "box", "size": [1, 1, -1], "position": [0, 0, 0]}, "sizes must be positive"),
    ],
)
def test_what_is_missing_is_named(shape: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        scene_from_json(JsonFields({"shapes": [shape]}))


def test_a_payload_that_no_pose_can_carry_is_refused() -> None:
    huge = {"payload": [{"type": "sphere", "radius": 2, "position": [0, 0, 0]}]}
    with pytest.raises(InputError, match="in collision in every pose"):
        safe_constraints(load_robot("ur5"), scene_from_json(JsonFields(huge)))


def test_what_hardly_reaches_a_wall_is_still_judged_against_it() -> None:
    # Some poses are tried; the one in which the arm points at the wall is not among them.
    tip = Body(name="tip 1", link=2, points=[[0.4, 0, 0], [0.45, 0, 0]], radius=0.05)
    ball = Body(name="ball 1", link=0, points=[[0, 0, 0], [0, 0, 0.1]], radius=0.05)
    arm = replace(random_arm(2, 0, slides=False), bodies=(ball, tip))
    placements = np.tile(np.eye(4), (2, 1, 1))
    arm = replace(arm, placements=placements, axes=np.array([[0.0, 0, 1], [0.0, 1, 0]]))
    turn = -1.06
    still, pointing = np.zeros((1, 2)), np.array([[turn, 0.0]])
    # Of the poses tried none comes nearer than 7 mm to a wall that is 1 mm within reach.
    x, y = np.cos(turn), np.sin(turn)
    wall = {"type": "wall", "point": [0.499 * x, 0.499 * y, 0], "normal": [-x, -y, 0]}
    judge = safe_constraints(arm, scene(wall), acceleration=10.0, floor="none")
    usage = judge.usage(pointing, still, still)
    assert not judge.holds(pointing, still, still)
    assert usage["environment"].margin < 0.01
    assert judge.holds(pointing + 0.5, still, still)
