from collections.abc import Callable, Iterable

import numpy as np
import pytest
from robots_for_simulation import ideal_friction, one_joint

from dynid.core import InputError
from dynid.simulation import JointFriction, PlantState, SimulatedArm, SimulatedPlant


def friction(**change: object) -> JointFriction:
    values: dict[str, object] = {
        "coulomb": [5.0],
        "viscous": [4.0],
        "breakaway": [1.5],
        "stribeck_velocity": [0.1],
        "load_factor": [0.0],
        "stiffness": [1e4],
        "damping": [5.0],
        "viscous_decay": [0.03],
        "coulomb_drift": [0.002],
    }
    return JointFriction(**(values | change))  # type: ignore[arg-type]


def drive(
    arm: SimulatedArm, path: Callable[[float], float], seconds: float, thermal: float = 24.0
) -> list[PlantState]:
    plant = SimulatedPlant(arm, thermal=thermal)
    plant.reset([path(0.0)])
    times: Iterable[float] = np.arange(0.0, seconds, plant.cycle)
    return [plant.tick([path(t)]) for t in times]


@pytest.mark.parametrize("speed", [-1.0, -0.2, 0.05, 0.15, 0.6, 1.5])
@pytest.mark.parametrize("temperature", [24.0, 36.0])
def test_steady_sliding_follows_the_stribeck_curve(speed: float, temperature: float) -> None:
    arm = one_joint(friction())
    last = drive(arm, lambda t: speed * t, 1.0, temperature)[-1]
    rise = temperature - 24.0
    dry = 5.0 * (1 - 0.002 * rise) + 1.5 * np.exp(-((speed / 0.1) ** 2))
    expected = np.sign(speed) * dry + 4.0 * np.exp(-0.03 * rise) * speed
    np.testing.assert_allclose(last.dq, speed, rtol=2e-3)
    np.testing.assert_allclose(last.friction, expected, rtol=2e-3)
    np.testing.assert_allclose(last.torque, last.friction, rtol=1e-3)


def test_load_makes_dry_friction_larger() -> None:
    arm = one_joint(friction(load_factor=[0.1], breakaway=[0.0]), gravity=60.0)
    for state in drive(arm, lambda t: 0.5 * t, 2.0)[60:]:
        load = np.abs(state.torque - state.friction - 0.3 * state.ddq)
        np.testing.assert_allclose(state.friction, 5.0 + 0.1 * load + 4.0 * state.dq, rtol=5e-3)
        np.testing.assert_allclose(load, 60.0 * 0.5 * abs(np.cos(state.q)), atol=0.2)


def test_below_breakaway_the_joint_is_a_spring() -> None:
    reach = 2e-4  # 2 N.m of the 6.5 N.m that it takes to slide
    states = drive(one_joint(friction()), lambda t: reach * np.sin(2 * np.pi * t), 2.0)
    q = np.array([state.q[0] for state in states])
    torque = np.array([state.friction[0] for state in states])
    # LuGre creeps a little even below breakaway, so the spring is only nearly one.
    slope, offset = np.polyfit(q, torque, 1)
    assert 0.5e4 < slope < 1.05e4
    assert np.abs(torque - slope * q - offset).max() < 0.15 * np.abs(torque).max()
    assert np.abs(torque).max() < 5.0


def test_standing_still_needs_breakaway_to_move() -> None:
    push = 6.0  # N.m of gravity: more than Coulomb's 5, less than the 6.5 to break away
    states = drive(one_joint(friction(), gravity=push / 0.5), lambda _: 0.0, 1.0)
    assert abs(states[-1].dq[0]) < 1e-5


@pytest.mark.parametrize("width", [1e-3, 5e-2])
def test_the_ideal_law_is_exact_but_for_the_crossings(width: float) -> None:
    arm = one_joint(ideal_friction(np.array([5.0]), np.array([4.0]), width), gravity=9.8)
    states = drive(arm, lambda t: 0.8 * np.sin(3 * t), 6.0, thermal=60.0)[20:]
    dq = np.array([state.dq[0] for state in states])
    found = np.array([state.friction[0] for state in states])
    error = found - (5.0 * np.tanh(dq / width) + 4.0 * dq)
    assert np.abs(error[np.abs(dq) > 0.02 + 3 * width]).max() < 2e-2
    assert np.sqrt((error**2).mean()) < 2e-2


@pytest.mark.parametrize(
    "change",
    [
        # The ideal law took the breakaway torque and the load of the other one.
        {"width": 1e-2, "stribeck_velocity": [10.0], "load_factor": [0.1]},
        # A joint without any was a division by zero.
        {"coulomb": [0.0], "breakaway": [0.0]},
    ],
)
def test_friction_that_is_not_there_does_not_act(change: dict[str, object]) -> None:
    law = friction(**change)
    for state in drive(one_joint(law, gravity=9.8), lambda t: 0.5 * t, 2.0)[60:]:
        np.testing.assert_allclose(state.friction, law.coulomb + 4.0 * state.dq, rtol=1e-6)


def test_no_chatter_when_the_sign_changes() -> None:
    # With the paper's width of 1e-3 rad/s an explicit step would shake by Fc h / J = 9 mrad/s.
    arm = one_joint(ideal_friction(np.array([5.0]), np.array([0.0]), 1e-3))
    dq = np.array([s.dq[0] for s in drive(arm, lambda t: 0.3 * np.sin(2 * t), 6.0)])[20:]
    turns = np.sum(np.diff(np.sign(dq)) != 0)
    assert turns <= 5


def test_temperature_only_lowers_friction() -> None:
    law = friction()
    np.testing.assert_allclose(law.viscous_at(np.array([34.0])), 4.0 * np.exp(-0.3))
    np.testing.assert_allclose(law.coulomb_at(np.array([34.0])), 5.0 * 0.98)
    assert law.coulomb_at(np.array([1e4]))[0] == 0.5


@pytest.mark.parametrize(
    "change",
    [
        {"coulomb": [-1.0]},
        {"stiffness": [0.0]},
        {"stribeck_velocity": [0.0]},
        {"viscous": [1.0, 2.0]},
        {"width": 0.0},
        {"load_factor": [float("nan")]},
    ],
)
def test_refuses_friction_that_cannot_be(change: dict[str, object]) -> None:
    with pytest.raises(InputError):
        friction(**change)
