"""The plant against pinocchio, calculus and thermodynamics."""

from itertools import pairwise

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import scipy.integrate
from robots_for_simulation import build_chain, build_ur5, ideal_arm, pinocchio_model

from dynid.core import Array
from dynid.robot import RobotModel
from dynid.simulation import (
    PlantState,
    SimulatedArm,
    SimulatedRun,
    mujoco_model,
    simulate,
    simulated_arm,
)
from dynid.simulation import plant as plant_module
from dynid.trajectory import FourierSeries

ROBOTS = [
    build_ur5(),
    build_ur5((9.80665, 0.0, 0.0)),
    build_ur5((0.0, 6.0, -7.0)),
    build_chain(0),
    build_chain(1, joints=8),
]


@pytest.mark.parametrize("robot", ROBOTS)
def test_inverse_dynamics_are_pinocchios(robot: RobotModel) -> None:
    parameters = simulated_arm(robot).truth.standard_parameters
    model = mujoco_model(robot, parameters[:, :10], parameters[:, 12], 1e-3)
    data = mujoco.MjData(model)
    oracle = pinocchio_model(robot, parameters)
    oracle_data = oracle.createData()
    generator = np.random.default_rng(0)
    for _ in range(50):
        q, dq, ddq = generator.normal(size=(3, robot.joints)) * [[2.0], [2.0], [10.0]]
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        expected = pin.rnea(oracle, oracle_data, q, dq, ddq)
        np.testing.assert_allclose(data.qfrc_inverse, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("robot", ROBOTS)
def test_mass_matrix_is_packed_as_the_kernel_reads_it(robot: RobotModel) -> None:
    parameters = simulated_arm(robot).truth.standard_parameters
    model = mujoco_model(robot, parameters[:, :10], parameters[:, 12], 1e-3)
    data = mujoco.MjData(model)
    data.qpos[:] = np.linspace(-1, 1, robot.joints)
    mujoco.mj_step1(model, data)
    oracle = pinocchio_model(robot, parameters)
    mass = pin.crba(oracle, oracle.createData(), np.linspace(-1, 1, robot.joints))
    rows, columns = np.tril_indices(robot.joints)
    np.testing.assert_allclose(data.M, mass[columns, rows], rtol=0, atol=1e-12)


def residual(arm: SimulatedArm, truth: PlantState) -> Array:
    oracle = pinocchio_model(arm.robot, arm.truth.standard_parameters)
    data = oracle.createData()
    moving = [
        pin.rnea(oracle, data, *now) for now in zip(truth.q, truth.dq, truth.ddq, strict=True)
    ]
    return np.array(moving) + truth.friction - truth.torque


def test_a_run_obeys_the_equations_of_motion(arm: SimulatedArm, run: SimulatedRun) -> None:
    error = residual(arm, run.truth)
    assert np.sqrt((error**2).mean()) < 1e-4
    assert np.abs(error).max() < 5e-3


def frictionless(ur5: RobotModel) -> SimulatedArm:
    parameters = simulated_arm(ur5).truth.standard_parameters.copy()
    parameters[:, 10:12] = 0.0
    return ideal_arm(ur5, parameters)


def test_velocities_and_accelerations_are_derivatives(
    ur5: RobotModel, motion: FourierSeries
) -> None:
    truth = simulate(frictionless(ur5), motion, rate_hz=1000).truth
    step = 1e-3
    dq = (truth.q[2:] - truth.q[:-2]) / (2 * step)
    ddq = (truth.q[2:] - 2 * truth.q[1:-1] + truth.q[:-2]) / step**2
    np.testing.assert_allclose(truth.dq[1:-1], dq, rtol=0, atol=2e-4)
    np.testing.assert_allclose(truth.ddq[1:-1], ddq, rtol=0, atol=2e-2)


def test_energy_is_kept(arm: SimulatedArm, motion: FourierSeries) -> None:
    truth = simulate(arm, motion, rate_hz=1000).truth
    oracle = pinocchio_model(arm.robot, arm.truth.standard_parameters)
    data = oracle.createData()
    stored = np.array(
        [
            pin.computeKineticEnergy(oracle, data, q, dq) + pin.computePotentialEnergy(oracle, data)
            for q, dq in zip(truth.q, truth.dq, strict=True)
        ]
    )
    # pinocchio leaves the rotors out of the kinetic energy.
    stored += (arm.truth.motor_inertia * truth.dq**2).sum(axis=1) / 2
    power = ((truth.torque - truth.friction) * truth.dq).sum(axis=1)
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2) * 1e-3])
    assert np.abs(work - (stored - stored[0])).max() < 2e-3 * np.ptp(stored)
    lost = scipy.integrate.trapezoid((truth.friction * truth.dq).sum(axis=1), dx=1e-3)
    assert lost > np.ptp(stored)


def test_smaller_steps_converge_with_second_order(
    ur5: RobotModel, motion: FourierSeries, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm, torques = frictionless(ur5), []
    for step in (1e-3, 5e-4, 2.5e-4):
        monkeypatch.setattr(plant_module, "PHYSICS_STEP", step)
        torques.append(simulate(arm, motion).truth.torque)
    first, second = (np.abs(torques[k] - torques[k + 1])[50:].max() for k in (0, 1))
    assert second < first / 3


def test_the_arm_holds_still_under_gravity(arm: SimulatedArm) -> None:
    plant = plant_module.SimulatedPlant(arm)
    pose = np.array([0.2, -1.0, 1.0, -0.5, 0.4, 0.1])
    plant.reset(pose)
    states = [plant.tick(pose) for _ in range(50)]
    oracle = pinocchio_model(arm.robot, arm.truth.standard_parameters)
    weight = pin.computeGeneralizedGravity(oracle, oracle.createData(), pose)
    assert max(np.abs(state.dq).max() for state in states) < 1e-4
    np.testing.assert_allclose(states[-1].torque - states[-1].friction, weight, rtol=0, atol=1e-2)
    assert (np.abs(states[-1].friction) <= 1.2 * arm.truth.friction.coulomb + 1.0).all()


def test_the_target_is_that_of_a_critically_damped_filter(arm: SimulatedArm) -> None:
    """q'' = r^2 (u - q) - 2 r q' with u on straight lines between set points, by SciPy."""
    plant = plant_module.SimulatedPlant(arm)
    tracker, cycle = plant.tracker, plant.cycle
    rate, steps = arm.servo.filter_rate(cycle), len(tracker.plan(np.zeros(6)))
    points = np.cumsum(np.random.default_rng(2).normal(size=(6, 6)) * 0.02, axis=0)
    tracker.reset(points[0])
    state = np.array([points[0], np.zeros(6)])
    for before, after in pairwise(points):

        def slope(t: float, x: Array, a: Array = before, b: Array = after) -> Array:
            q, dq = x.reshape(2, 6)
            return np.append(dq, rate**2 * (a + t / cycle * (b - a) - q) - 2 * rate * dq)

        times = np.linspace(0, cycle, steps + 1)
        known = scipy.integrate.solve_ivp(
            slope, (0, cycle), state.ravel(), t_eval=times, rtol=1e-11, atol=1e-13
        ).y.T.reshape(-1, 2, 6)
        found = tracker.plan(after)
        np.testing.assert_allclose(found[:, :2], known[:-1], rtol=0, atol=1e-8)
        state, now = known[-1], tracker.now
        np.testing.assert_allclose([now.q, now.dq], state, rtol=0, atol=1e-8)
        ddq = slope(cycle, state.ravel())[6:]
        np.testing.assert_allclose(now.ddq, ddq, rtol=0, atol=1e-5)
