import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pinocchio_chains import (
    frame_change,
    random_chain,
    random_parameters,
    random_states,
    regressor,
    torques,
)

from dynid.core import InputError
from dynid.regressor import CHUNK, LANES, FrictionTerms, InverseDynamicModel
from dynid.regressor import inertial as inertial_kernel
from dynid.regressor.inertial import chain_constants, inertial_columns
from dynid.robot import RobotModel, load_robot, robots

PINOCCHIO = 1e-10
"""Of the largest number compared: the agreement that is asked for."""
SAME_ARITHMETIC = 1e-13
BARE = FrictionTerms(terms=(("fo", None),))
"""One column a joint beside the inertial ones, the fewest there can be."""


def _inertial(robot: RobotModel, frames: str, *state: np.ndarray) -> np.ndarray:
    model = InverseDynamicModel(robot=robot, frames=frames, friction=BARE)
    return model.regressor(*state)[:, :, : 10 * robot.joints]


def _assert_close(ours: np.ndarray, truth: np.ndarray) -> None:
    np.testing.assert_allclose(ours, truth, rtol=0, atol=PINOCCHIO * np.abs(truth).max())


@pytest.mark.parametrize("frames", ["dh", "urdf"])
@pytest.mark.parametrize("joints", range(1, 11))
def test_columns_are_pinocchios_in_any_frames(joints: int, frames: str) -> None:
    robot = random_chain(seed=joints, joints=joints)
    state = random_states(seed=100 + joints, samples=5, joints=joints)
    _assert_close(_inertial(robot, frames, *state), regressor(robot, frames, *state))


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_columns_are_pinocchios_for_joints_of_one_kind(kind: str) -> None:
    robot = random_chain(seed=3, joints=4, kinds=(kind,))
    state = random_states(seed=4, samples=7, joints=4)
    _assert_close(_inertial(robot, "mdh", *state), regressor(robot, "mdh", *state))


@given(
    seed=st.integers(0, 2**31),
    joints=st.integers(1, 10),
    gravity=st.tuples(*[st.floats(-100, 100)] * 3),
)
@settings(derandomize=True, max_examples=40)
def test_columns_are_pinocchios_in_any_gravity(
    seed: int, joints: int, gravity: tuple[float, float, float]
) -> None:
    robot = random_chain(seed, joints, gravity=gravity)
    state = random_states(seed + 1, samples=3, joints=joints)
    _assert_close(_inertial(robot, "dh", *state), regressor(robot, "dh", *state))


def test_without_gravity_and_motion_nothing_remains() -> None:
    robot = random_chain(seed=5, joints=4, gravity=(0.0, 0.0, 0.0))
    q, dq, _ = random_states(seed=6, samples=3, joints=4)
    assert not _inertial(robot, "dh", q, 0 * dq, 0 * dq).any()


@pytest.mark.parametrize("samples", [0, *range(1, 21), 2 * LANES, 2 * LANES + 1, 5 * LANES - 1])
def test_any_number_of_samples_fills_the_lanes(samples: int) -> None:
    robot = random_chain(seed=7, joints=3)
    state = random_states(seed=8, samples=samples, joints=3)
    ours = _inertial(robot, "dh", *state)
    assert ours.shape == (samples, 3, 30)
    if samples:
        _assert_close(ours, regressor(robot, "dh", *state))


def test_links_before_a_joint_do_not_load_it() -> None:
    robot = random_chain(seed=9, joints=5)
    columns = _inertial(robot, "dh", *random_states(seed=1, samples=40, joints=5))
    for joint in range(5):
        assert not columns[:, joint, : 10 * joint].any()
        assert columns[:, joint, 10 * joint :].any()


@pytest.mark.parametrize("samples", [3, 50])
def test_memory_given_again_is_written_again(samples: int) -> None:
    robot = random_chain(seed=10, joints=4)
    model = InverseDynamicModel(robot=robot)
    used = model.stack(*random_states(seed=1, samples=samples, joints=4))
    state = random_states(seed=2, samples=samples, joints=4)
    expected = model.stack(*state)
    assert np.abs(used - expected).max() > 1
    again = model.stack(*state, out=used)
    assert again is used
    np.testing.assert_array_equal(again, expected)


