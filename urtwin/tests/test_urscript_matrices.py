"""Matrices of scripts against numpy."""

import numpy as np
import pytest

from scripts import fault, value
from urtwin.kinematics import to_matrix

A, B = [[1.5, 2, -3], [4, 5, 6.25]], [[1, 0.5], [-2, 3], [0.25, 8]]
SQUARE = [[4.0, 1, 0], [1, 3, -1], [0, 2, 5]]
EXACT = 1e-12


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (f"{A} * {B}", np.array(A) @ np.array(B)),
        (f"{A} * [1, 2, 3]", np.array(A) @ [1, 2, 3]),
        (f"{A} * 2", 2 * np.array(A)),
        (f"2 * {A}", 2 * np.array(A)),
        (f"{A} + {A}", 2 * np.array(A)),
        ("[1, 2, 3] * [10, 20, 30]", [10, 40, 90]),
        (f"transpose({A})", np.array(A).T),
        (f"inv({SQUARE})", np.linalg.inv(SQUARE)),
        (f"inv({SQUARE}) * {SQUARE}", np.eye(3)),
    ],
)
def test_matrices_are_those_of_algebra(expression: str, expected: np.ndarray) -> None:
    np.testing.assert_allclose(value(expression), expected, atol=EXACT)


def test_the_inverse_of_a_pose_is_the_way_back() -> None:
    pose = [0.3, -0.2, 0.5, 0.4, -0.7, 1.1]
    back = to_matrix(value(f"inv(p{pose})"))
    np.testing.assert_allclose(back @ to_matrix(pose), np.eye(4), atol=EXACT)


def test_a_wrench_does_the_same_work_in_every_frame() -> None:
    pose, wrench = [0.3, -0.2, 0.5, 0.4, -0.7, 1.1], np.array([1.0, 2, -3, 0.5, -0.25, 4])
    moved = np.array(value(f"wrench_trans(p{pose}, {wrench.tolist()})"))
    frame = to_matrix(pose)
    twist = np.array([0.1, -0.4, 0.3, 0.7, 0.2, -0.6])
    turn = frame[:3, :3].T
    # The same motion, of the other frame's origin and in its axes.
    velocity = turn @ (twist[:3] + np.cross(twist[3:], frame[:3, 3]))
    assert moved @ [*velocity, *(turn @ twist[3:])] == pytest.approx(wrench @ twist, abs=EXACT)


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        (f"{A} * {A}", "do not fit"),
        ("inv([[1, 2], [2, 4]])", "singular"),
        ("transpose([1, 2])", "a matrix expected"),
        ("make_list(40, make_list(20, 1)) * make_list(20, make_list(40, 1))", "too big"),
    ],
)
def test_what_is_no_product_is_refused(expression: str, words: str) -> None:
    assert words in fault(f"def f():\n m = {expression}\nend\n")
