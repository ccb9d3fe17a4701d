import numpy as np
import pytest
import scipy.integrate
from hypothesis import given
from hypothesis import strategies as st
from robots_for_simulation import constant_temperature

from dynid.core import InputError
from dynid.simulation import JointThermal, SimulatedArm, SimulatedPlant, simulate, warm_up
from dynid.trajectory import FourierSeries


def store(**change: object) -> JointThermal:
    values: dict[str, object] = {
        "resistance": [0.5],
        "capacity": [2000.0],
        "winding": [0.3],
        "warm_degC": [34.0],
    }
    return JointThermal(**(values | change))  # type: ignore[arg-type]


@given(st.floats(0, 100), st.floats(-20, 80), st.floats(1e-3, 1e5))
def test_steps_are_exact_however_long(power: float, start: float, seconds: float) -> None:
    joint, temperature = store(), np.array([start])
    whole = joint.after(temperature, np.array([power * seconds]), seconds)
    half = joint.after(temperature, np.array([power * seconds / 2]), seconds / 2)
    again = joint.after(half, np.array([power * seconds / 2]), seconds / 2)
    np.testing.assert_allclose(whole, again, rtol=1e-9, atol=1e-9)
    settled = 24.0 + 0.5 * power
    assert min(start, settled) - 1e-9 <= whole[0] <= max(start, settled) + 1e-9


@pytest.mark.long
def test_half_an_hour_of_hard_motion_warms_the_ur5(
    arm: SimulatedArm, motion: FourierSeries
) -> None:
    temperature = warm_up(arm, motion, 1800.0)
    assert ((temperature > 29.0) & (temperature < 38.0)).all()
    assert abs(temperature.mean() - 34.0) < 2.0
    fall = 1.0 - arm.truth.friction.viscous_at(arm.truth.thermal.start("warm")) / (
        arm.truth.friction.viscous
    )
    assert ((fall > 0.20) & (fall < 0.35)).all()


@pytest.mark.long
def test_looking_more_often_changes_little(arm: SimulatedArm, motion: FourierSeries) -> None:
    few, many = (warm_up(arm, motion, 600.0, looks=looks) for looks in (2, 6))
    np.testing.assert_allclose(few, many, rtol=0, atol=0.3)


def test_a_run_warms_up_by_its_losses(arm: SimulatedArm, motion: FourierSeries) -> None:
    run = simulate(arm, motion, periods=1)
    rise = run.truth.temperature[-1] - run.truth.temperature[0]
    assert ((rise > 0.02) & (rise < 0.5)).all()
    losses = scipy.integrate.trapezoid(run.truth.friction * run.truth.dq, dx=0.008, axis=0)
    expected = losses / arm.truth.thermal.capacity
    assert ((rise > 0.95 * expected) & (rise < 1.3 * expected)).all()


def test_a_warm_arm_needs_less_torque(arm: SimulatedArm, motion: FourierSeries) -> None:
    cold, warm = (simulate(arm, motion, thermal=state) for state in ("cold", "warm"))
    cold_size, warm_size = (np.abs(run.truth.torque).mean(axis=0) for run in (cold, warm))
    assert (warm_size < cold_size).all()
    np.testing.assert_array_equal(cold.truth.temperature[0], 24.0)
    np.testing.assert_array_equal(warm.truth.temperature[0], arm.truth.thermal.warm_degC)
    np.testing.assert_array_equal(SimulatedPlant(arm, thermal=30.0).temperature, 30.0)
    np.testing.assert_array_equal(
        SimulatedPlant(arm, thermal=range(20, 26)).temperature, range(20, 26)
    )


def test_a_constant_temperature_stays() -> None:
    joint = constant_temperature(1, 30.0)
    assert joint.after(np.array([55.0]), np.array([1e6]), 100.0)[0] == 55.0
    assert joint.start("cold")[0] == joint.start("warm")[0] == 30.0


@pytest.mark.parametrize("state", ["hot", [20.0, 30.0], float("nan"), 1000.0, "34"])
def test_refuses_other_states(state: object) -> None:
    with pytest.raises(InputError):
        store().start(state)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "change",
    [
        {"resistance": [0.0]},
        {"capacity": [float("nan")]},
        {"winding": [-1.0]},
        {"warm_degC": [float("nan")]},
    ],
)
def test_refuses_numbers_that_cannot_be(change: dict[str, object]) -> None:
    with pytest.raises(InputError):
        store(**change)


def test_refuses_to_warm_up_backwards(arm: SimulatedArm, motion: FourierSeries) -> None:
    with pytest.raises(InputError):
        warm_up(arm, motion, -1.0)