def test_layout_and_ownership_of_the_inputs_do_not_matter() -> None:
    model = InverseDynamicModel(robot=random_chain(seed=11, joints=4))
    state = random_states(seed=3, samples=33, joints=4)
    expected = model.stack(*state)
    compiled = len(inertial_kernel.inertial_rows.signatures)
    fortran = [np.asfortranarray(x) for x in state]
    for x in fortran:
        x.setflags(write=False)
    np.testing.assert_array_equal(model.stack(*fortran), expected)
    np.testing.assert_array_equal(
        model.stack(*(np.repeat(x, 2, axis=0)[::2] for x in state)), expected
    )
    # Compiling the kernel anew takes seconds.
    assert len(inertial_kernel.inertial_rows.signatures) == compiled


@pytest.mark.long
def test_the_kernel_writes_into_views() -> None:
    robot = random_chain(seed=12, joints=2)
    constants = chain_constants(robot, "dh")
    state = np.stack([x.T for x in random_states(seed=1, samples=20, joints=2)])
    expected = np.zeros((20, 2, 20))
    inertial_columns(constants, state, expected)
    whole = np.zeros((40, 2, 20))
    inertial_columns(constants, state, whole[::2])
    np.testing.assert_allclose(whole[::2], expected, rtol=0, atol=SAME_ARITHMETIC * 100)
    assert not whole[1::2].any()


@pytest.mark.parametrize("samples", [1, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK + 5])
def test_inverse_dynamics_is_newton_eulers_across_chunks(samples: int) -> None:
    robot = random_chain(seed=13, joints=3)
    model = InverseDynamicModel(robot=robot, friction=BARE)
    state = random_states(seed=4, samples=samples, joints=3)
    inertias = random_parameters(seed=5, joints=3)
    ours = model.inverse_dynamics(*state, np.concatenate([inertias, np.zeros(3)]))
    _assert_close(ours, torques(robot, "dh", inertias, *state))


@pytest.mark.parametrize("frames", ["dh", "mdh", "urdf"])
@pytest.mark.parametrize("seed", range(4))
def test_inverse_dynamics_is_newton_eulers_in_every_frame(seed: int, frames: str) -> None:
    joints = 4 + seed
    robot = random_chain(seed, joints)
    model = InverseDynamicModel(robot=robot, frames=frames, friction=BARE)
    state = random_states(seed, samples=9, joints=joints)
    inertias = random_parameters(seed, joints)
    ours = model.inverse_dynamics(*state, np.concatenate([inertias, np.zeros(joints)]))
    _assert_close(ours, torques(robot, frames, inertias, *state))


@pytest.mark.parametrize("name", [robot.name for robot in robots()])
def test_the_frames_of_a_built_in_robot_say_the_same(name: str) -> None:
    robot = load_robot(name)
    n, frames = robot.joints, robot.default_frames
    state = random_states(seed=6, samples=12, joints=n)
    links = random_parameters(seed=7, joints=n).reshape(n, 10)
    friction = np.arange(1.0, 1.0 + 3 * n)
    coulomb, viscous, motor = friction.reshape(3, n)
    truth = torques(robot, frames, links.ravel(), *state)
    truth += np.tanh(state[1] / 0.001) * coulomb + state[1] * viscous + state[2] * motor
    here = robot.parameter_frames[frames]
    for frames, there in robot.parameter_frames.items():
        own = [
            np.linalg.solve(frame_change(b), frame_change(a) @ link)
            for a, b, link in zip(here, there, links, strict=True)
        ]
        model = InverseDynamicModel(robot=robot, frames=frames)
        parameters = np.concatenate([*own, friction])
        _assert_close(model.inverse_dynamics(*state, parameters), truth)


@pytest.mark.parametrize(
    ("q", "dq", "ddq"),
    [
        ((9, 3), (9, 3), (9, 3)),
        ((9, 4), (8, 4), (9, 4)),
        ((9, 4), (9, 4), (9, 3)),
        ((9,), (9, 4), (9, 4)),
    ],
)
def test_shapes_are_checked_before_the_compiled_kernel_trusts_them(
    q: tuple[int, ...], dq: tuple[int, ...], ddq: tuple[int, ...]
) -> None:
    model = InverseDynamicModel(robot=random_chain(seed=1, joints=4))
    with pytest.raises(InputError, match="wrong shape"):
        model.stack(np.zeros(q), np.zeros(dq), np.zeros(ddq))


def test_memory_of_another_shape_is_refused() -> None:
    model = InverseDynamicModel(robot=random_chain(seed=1, joints=4))
    state = random_states(seed=1, samples=20, joints=4)
    with pytest.raises(InputError, match="out does not fit"):
        model.stack(*state, out=np.zeros((52, 4, 19)))
