from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_chains import (
    IN_PINOCCHIO,
    Floats,
    frame_change,
    pinocchio_model,
    random_chain,
    random_parameters,
    random_states,
)

from dynid.core import InputError
from dynid.regressor import TERMS, FrictionTerms, InverseDynamicModel, parse_terms, torque_adjoint
from dynid.regressor.adjoint import regressor_adjoint
from dynid.regressor.terms import PAPER_WIDTH
from dynid.robot import Drives, RobotModel

DIFFERENCES = 1e-8
"""Of the largest derivative: what sixth-order differences of a smooth sum give."""
PINOCCHIO = 1e-10
SAME = 1e-11
STEP = 1e-3
SMOOTH = parse_terms("fc,fv,im,fo,fs", width=0.2, stribeck_velocity=0.5)
WALL = (9.81, 0.0, 0.0)

Sum = Callable[..., Floats]


def _derivatives(total: Sum, state: tuple[Floats, ...]) -> list[Floats]:
    """Central differences of order six of a function that gives a number for every sample."""
    found = []
    for which, values in enumerate(state):
        slope = np.zeros_like(values)
        for joint in range(values.shape[1]):
            for steps, weight in ((1, 45), (2, -9), (3, 1)):
                for sign in (1, -1):
                    moved = [x.copy() for x in state]
                    moved[which][:, joint] += sign * steps * STEP
                    slope[:, joint] += sign * weight * total(*moved) / (60 * STEP)
        found.append(slope)
    return found


def _assert_gradient(ours: tuple[Floats, ...], truth: list[Floats], tolerance: float) -> None:
    assert any(expected.any() for expected in truth)
    for got, expected in zip(ours, truth, strict=True):
        assert got.shape == expected.shape
        np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def _coupled(robot: RobotModel) -> RobotModel:
    coupling = np.diag(np.linspace(80.0, 120.0, robot.joints))
    coupling[-1, -2], coupling[-2, 0] = 30.0, -20.0
    nan = np.full(robot.joints, np.nan)
    return replace(robot, drives=Drives(gain=nan, gear_ratio=nan, coupling=coupling))


def _weights(seed: int, *shape: int) -> Floats:
    return np.random.default_rng(seed).normal(size=shape)


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("joints", range(3, 8))
def test_both_adjoints_are_the_derivatives_of_their_sums(joints: int, coupled: bool) -> None:
    robot = random_chain(seed=joints, joints=joints, gravity=WALL if joints == 5 else None)
    model = InverseDynamicModel(robot=_coupled(robot) if coupled else robot, friction=SMOOTH)
    state = random_states(seed=joints, samples=18, joints=joints)
    parameters, multipliers = _weights(1, len(model.columns)), _weights(2, 18, joints)
    _assert_gradient(
        torque_adjoint(model, *state, parameters, multipliers),
        _derivatives(
            lambda *s: (multipliers * model.inverse_dynamics(*s, parameters)).sum(axis=1), state
        ),
        DIFFERENCES,
    )
    weights = _weights(3, len(model.columns), joints, 18)
    _assert_gradient(
        regressor_adjoint(model, *state, weights),
        _derivatives(lambda *s: (weights * model.stack(*s)).sum(axis=(0, 1)), state),
        DIFFERENCES,
    )


@pytest.mark.parametrize("frames", ["dh", "mdh", "urdf"])
@pytest.mark.parametrize("seed", range(5))
def test_torques_have_pinocchios_derivatives(seed: int, frames: str) -> None:
    joints = 3 + seed
    robot = random_chain(seed, joints)
    model = InverseDynamicModel(robot=robot, frames=frames, friction=parse_terms("fo"))
    links = random_parameters(seed, joints).reshape(joints, 10)
    theirs = pinocchio_model(robot)
    for k, link in enumerate(links):
        ten = np.empty(10)
        ten[IN_PINOCCHIO] = frame_change(robot.parameter_frames[frames][k]) @ link
        theirs.inertias[k + 1] = pin.Inertia.FromDynamicParameters(ten)
    state = random_states(seed, samples=20, joints=joints)
    multipliers = _weights(seed, 20, joints)
    data = theirs.createData()
    truth = [np.empty((20, joints)) for _ in range(3)]
    for k in range(20):
        by_q, by_dq, mass = pin.computeRNEADerivatives(theirs, data, *(x[k] for x in state))
        # pinocchio fills the upper triangle of the mass matrix only.
        whole = np.triu(mass) + np.triu(mass, 1).T
        for part, by in zip(truth, (by_q, by_dq, whole), strict=True):
            part[k] = multipliers[k] @ by
    parameters = np.concatenate([links.ravel(), np.zeros(joints)])
    _assert_gradient(torque_adjoint(model, *state, parameters, multipliers), truth, PINOCCHIO)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_weights_of_rank_one_are_weighted_torques(kind: str) -> None:
    robot = _coupled(random_chain(seed=21, joints=6, kinds=(kind,)))
    model = InverseDynamicModel(robot=robot)
    state = random_states(seed=5, samples=40, joints=6)
    parameters, multipliers = _weights(1, len(model.columns)), _weights(2, 40, 6)
    of_torques = torque_adjoint(model, *state, parameters, multipliers)
    weights = parameters[:, None, None] * multipliers.T
    _assert_gradient(regressor_adjoint(model, *state, weights), list(of_torques), SAME)


