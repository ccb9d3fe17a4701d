from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from robot_oracles import UR5_DH, classes, flange_pose, pinocchio_model

from dynid.core import InputError, RobotError
from dynid.robot import from_xyz_rpy, joint_poses, robot_from_dh

EXACT = {0.0, 1.0, -1.0}


def _turn(axis: str, angle: float) -> np.ndarray:
    return from_xyz_rpy((0, 0, 0), [angle if axis == k else 0.0 for k in "xyz"])


def _slide(x: float, z: float) -> np.ndarray:
    return from_xyz_rpy((x, 0, z), (0, 0, 0))


def _table(seed: int, n: int = 5) -> dict[str, Any]:
    random = np.random.default_rng(seed)
    kinds = [("revolute", "prismatic")[k] for k in random.integers(0, 2, n)]
    return {
        **{key: random.uniform(-2, 2, n) for key in ("a", "d", "alpha", "theta")},
        "joint_types": kinds,
        "sign": random.choice([-1.0, 1.0], n),
        "base": from_xyz_rpy(random.uniform(-1, 1, 3), random.uniform(-3, 3, 3)),
        "flange": from_xyz_rpy(random.uniform(-1, 1, 3), random.uniform(-3, 3, 3)),
    }


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("seed", range(4))
def test_forward_kinematics_is_the_product_of_the_rows(convention: str, seed: int) -> None:
    table = _table(seed)
    robot = robot_from_dh(convention=convention, **table)
    q = np.random.default_rng(seed).uniform(-2, 2, 5)
    pose = table["base"]
    frames = []
    for k in range(5):
        slides = table["joint_types"][k] == "prismatic"
        move = table["sign"][k] * q[k]
        theta = table["theta"][k] + (0 if slides else move)
        d = table["d"][k] + (move if slides else 0)
        link = _slide(table["a"][k], 0) @ _turn("x", table["alpha"][k])
        screw = _turn("z", theta) @ _slide(0, d)
        pose = pose @ (screw @ link if convention == "standard" else link @ screw)
        frames.append(pose)
    key = "dh" if convention == "standard" else "mdh"
    ours = joint_poses(robot, q) @ robot.parameter_frames[key]
    np.testing.assert_allclose(ours, frames, atol=1e-12)
    np.testing.assert_allclose(flange_pose(robot, q), pose @ table["flange"], atol=1e-12)


def test_joint_poses_agree_with_pinocchio_for_many_positions() -> None:
    robot = robot_from_dh(**_table(7))
    model = pinocchio_model(robot)
    data = model.createData()
    q = np.random.default_rng(1).uniform(-3, 3, (4, 3, 5))
    ours = joint_poses(robot, q)
    assert ours.shape == (4, 3, 5, 4, 4)
    for index in np.ndindex(4, 3):
        pin.forwardKinematics(model, data, q[index])
        theirs = [data.oMi[k + 1].homogeneous for k in range(5)]
        np.testing.assert_allclose(ours[index], theirs, atol=1e-12)
    with pytest.raises(RobotError, match="do not fit"):
        joint_poses(robot, np.zeros(4))


def test_right_angles_are_exact() -> None:
    robot = robot_from_dh(**UR5_DH)
    everything = [
        robot.placements[:, :3, :3],
        *[f[:, :3, :3] for f in robot.parameter_frames.values()],
    ]
    assert set(np.concatenate([x.ravel() for x in everything]).tolist()) <= EXACT
    assert robot.default_frames == "dh"
    np.testing.assert_array_equal(robot.axes, np.tile([0.0, 0, 1], (6, 1)))


def test_the_papers_class_counts() -> None:
    robot = robot_from_dh(**UR5_DH)
    assert classes(robot, "dh") == (52, 36, 33, 9)
    assert classes(robot, "mdh") == (52, 36, 31, 11)


def test_nearly_parallel_tables_keep_sane_frames() -> None:
    table = {key: np.array(value, dtype=float) for key, value in UR5_DH.items()}
    table["alpha"][1] = 1e-4
    table["d"][1], table["d"][2] = 350.0, -350.0  # what a factory calibration writes
    robot = robot_from_dh(**table)
    assert "nearly parallel" in robot.notes[0]
    for frames in (robot.placements, *robot.parameter_frames.values()):
        assert np.abs(frames[:, :3, 3]).max() < 1.0
    # Joint 3 takes back what joint 2 adds, but for the small angle between them.
    nominal = robot_from_dh(**UR5_DH)
    q = np.array([0.3, -0.7, 1.1, 0.2, -0.5, 0.9])
    np.testing.assert_allclose(flange_pose(robot, q), flange_pose(nominal, q), atol=0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"convention": "classic"}, "convention"),
        ({"a": []}, "wrong shape"),
        ({"a": [0, 1]}, "wrong shape"),
        ({"d": [np.inf] * 6}, "not finite"),
        ({"sign": [2, 1, 1, 1, 1, 1]}, "sign"),
        ({"joint_types": ["revolute"]}, "joint types"),
        ({"joint_types": ["screw"] * 6}, "joint types"),
        ({"joint_names": ["a"] * 6}, "repeat"),
        ({"a": np.zeros(0), "d": [], "alpha": []}, "number of joints"),
        ({"base": np.zeros((4, 4))}, "rotation"),
    ],
)
def test_bad_tables(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        robot_from_dh(**(UR5_DH | change))
