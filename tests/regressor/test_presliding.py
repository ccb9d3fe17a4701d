"""The state of presliding friction against its differential equation, and in the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import solve_ivp

from dynid.core import InputError
from dynid.regressor import (
    FrictionTerms,
    InverseDynamicModel,
    LoadFriction,
    friction_state,
    terms_from_json,
)
from dynid.robot import load_robot

INTEGRATED = 2e-3
"""Of the state against an integration that knows the motion between samples, too [-]."""
OVER = 1e-3
TURNED = {1e-4: 2e-3, 1e-3: 5e-4, 1e-2: 1e-4}
"""RMS difference of the state sampled at 125 Hz, by displacement [-]."""


def test_it_solves_dahl_s_equation() -> None:
    t = np.linspace(0.0, 4.0, 8001)
    q = 0.01 * np.sin(3 * t) + 0.002 * np.sin(17 * t)

    def speed(at: float) -> float:
        return 0.03 * np.cos(3 * at) + 0.034 * np.cos(17 * at)

    def slope(at: float, z: np.ndarray) -> np.ndarray:
        dq = speed(at)
        return (dq - abs(dq) * z) / OVER

    truth = solve_ivp(slope, (0.0, 4.0), [0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=1e-3).y[0]
    state = friction_state(q[None], np.array([OVER]))[0]
    assert np.abs(state - truth).max() < INTEGRATED
    assert state.max() > 0.99
    assert state.min() < -0.99


@settings(max_examples=50)
@given(arrays(np.float64, 40, elements=st.floats(0.0, 1.0)), st.integers(1, 5))
def test_speed_does_not_matter(steps: np.ndarray, pause: int) -> None:
    q, over = np.cumsum(steps), np.array([0.3])
    state = friction_state(q[None], over)[0]
    slow = friction_state(np.repeat(q, pause)[None], over)[0]
    np.testing.assert_allclose(slow[::pause], state, rtol=0, atol=1e-12)


@settings(max_examples=50)
@given(arrays(np.float64, 40, elements=st.floats(-1.0, 1.0)))
def test_no_motion_takes_it_beyond_one(q: np.ndarray) -> None:
    assert np.abs(friction_state(q[None], np.array([0.3]))).max() <= 1.0


@pytest.mark.parametrize("over", [1e-4, 1e-3, 1e-2])
def test_a_joint_turns_back_between_two_samples(over: float) -> None:
    """At 125 Hz as at 8 kHz: a turn that is seen at the next sample alone comes 4 ms late."""
    many, rate = 64, 125.0
    t = np.arange(round(10 * rate) * many) / (rate * many)
    q = 0.8 * np.sin(2 * np.pi * 0.3 * t) + 0.3 * np.sin(2 * np.pi * 0.7 * t + 1.0)
    fine = friction_state(q[None], np.array([over]), periodic=True)[0][::many]
    coarse = friction_state(q[None, ::many], np.array([over]), periodic=True)[0]
    assert np.sqrt(np.square(coarse - fine).mean()) < TURNED[over]


def test_far_from_reversals_it_is_the_sign_and_it_stays_at_rest() -> None:
    q = np.concatenate([np.linspace(0, 1, 500), np.full(100, 1.0), np.linspace(1, -1, 500)])
    state = friction_state(q[None], np.array([OVER]))[0]
    assert (state[20:600] > 1 - 1e-6).all()
    assert (state[620:] < -1 + 1e-6).all()


def test_a_period_begins_as_it_ends() -> None:
    q = 0.3 * np.cos(np.linspace(0.0, 2 * np.pi, 400, endpoint=False) + 1.0)
    over = np.array([0.05])
    once = friction_state(q[None], over, periodic=True)[0]
    many = friction_state(np.tile(q, 6)[None], over)[0]
    np.testing.assert_allclose(once, many[-400:], rtol=0, atol=1e-6)
    assert abs(friction_state(q[None], over)[0][0] - once[0]) > 0.1


def test_the_model_puts_it_in_place_of_the_step() -> None:
    robot = load_robot("ur5")
    load = LoadFriction(joints=(1,), parameters=(1.0,) * 60)
    given = FrictionTerms(terms=(("fc", None), ("fv", None), ("fs", (1,))), load=load, width=0.0)
    friction = replace(given, presliding=(0.0, OVER, 0.0, 0.0, 0.0, OVER))
    model = InverseDynamicModel(robot=robot, friction=friction)
    plain = InverseDynamicModel(robot=robot, friction=given)
    t = np.linspace(0, 1, 300)[:, None]
    q = 0.1 * np.sin(9 * t + np.arange(6))
    dq, ddq = 0.9 * np.cos(9 * t + np.arange(6)), -8.1 * np.sin(9 * t + np.arange(6))
    state = model.friction_state(q)
    assert state is not None
    assert plain.friction_state(q) is None
    names = model.names
    with_it, without = model.stack(q, dq, ddq, state=state), model.stack(q, dq, ddq)
    np.testing.assert_array_equal(without, plain.stack(q, dq, ddq))
    own = friction_state(q.T[[1, 5]], np.array([OVER, OVER]))
    np.testing.assert_array_equal(with_it[names.index("Fc2"), 1], own[0])
    np.testing.assert_array_equal(with_it[names.index("Fc6"), 5], own[1])
    rest = np.exp(-np.square(dq[:, 1] / given.stribeck_velocity))
    np.testing.assert_allclose(with_it[names.index("Fs2"), 1], rest * own[0], rtol=1e-12)
    size = np.abs(without[names.index("Fl2"), 1])
    carried = np.abs(with_it[names.index("Fl2"), 1])
    np.testing.assert_allclose(carried, size * np.abs(own[0]), rtol=1e-9, atol=1e-9)
    for name in ("Fc2", "Fc6", "Fs2", "Fl2"):
        with_it[names.index(name)] = without[names.index(name)]
    np.testing.assert_array_equal(with_it, without)
    p = np.random.default_rng(0).normal(size=len(names))
    torque = model.inverse_dynamics(q, dq, ddq, p, state)
    parts = np.tensordot(p, model.stack(q, dq, ddq, state=state), axes=1).T
    np.testing.assert_allclose(torque, parts, rtol=1e-12)


def test_it_is_written_and_read_with_the_terms() -> None:
    friction = FrictionTerms(presliding=(0.0, 1e-3))
    assert terms_from_json(friction.to_json()) == friction
    assert "presliding" not in FrictionTerms().to_json()


@pytest.mark.parametrize("presliding", [(-1e-3,) * 6, (float("nan"),) * 6, (1e-3,) * 5])
def test_bad_displacements_are_refused(presliding: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="displacement"):
        InverseDynamicModel(robot=load_robot("ur5"), friction=FrictionTerms(presliding=presliding))


def test_its_motion_is_checked_at_the_door() -> None:
    q = np.linspace(0.0, 1.0, 60).reshape(10, 6)
    for friction in (FrictionTerms(), FrictionTerms(presliding=(OVER,) * 6)):
        model = InverseDynamicModel(robot=load_robot("ur5"), friction=friction)
        found, listed = model.friction_state(q), model.friction_state(q.tolist())
        assert (found is None) == (friction == FrictionTerms())
        if found is not None:
            np.testing.assert_array_equal(listed, found)
        for wrong in (q[0], q[:, :3], "x"):
            with pytest.raises(InputError, match="q "):
                model.friction_state(wrong)
