"""Built-in arithmetic against scipy, pinocchio and hand calculation."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynid.core import Array
from scripts import value

EXACT = 1e-12
part = st.floats(-3.0, 3.0)
poses = st.lists(part, min_size=6, max_size=6)


def written(pose: list[float]) -> str:
    return "p[" + ", ".join(f"{number:.17g}" for number in pose) + "]"


def transform(pose: list[float]) -> pin.SE3:
    return pin.SE3(pin.exp3(np.array(pose[3:])), np.array(pose[:3]))


def difference(found: list[float], expected: pin.SE3) -> float:
    return float(np.abs(transform(found).homogeneous - expected.homogeneous).max())


@settings(derandomize=True, max_examples=40)
@given(poses, poses)
def test_poses_against_pinocchio(first: list[float], second: list[float]) -> None:
    a, b = transform(first), transform(second)
    one, two = written(first), written(second)
    assert difference(value(f"pose_trans({one}, {two})"), a * b) < EXACT
    assert difference(value(f"pose_inv({one})"), a.inverse()) < EXACT
    added = pin.SE3(a.rotation @ b.rotation, a.translation + b.translation)
    assert difference(value(f"pose_add({one}, {two})"), added) < EXACT
    apart = pin.SE3(a.rotation @ b.rotation.T, a.translation - b.translation)
    assert difference(value(f"pose_sub({one}, {two})"), apart) < EXACT


@settings(derandomize=True, max_examples=40)
@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3), st.floats(0.0, np.pi))
def test_rotation_vectors_up_to_half_a_turn(axis: list[float], angle: float) -> None:
    direction = np.array(axis)
    length = np.linalg.norm(direction)
    if length < 0.1:
        return
    vector = direction / length * angle
    found = value(f"pose_trans(p[0,0,0,0,0,0], {written([0, 0, 0, *vector])})")
    assert np.linalg.norm(found[3:]) <= np.pi + EXACT
    apart = Rotation.from_rotvec(found[3:]).inv() * Rotation.from_rotvec(vector)
    assert apart.magnitude() < 1e-7


def test_interpolation_ends_and_middle() -> None:
    first, second = "p[0,0,0,0,0,0]", "p[1,2,3,0,0,1]"
    assert value(f"interpolate_pose({first}, {second}, 0.0)") == pytest.approx([0] * 6, abs=EXACT)
    assert value(f"interpolate_pose({first}, {second}, 1.0)") == pytest.approx([1, 2, 3, 0, 0, 1])
    assert value(f"interpolate_pose({first}, {second}, 0.5)") == pytest.approx(
        [0.5, 1, 1.5, 0, 0, 0.5]
    )


@settings(derandomize=True, max_examples=30)
@given(st.lists(st.floats(-1.4, 1.4), min_size=3, max_size=3))
def test_roll_pitch_yaw_against_scipy(angles: list[float]) -> None:
    written_angles = ", ".join(f"{angle:.17g}" for angle in angles)
    vector = value(f"rpy2rotvec([{written_angles}])")
    expected: Array = Rotation.from_euler("xyz", angles).as_rotvec()
    assert vector == pytest.approx(expected.tolist(), abs=1e-9)
    back = value(f"rotvec2rpy(rpy2rotvec([{written_angles}]))")
    assert back == pytest.approx(angles, abs=1e-9)


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("sin(0.5)", np.sin(0.5)),
        ("cos(0.5)", np.cos(0.5)),
        ("tan(0.5)", np.tan(0.5)),
        ("asin(0.5)", np.arcsin(0.5)),
        ("acos(0.5)", np.arccos(0.5)),
        ("atan(0.5)", np.arctan(0.5)),
        ("atan2(1.0, -1.0)", np.arctan2(1, -1)),
        ("sqrt(2)", np.sqrt(2)),
        ("pow(2, 0.5)", np.sqrt(2)),
        ("log(10, 1000)", 3.0),
        ("d2r(180)", np.pi),
        ("r2d(1)", 180 / np.pi),
        ("norm([3, 4])", 5.0),
        ("norm(-2.5)", 2.5),
        ("ceil(1.2)", 2),
        ("floor(-1.2)", -2),
        ("length([1, 2, 3])", 3),
        ("point_dist(p[0,0,0,1,1,1], p[1,2,2,0,0,0])", 3.0),
        ("pose_dist(p[0,0,0,0,0,0], p[0,0,0,0,0,1])", 1.0),
        ("binary_list_to_integer(integer_to_binary_list(-5))", -5),
        ('str_len("abc")', 3),
        ('str_find("abcabc", "ca")', 2),
        ('to_num("1.5")', 1.5),
    ],
)
def test_numbers(expression: str, expected: float) -> None:
    assert value(expression) == pytest.approx(expected, rel=1e-14, abs=0)


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ('str_cat("a", "b")', "ab"),
        ('str_cat("a ", str_cat(1, [2, True]))', "a 1[2, True]"),
        ("[1, 2] + [3, 4.5]", [4, 6.5]),
        ("2 * [1, 2.5] - 1", [1, 4.0]),
        ("-[1, 2] / 2", [-0.5, -1.0]),
        ("norm([3, 4] - [0, 0])", 5.0),
        ("[5, 4] - [1, 2]", [4, 2]),
        ("[6, 4] / [2, 8]", [3.0, 0.5]),
        ("normalize([3, 4])", [0.6, 0.8]),
        ("make_list(3, 7)", [7, 7, 7]),
        ("size([1, 2])", 2),
        ('str_sub("abcdef", 2, 3)', "cde"),
        ('str_at("abc", 1)', "b"),
        ("to_str(p[1, 0, 0, 0, 0, 0.5])", "p[1, 0, 0, 0, 0, 0.5]"),
        ("to_str(True)", "True"),
    ],
)
def test_texts(expression: str, expected: str) -> None:
    assert value(expression) == expected


def test_truth_values() -> None:
    assert value('str_empty("")') is True
    assert value("integer_to_binary_list(5)")[:4] == [True, False, True, False]
