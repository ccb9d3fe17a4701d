from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from pinocchio_chains import random_chain, random_states

from dynid.regressor import TERMS, FrictionTerms, InverseDynamicModel, parse_terms
from dynid.regressor import columns as layout
from dynid.regressor.terms import friction_state, smooth_sign
from dynid.robot import Drives, RobotModel, load_robot

FORMULA = 1e-14
BALANCE = 1e-11
WIDTH = 0.07
STRIBECK = 0.3

# Term: symbol, unit on a turning joint, unit on a sliding joint, entry for (speed, acceleration).
FORMULAS: dict[str, tuple[str, str, str, Callable[[float, float], float]]] = {
    "fc": ("Fc", "N.m", "N", lambda v, _: np.tanh(v / WIDTH)),
    "fv": ("Fv", "N.m.s/rad", "N.s/m", lambda v, _: v),
    "im": ("Im", "kg.m^2", "kg", lambda _, a: a),
    "fo": ("Fo", "N.m", "N", lambda _, __: 1.0),
    "fca": ("Fca", "N.m", "N", lambda v, _: abs(np.tanh(v / WIDTH))),
    "fva": ("Fva", "N.m.s/rad", "N.s/m", lambda v, _: abs(v)),
    "fs": ("Fs", "N.m", "N", lambda v, _: np.exp(-((v / STRIBECK) ** 2)) * np.tanh(v / WIDTH)),
    "fr": ("Fr", "N.m.(s/rad)^(1/3)", "N.(s/m)^(1/3)", lambda v, _: np.sign(v) * abs(v) ** (1 / 3)),
}


def _chain() -> RobotModel:
    robot = random_chain(seed=21, joints=3)
    return replace(robot, joint_types=("revolute", "prismatic", "revolute"))


def _added(
    friction: FrictionTerms, seed: int = 1
) -> tuple[InverseDynamicModel, np.ndarray, np.ndarray, np.ndarray]:
    """The model, its columns beside the inertial ones (N, n, k), speeds and accelerations."""
    model = InverseDynamicModel(robot=_chain(), friction=friction)
    q, dq, ddq = random_states(seed, samples=19, joints=3)
    dq = 0.2 * dq
    dq[0] = 0.0
    return model, model.regressor(q, dq, ddq)[:, :, 30:], dq, ddq


def test_every_term_has_a_formula_here() -> None:
    assert tuple(FORMULAS) == TERMS


@pytest.mark.parametrize("term", TERMS)
def test_a_term_acts_by_its_formula_on_its_own_joint(term: str) -> None:
    symbol, turning, sliding, formula = FORMULAS[term]
    friction = FrictionTerms(terms=((term, None),), width=WIDTH, stribeck_velocity=STRIBECK)
    model, columns, dq, ddq = _added(friction)
    expected = np.zeros_like(columns)
    for j in range(3):
        expected[:, j, j] = [formula(v, a) for v, a in zip(dq[:, j], ddq[:, j], strict=True)]
    np.testing.assert_allclose(columns, expected, rtol=FORMULA, atol=FORMULA)
    assert [column.name for column in model.columns[30:]] == [f"{symbol}{j}" for j in (1, 2, 3)]
    assert [column.unit for column in model.columns[30:]] == [turning, sliding, turning]
    assert [column.joint for column in model.columns[30:]] == [0, 1, 2]


def test_terms_come_in_one_order_and_only_where_they_are_asked_for() -> None:
    model, columns, dq, ddq = _added(parse_terms("im:2,fo:3+1,fv", width=WIDTH))
    assert model.names[30:] == ("Fv1", "Fv2", "Fv3", "Im2", "Fo1", "Fo3")
    np.testing.assert_array_equal(columns[:, [0, 1, 2], [0, 1, 2]], dq)
    np.testing.assert_array_equal(columns[:, 1, 3], ddq[:, 1])
    np.testing.assert_array_equal(columns[:, [0, 2], [4, 5]], 1.0)
    assert np.count_nonzero(columns[1:]) == 18 * 6


def test_each_joint_has_its_own_width_and_stribeck_velocity() -> None:
    widths, speeds = (0.5, 0.0, 0.01), (STRIBECK, 0.03, 1.0)
    _, columns, dq, _ = _added(parse_terms("fc,fs,fca", width=widths, stribeck_velocity=speeds))
    for j, width in enumerate(widths):
        step = np.tanh(dq[:, j] / width) if width else np.sign(dq[:, j])
        fade = np.exp(-((dq[:, j] / speeds[j]) ** 2))
        # Asymmetry stands before Stribeck in the order of terms.
        for block, entry in enumerate((step, np.abs(step), fade * step)):
            ours = columns[:, j, 3 * block + j]
            np.testing.assert_allclose(ours, entry, rtol=FORMULA, atol=FORMULA)


