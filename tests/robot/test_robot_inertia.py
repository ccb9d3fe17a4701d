import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robot_oracles import from_pinocchio

from dynid.core import InputError, RobotError
from dynid.robot import (
    frame_map,
    from_body,
    from_pseudo_inertia,
    from_xyz_rpy,
    is_physical,
    move,
    tensor,
    to_pseudo_inertia,
)

numbers = st.floats(-5, 5).map(lambda value: round(value, 6))
tens = st.lists(numbers, min_size=10, max_size=10).map(np.array)
poses = st.lists(numbers, min_size=6, max_size=6).map(lambda v: from_xyz_rpy(v[:3], v[3:]))


@pytest.mark.parametrize("seed", range(5))
def test_bodies_and_moves_agree_with_pinocchio(seed: int) -> None:
    pin.seed(seed)
    body, frame = pin.Inertia.Random(), pin.SE3.Random()
    ours = from_body(body.mass, body.lever, body.inertia)
    np.testing.assert_allclose(from_pinocchio(body.toDynamicParameters()), ours, atol=1e-12)
    moved = frame.act(body).toDynamicParameters()
    np.testing.assert_allclose(move(ours, frame.homogeneous), from_pinocchio(moved), atol=1e-12)


@settings(max_examples=50)
@given(tens, poses, poses)
def test_frame_maps_are_linear_and_compose(ten, first, second) -> None:
    np.testing.assert_allclose(from_pseudo_inertia(to_pseudo_inertia(ten)), ten, atol=1e-9)
    both = frame_map(first) @ frame_map(second)
    np.testing.assert_allclose(frame_map(first @ second), both, atol=1e-8)
    np.testing.assert_allclose(frame_map(first) @ ten, move(ten, first), atol=1e-9)


def test_many_links_at_once() -> None:
    rows = np.arange(40.0).reshape(4, 10)
    np.testing.assert_array_equal(from_pseudo_inertia(to_pseudo_inertia(rows)), rows)
    assert tensor(rows).shape == (4, 3, 3)
    assert tensor(rows)[0, 1, 2] == 7.0  # Jyz


def test_the_unknown_stays_unknown_and_the_known_known() -> None:
    ten = from_body(2.0, [0.1, 0, 0], np.full((3, 3), np.nan))
    moved = move(ten, from_xyz_rpy((0, 0, 1), (0, 0, np.pi / 2)))
    np.testing.assert_allclose(moved[:4], [2, 0, 0.2, 2], atol=1e-15)
    assert np.isnan(moved[4:]).all()


def test_physical_bodies() -> None:
    assert is_physical(from_body(1.0, [0.1, 0.2, 0.3], np.diag([0.1, 0.1, 0.15])))
    assert not is_physical(from_body(1.0, [0, 0, 0], np.diag([0.1, 0.1, 0.3])))
    assert is_physical(np.zeros(10))


def test_what_is_no_body_is_refused() -> None:
    with pytest.raises(RobotError, match="mass"):
        from_body(-1.0, [0, 0, 0], np.eye(3))
    with pytest.raises(RobotError, match="symmetric"):
        from_body(1.0, [0, 0, 0], np.triu(np.ones((3, 3))))
    with pytest.raises(InputError, match="shape"):
        from_body(1.0, [0, 0], np.eye(3))
    with pytest.raises(InputError, match="finite"):
        frame_map(np.full((4, 4), np.nan))
