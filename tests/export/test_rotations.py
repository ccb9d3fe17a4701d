import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynid.export import quaternion, roll_pitch_yaw
from dynid.export.robot_xml import upright

ANGLES = st.floats(-np.pi, np.pi)
# Upright, and near it, as rounded angles in URDF files are.
PITCHES = [np.pi / 2, -np.pi / 2, 0.0, 1.5707963, -1.570796, 1.5703125, 1.5708]
# The precision that URDF torques need is 1e-9; rotations must be far better.
SAME = 1e-14


@given(ANGLES, st.one_of(ANGLES, st.sampled_from(PITCHES)), ANGLES)
@settings(max_examples=200)
def test_angles_and_quaternions_are_scipys(roll: float, pitch: float, yaw: float) -> None:
    matrix = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
    again = Rotation.from_euler("xyz", roll_pitch_yaw(matrix)).as_matrix()
    np.testing.assert_allclose(again, matrix, rtol=0, atol=SAME)
    w, x, y, z = quaternion(matrix)
    assert w >= 0
    np.testing.assert_allclose(Rotation([x, y, z, w]).as_matrix(), matrix, rtol=0, atol=SAME)


@pytest.mark.parametrize(
    "gravity", [[0, 0, -9.81], [0, 0, 9.81], [9.81, 0, 0], [1, -2, 3], [0, -9.8, 1e-9], [0, 0, 0]]
)
def test_upright_takes_gravity_down(gravity: list[float]) -> None:
    turn = upright(np.array(gravity, dtype=float))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), rtol=0, atol=SAME)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    down = [0.0, 0.0, -float(np.linalg.norm(gravity))]
    np.testing.assert_allclose(turn @ gravity, down, rtol=0, atol=1e-13)