@pytest.mark.parametrize("width", [0, 0.0, 1, 1.0])
def test_a_width_may_be_a_whole_number(width: float) -> None:
    dq = np.array([[-2.0, 0.0, 0.5]])
    expected = np.tanh(dq) if width else np.sign(dq)
    np.testing.assert_allclose(smooth_sign(dq, width), expected, rtol=FORMULA, atol=0)


def test_a_vanishing_width_is_the_sign() -> None:
    dq = random_states(1, 30, 3)[1].T
    np.testing.assert_array_equal(smooth_sign(dq, 1e-9), smooth_sign(dq, 0.0))


def test_every_word_has_a_block_and_no_other_becomes_one() -> None:
    assert tuple(layout.JOINT_TERMS) == TERMS
    with pytest.raises(KeyError, match="xx"):
        layout.JointColumns(term="xx", shape=FrictionTerms()).columns(_chain())


COUPLING = np.array([[30.0, 0, 0], [0, -48.0, 0], [5.0, 12.0, 40.0]])


def _coupled(coupling: np.ndarray = COUPLING) -> RobotModel:
    nan = np.full(3, np.nan)
    robot = random_chain(seed=22, joints=3, kinds=("revolute",))
    return replace(robot, drives=Drives(gain=nan, gear_ratio=nan, coupling=coupling))


@pytest.mark.parametrize(
    "coupling",
    [
        COUPLING,
        COUPLING * np.array([[1], [1], [-1.0]]),
        np.random.default_rng(1).normal(size=(3, 3)),
    ],
)
def test_a_coupled_motor_acts_through_the_transmission(coupling: np.ndarray) -> None:
    model = InverseDynamicModel(robot=_coupled(coupling), friction=parse_terms("fo", width=0.0))
    q, dq, ddq = random_states(seed=2, samples=17, joints=3)
    columns = dict(zip(model.names, model.regressor(q, dq, ddq).transpose(2, 0, 1), strict=True))
    motor_dq, motor_ddq = dq @ coupling.T, ddq @ coupling.T
    shared = [m for m in range(3) if np.count_nonzero(coupling[m]) > 1]
    assert [name for name in columns if name.startswith("Imm")] == [f"Imm{m + 1}" for m in shared]
    for m in shared:
        # One unit of friction or inertia on the motor is this much on its own joint.
        ratio = coupling[m, m]
        for symbol, motor_torque, on_joint in (
            ("Fcm", np.sign(motor_dq[:, m]), abs(ratio)),
            ("Fvm", motor_dq[:, m], ratio**2),
            ("Imm", motor_ddq[:, m], ratio**2),
        ):
            torque = columns[f"{symbol}{m + 1}"] * on_joint
            power_at_motor = motor_torque * motor_dq[:, m]
            power_at_joints = (torque * dq).sum(axis=1)
            scale = np.abs(power_at_motor).max()
            np.testing.assert_allclose(
                power_at_joints, power_at_motor, rtol=0, atol=BALANCE * scale
            )
            np.testing.assert_allclose(
                torque, np.outer(motor_torque, coupling[m]), rtol=BALANCE, atol=BALANCE
            )


def test_coupled_columns_stand_last_with_units_and_their_motors_width() -> None:
    widths = (0.5, 0.3, 0.1)
    model = InverseDynamicModel(robot=_coupled(), friction=parse_terms("fc", width=widths))
    assert model.names[30:] == ("Fc1", "Fc2", "Fc3", "Fcm3", "Fvm3", "Imm3")
    assert [c.unit for c in model.columns[33:]] == ["N.m", "N.m.s/rad", "kg.m^2"]
    q, dq, ddq = random_states(seed=3, samples=5, joints=3)
    share = COUPLING[2] / COUPLING[2, 2]
    np.testing.assert_allclose(
        model.regressor(q, dq, ddq)[:, :, 33],
        np.outer(np.tanh(dq @ share / widths[2]), share),
        rtol=FORMULA,
        atol=FORMULA,
    )


def test_plain_gears_add_no_columns() -> None:
    model = InverseDynamicModel(robot=_coupled(np.diag([30.0, -48.0, 40.0])))
    assert len(model.columns) == 39
    assert len(InverseDynamicModel(robot=load_robot("ur5")).columns) == 78


def test_friction_of_a_coupled_motor_builds_up_over_its_own_motion() -> None:
    over = 0.05
    friction = replace(parse_terms("fv"), presliding=(0.0, 0.0, over))
    model = InverseDynamicModel(robot=_coupled(), friction=friction)
    t = np.linspace(0, 3, 400)[:, None]
    phase = np.arange(3)
    q, dq, ddq = np.sin(3 * t + phase), 3 * np.cos(3 * t + phase), -9 * np.sin(3 * t + phase)
    state = model.friction_state(q)
    assert state is not None
    share = COUPLING[2] / COUPLING[2, 2]
    own = friction_state((q @ share)[None], np.array([over]))[0]
    column = model.stack(q, dq, ddq, state=state)[model.names.index("Fcm3")]
    np.testing.assert_allclose(column, share[:, None] * own, rtol=FORMULA, atol=FORMULA)
