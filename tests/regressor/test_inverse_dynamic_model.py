from dataclasses import replace

import numpy as np
import pytest
from pinocchio_chains import random_chain, random_parameters, random_states

from dynid.core import InputError
from dynid.regressor import FrictionTerms, InverseDynamicModel
from dynid.robot import PARAMETERS, Counterbalance, RobotModel

SLOPE = 1e-6
"""Of the largest torque: what central differences of an energy give."""
SAME = 1e-12


def _balanced() -> RobotModel:
    spring = Counterbalance(
        joint=1,
        outer=0.8,
        inner=0.2,
        rest_length=0.6,
        offset=1.6,
        piston_area=1.7e-3,
        gas_work=1.5e4,
        gas_volume=1e-3,
    )
    robot = random_chain(seed=31, joints=3, kinds=("revolute",))
    return replace(robot, counterbalances=(spring,))


def _heights(robot: RobotModel, q: np.ndarray) -> np.ndarray:
    """(N, 3, 4, 4) the dh frames in the base, by Rodrigues' formula."""
    poses = np.empty((len(q), 3, 4, 4))
    for k, angles in enumerate(q):
        pose = np.eye(4)
        for i, angle in enumerate(angles):
            x, y, z = robot.axes[i]
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            turn = np.eye(4)
            turn[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
            pose = pose @ robot.placements[i] @ turn
            poses[k, i] = pose @ robot.parameter_frames["dh"][i]
    return poses


def _energy(robot: RobotModel, parameters: np.ndarray, q: np.ndarray) -> np.ndarray:
    """(N) gravity's and the gas's potential energy."""
    poses = _heights(robot, q)
    first = parameters.reshape(3, 10)[:, [1, 2, 3, 0]]
    moments = np.einsum("kiab,ib->ka", poses[:, :, :3, :], first)
    spring = robot.counterbalances[0]
    length = np.sqrt(
        spring.outer**2
        + spring.inner**2
        - 2 * spring.outer * spring.inner * np.cos(q[:, spring.joint] + spring.offset)
    )
    volume = spring.gas_volume - (length - spring.rest_length) * spring.piston_area
    return -moments @ robot.gravity - spring.gas_work * np.log(volume)


def test_a_motor_holds_gravity_less_what_the_counterbalance_carries() -> None:
    robot = _balanced()
    model = InverseDynamicModel(robot=robot)
    parameters = random_parameters(seed=1, joints=3)
    q = random_states(seed=2, samples=12, joints=3)[0]
    rest = np.zeros_like(q)
    needed = model.inverse_dynamics(q, rest, rest, np.concatenate([parameters, np.ones(9)]))
    measured = needed - model.known_torque(q)
    step = 1e-5
    for j in range(3):
        aside = step * np.eye(3)[j]
        rise = _energy(robot, parameters, q + aside) - _energy(robot, parameters, q - aside)
        np.testing.assert_allclose(
            measured[:, j], rise / (2 * step), rtol=0, atol=SLOPE * np.abs(measured).max()
        )


def test_counterbalances_add_up_on_their_own_joint() -> None:
    one = _balanced()
    two = replace(one, counterbalances=one.counterbalances * 2)
    q = random_states(seed=3, samples=8, joints=3)[0]
    single, double = (InverseDynamicModel(robot=r).known_torque(q) for r in (one, two))
    assert np.abs(single[:, 1]).min() > 0
    assert not single[:, [0, 2]].any()
    np.testing.assert_array_equal(double, 2 * single)
    assert not InverseDynamicModel(robot=random_chain(1, 3)).known_torque(q).any()


def test_all_forms_of_the_regressor_hold_the_same_numbers() -> None:
    model = InverseDynamicModel(robot=random_chain(seed=32, joints=4))
    state = random_states(seed=4, samples=11, joints=4)
    stack, regressor = model.stack(*state), model.regressor(*state)
    matrix = model.observation_matrix(*state)
    assert stack.shape == (52, 4, 11)
    assert regressor.shape == (11, 4, 52)
    assert matrix.shape == (44, 52)
    np.testing.assert_array_equal(regressor, stack.transpose(2, 1, 0))
    # Joint-major rows: all samples of joint 1 first.
    np.testing.assert_array_equal(matrix[:11], regressor[:, 0])
    np.testing.assert_array_equal(matrix[33:], regressor[:, 3])
    lists = [x.tolist() for x in state]
    np.testing.assert_array_equal(model.regressor(*lists), regressor)
    np.testing.assert_array_equal(model.observation_matrix(*lists), matrix)
    parameters = np.random.default_rng(5).normal(size=52)
    torque = model.inverse_dynamics(*state, parameters)
    np.testing.assert_allclose(torque, regressor @ parameters, rtol=SAME, atol=SAME)
    assert not torque.flags.writeable
    q, dq, ddq = state
    push = torque - model.inverse_dynamics(q, dq, np.zeros_like(q), parameters)
    mass = model.mass_matrix(q, parameters)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", mass, ddq), push, rtol=SAME, atol=SAME)


def test_columns_are_named_link_by_link_then_term_by_term() -> None:
    model = InverseDynamicModel(robot=random_chain(seed=33, joints=2))
    links = tuple(f"{name}{link}" for link in (1, 2) for name in PARAMETERS)
    assert model.names == (*links, "Fc1", "Fc2", "Fv1", "Fv2", "Im1", "Im2")
    assert [column.unit for column in model.columns[:10]] == ["kg"] + ["kg.m"] * 3 + ["kg.m^2"] * 6


def test_frames_are_the_robots_own_or_refused() -> None:
    robot = random_chain(seed=34, joints=2)
    assert InverseDynamicModel(robot=robot).frames == "dh"
    assert InverseDynamicModel(robot=robot, frames="urdf").frames == "urdf"
    with pytest.raises(InputError, match="frames: unknown word; got khalil; allowed: dh, mdh"):
        InverseDynamicModel(robot=robot, frames="khalil")


def test_terms_for_joints_that_do_not_exist_are_refused() -> None:
    with pytest.raises(InputError, match="does not have"):
        InverseDynamicModel(
            robot=random_chain(seed=35, joints=2), friction=FrictionTerms(terms=(("fo", (2,)),))
        )
