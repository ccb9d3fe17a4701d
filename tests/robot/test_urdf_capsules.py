from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robot_oracles import DATA, needs_models

from dynid.robot.capsule import Capsule
from dynid.robot.urdf import load_urdf
from dynid.robot.urdf_capsules import with_collision_geometry

ROUNDING = 1e-9


def arm(tmp_path: Path, *shapes: str) -> tuple[Path, Any]:
    elements = "".join(
        f'<collision><origin xyz="0.1 0 0.2" rpy="0.3 0 1"/><geometry>{one}</geometry></collision>'
        for one in shapes
    )
    path = tmp_path / "arm.urdf"
    path.write_text(
        f'<robot name="arm"><link name="base"/><link name="one">{elements}</link>'
        '<link name="hand"><collision><geometry><sphere radius="0.05"/></geometry></collision>'
        '</link><joint name="j" type="revolute"><parent link="base"/><child link="one"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        '<joint name="f" type="fixed"><parent link="one"/><child link="hand"/>'
        '<origin xyz="0 0 0.5"/></joint></robot>'
    )
    return path, load_urdf(path)


def depth(points: np.ndarray, item: Capsule) -> np.ndarray:
    way = item.end - item.start
    t = np.clip((points - item.start) @ way / max(way @ way, 1e-18), 0, 1)
    return np.linalg.norm(points - item.start - t[:, None] * way, axis=1) - item.radius


def rotation() -> np.ndarray:
    z, x = 1.0, 0.3
    turn_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    turn_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    return turn_z @ turn_x


@pytest.mark.parametrize("sides", [(0.1, 0.2, 0.6), (0.3, 0.3, 0.3), (0.5, 0.4, 0.02)])
def test_boxes_are_enclosed(tmp_path: Path, sides: tuple[float, ...]) -> None:
    path, robot = arm(tmp_path, f'<box size="{sides[0]} {sides[1]} {sides[2]}"/>')
    found = with_collision_geometry(robot, path)
    signs = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    corners = signs * sides @ rotation().T + [0.1, 0, 0.2]
    assert depth(corners, found.capsules[0]).max() <= ROUNDING
    assert found.capsules[0].radius < 0.8 * np.linalg.norm(sides)


@pytest.mark.parametrize(("radius", "length"), [(0.05, 0.4), (0.2, 0.05)])
def test_cylinders_are_enclosed(tmp_path: Path, radius: float, length: float) -> None:
    path, robot = arm(tmp_path, f'<cylinder radius="{radius}" length="{length}"/>')
    item = with_collision_geometry(robot, path).capsules[0]
    turn = np.linspace(0, 2 * np.pi, 50)
    rim = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(50, length / 2)])
    points = np.concatenate([rim, rim * [1, 1, -1]]) @ rotation().T + [0.1, 0, 0.2]
    assert depth(points, item).max() <= ROUNDING


def test_fixed_links_carry_their_shapes(tmp_path: Path) -> None:
    path, robot = arm(tmp_path)
    (ball,) = with_collision_geometry(robot, path).capsules
    assert (ball.name, ball.link, ball.radius) == ("hand 1", 1, 0.05)
    np.testing.assert_allclose(ball.start, [0, 0, 0.5], atol=1e-12)


def test_what_cannot_be_read_is_noted(tmp_path: Path) -> None:
    path, robot = arm(tmp_path, '<mesh filename="none.stl"/>', '<capsule radius="1"/>')
    found = with_collision_geometry(robot, path)
    assert len(found.capsules) == 1
    assert any("none.stl was not found" in note for note in found.notes)
    assert any("no capsule for a capsule" in note for note in found.notes)


@needs_models
def test_meshes_are_enclosed() -> None:
    path = DATA / "panda_description" / "urdf" / "panda.urdf"
    robot = with_collision_geometry(load_urdf(path), path)
    assert {item.link for item in robot.capsules} == set(range(8))
    assert all(item.radius < 0.2 for item in robot.capsules)
