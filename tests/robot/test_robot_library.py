import pickle
from pathlib import Path

import numpy as np
import pytest
from robot_oracles import EXAMPLES, classes, flange_pose
from urdf_samples import ARM, URS

from dynid.core import RobotError
from dynid.robot import (
    is_physical,
    joint_poses,
    load_robot,
    nominal_geometry,
    robot_from_json,
    robot_from_urdf,
    robot_to_json,
    robots,
    rotation_z,
)

NAMES = ["ur10", "ur10e", "ur16e", "ur3", "ur3e", "ur5", "ur5e"]
ROS_NAMES = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)


def test_the_list() -> None:
    listed = {entry.name: entry for entry in robots()}
    assert list(listed) == sorted(listed)
    for name in NAMES:
        assert listed[name].joints == 6
        assert "Universal Robots" in listed[name].source


@pytest.mark.parametrize("name", NAMES)
def test_every_number_has_a_source(name: str) -> None:
    robot = load_robot(name)
    for group in ("dh:", "urdf_frames:", "limits:", "inertia:"):
        assert group in robot.source
    assert robot.joint_names == ROS_NAMES
    assert nominal_geometry(robot) is robot
    known = ~np.isnan(robot.inertias)
    assert known[:, :4].all()
    if name in ("ur3", "ur5"):
        assert not known[:, 4:].any()  # Universal Robots publishes no tensors for these
    else:
        assert all(is_physical(row) for row in robot.inertias)
    assert np.isnan(robot.drives.gear_ratio).all() == (name != "ur5")
    assert np.isnan(robot.limits.acceleration).all() == (name != "ur5")


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10"])
def test_tables_and_urdf_frames_are_those_of_ros(name: str) -> None:
    urdf = robot_from_urdf(URS[name].encode())
    robot = load_robot(name)
    turned = rotation_z(np.pi)  # ROS's base_link in Universal Robots' base
    for q in np.random.default_rng(0).uniform(-3, 3, (3, 6)):
        ours = joint_poses(robot, q) @ robot.parameter_frames["urdf"]
        np.testing.assert_allclose(ours, turned @ joint_poses(urdf, q), atol=1e-10)
        there = turned @ flange_pose(urdf, q)
        np.testing.assert_allclose(flange_pose(robot, q), there, atol=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_class_counts(name: str) -> None:
    robot = load_robot(name)
    assert classes(robot, "dh") == (52, 36, 33, 9)
    assert classes(robot, "mdh") == (52, 36, 31, 11)
    assert classes(robot, "urdf") == (52, 34, 35, 9)


@pytest.mark.parametrize(
    ("mount", "gravity", "count"),
    [
        ("floor", (0, 0, -1), 52),
        ("ceiling", (0, 0, 1), 52),
        ("wall", (0, -1, 0), 54),
        ("tilt:45", (0, -(0.5**0.5), -(0.5**0.5)), 54),
        ("tilt:180", (0, 0, 1), 52),
    ],
)
def test_mounting(mount: str, gravity: tuple[float, ...], count: int) -> None:
    robot = load_robot("ur5", mount=mount)
    assert robot.mount == mount
    np.testing.assert_allclose(robot.gravity, np.array(gravity) * 9.80665, atol=1e-12)
    assert classes(robot, "dh")[0] == count


@pytest.mark.parametrize("mount", ["roof", "tilt", "tilt:", "tilt:x", "tilt:nan", "tilt:1e9", ""])
def test_unknown_mounting(mount: str) -> None:
    with pytest.raises(RobotError, match=r"mounting|tilt needs degrees"):
        load_robot("ur5", mount=mount)


def test_a_mount_of_choice_wins_over_the_file(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text(
        '[dh]\nconvention="standard"\na=[1]\nd=[0]\nalpha=[0]\n[mount]\ngravity=[1,2,-9]\n'
    )
    robot = load_robot(path)
    assert robot.mount == "file"
    np.testing.assert_array_equal(robot.gravity, [1, 2, -9])
    np.testing.assert_allclose(load_robot(path, mount="ceiling").gravity, [0, 0, 9.80665])


@pytest.mark.parametrize(
    "name", ["ur6", "", " ", "nowhere/x.urdf", "a\0b", "x" * 5000, "~nobody/x", "a\nb"]
)
def test_what_is_neither_name_nor_file(name: str) -> None:
    with pytest.raises(
        RobotError, match=r"neither a built-in robot nor a file|no such file"
    ) as caught:
        load_robot(name)
    assert "ur10, ur10e, ur16e, ur3, ur3e, ur5, ur5e" in str(caught.value)
    assert "\n" not in str(caught.value)
    if name == "ur6":
        assert "Did you mean" in str(caught.value)


def test_files_are_told_apart_by_content(tmp_path: Path) -> None:
    urdf = tmp_path / "arm.txt"
    urdf.write_text("\n  " + ARM.lstrip())
    assert load_robot(urdf).joints == 3
    toml = tmp_path / "arm.xml"
    toml.write_text('[dh]\nconvention="standard"\na=[1]\nd=[0]\nalpha=[0]\n')
    assert load_robot(str(toml)).name == "arm"
    with pytest.raises(RobotError, match="is not a file"):
        load_robot(tmp_path)
    assert load_robot("UR5").name == "ur5"


@pytest.mark.parametrize("name", ["ur5", str(EXAMPLES / "tx40.toml")])
def test_robots_travel_to_workers_and_files(name: str) -> None:
    robot = load_robot(name)
    for copy in (pickle.loads(pickle.dumps(robot)), robot_from_json(robot_to_json(robot))):
        assert copy == robot