@pytest.mark.parametrize("samples", [1, 2, 15, 16, 17, 33])
def test_every_sample_has_its_own_derivative(samples: int) -> None:
    robot = random_chain(seed=22, joints=3, kinds=("revolute",))
    model = InverseDynamicModel(robot=robot)
    state = random_states(seed=6, samples=samples, joints=3)
    parameters, multipliers = _weights(1, 39), _weights(2, samples, 3)
    weights = _weights(3, 39, 3, samples)
    whole = torque_adjoint(model, *state, parameters, multipliers)
    columns = regressor_adjoint(model, *state, weights)
    for k in range(samples):
        part = slice(k, k + 1)
        here = tuple(x[part] for x in state)
        alone = torque_adjoint(model, *here, parameters, multipliers[part])
        _assert_gradient(tuple(x[part] for x in whole), list(alone), SAME)
        alone = regressor_adjoint(model, *here, weights[:, :, part])
        _assert_gradient(tuple(x[part] for x in columns), list(alone), SAME)


@pytest.mark.parametrize("width", [0.2, (0.1, 0.2, 0.4)])
@pytest.mark.parametrize("term", TERMS)
def test_every_term_has_its_derivative(term: str, width: float | tuple[float, ...]) -> None:
    friction = FrictionTerms(terms=((term, (0, 2)),), width=width)
    model = InverseDynamicModel(robot=random_chain(seed=23, joints=3), friction=friction)
    q, dq, ddq = random_states(seed=7, samples=16, joints=3)
    # Away from standstill, where some terms have a kink.
    dq = np.sign(dq) * (0.05 + np.abs(dq))
    weights = np.zeros((32, 3, 16))
    weights[30:] = _weights(1, 2, 3, 16)
    ours = regressor_adjoint(model, q, dq, ddq, weights)
    truth = _derivatives(lambda *s: (weights * model.stack(*s)).sum(axis=(0, 1)), (q, dq, ddq))
    for got, expected in zip(ours, truth, strict=True):
        scale = max(np.abs(expected).max(), 1.0)
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6 * scale)
    moving = {"im": 2, "fo": None}.get(term, 1)
    for which, got in enumerate(ours):
        assert got.any() == (which == moving)


def test_steps_without_a_width_have_no_slope() -> None:
    model = InverseDynamicModel(
        robot=_coupled(random_chain(seed=24, joints=3)),
        friction=parse_terms("fc,fca,fr,fs", width=0.0),
    )
    state = random_states(seed=8, samples=16, joints=3)
    state[1][::2] = 0.0
    weights = np.zeros((len(model.columns), 3, 16))
    weights[30:36] = 1.0
    for bar in regressor_adjoint(model, *state, weights):
        assert not bar.any()
    weights[30:] = 1.0
    assert all(np.isfinite(bar).all() for bar in regressor_adjoint(model, *state, weights))


def test_a_wider_step_changes_friction_alone() -> None:
    model = InverseDynamicModel(robot=_coupled(random_chain(seed=25, joints=4)))
    wide = model.with_coulomb_width(0.05)
    state = random_states(seed=9, samples=20, joints=4)
    ours, before = wide.stack(*state), model.stack(*state)
    step = [name.startswith("Fc") for name in model.names]
    assert wide.names == model.names
    assert (model.friction.width, wide.friction.width) == (PAPER_WIDTH, 0.05)
    np.testing.assert_array_equal(ours[~np.array(step)], before[~np.array(step)])
    np.testing.assert_allclose(
        ours[40:44].sum(axis=1), np.tanh(state[1].T / 0.05), rtol=0, atol=1e-12
    )


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("dq", {"dq": np.zeros((19, 4))}),
        ("parameters", {"parameters": np.zeros(51)}),
        ("multipliers", {"multipliers": np.zeros((20, 3))}),
    ],
)
def test_shapes_are_checked(name: str, change: dict[str, Floats]) -> None:
    model = InverseDynamicModel(robot=random_chain(seed=1, joints=4))
    good = {"q": (20, 4), "dq": (20, 4), "ddq": (20, 4), "parameters": (52,)}
    arrays = {key: np.zeros(shape) for key, shape in good.items()}
    arrays["multipliers"] = np.zeros((20, 4))
    with pytest.raises(InputError, match=f"{name} (does not fit|has the wrong shape)"):
        torque_adjoint(model, **(arrays | change))
    with pytest.raises(InputError, match="weights does not fit"):
        regressor_adjoint(model, *(np.zeros((20, 4)),) * 3, np.zeros((52, 4, 19)))


def test_columns_that_no_block_differentiates_are_refused() -> None:
    model = InverseDynamicModel(robot=random_chain(seed=1, joints=3))
    object.__setattr__(model, "columns", (*model.columns, model.columns[0]))
    state = random_states(seed=1, samples=20, joints=3)
    with pytest.raises(InputError, match="without a derivative"):
        torque_adjoint(model, *state, np.zeros(40), np.zeros((20, 3)))
