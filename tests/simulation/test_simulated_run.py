from dataclasses import fields, replace

import numpy as np
import pytest
from robots_for_simulation import build_chain, chosen_sensors, ideal_arm

from dynid.core import InputError, JobError, MissingExtraError
from dynid.robot import Counterbalance, Drives, RobotModel, robot_from_chain
from dynid.simulation import (
    JointSensors,
    PlantState,
    Servo,
    SimulatedArm,
    SimulatedPlant,
    SimulatedRun,
    link_body,
    mujoco_model,
    simulate,
    simulated_arm,
    ur5_truth,
)
from dynid.trajectory import BSplineFamily, FourierSeries, Quintic, random_excitation


def test_shapes_and_clock(run: SimulatedRun) -> None:
    assert run.t.shape == (1250,)
    np.testing.assert_allclose(np.diff(run.t), 0.008, rtol=0, atol=1e-12)
    names = {item.name for item in fields(PlantState)} - {"t", "target"}
    arrays = [*run.signals.values(), *(getattr(run.truth, name) for name in names)]
    for array in arrays:
        assert array.shape == (1250, 6)
        assert not array.flags.writeable
    assert not run.truth.saturated.any()


def test_a_seed_gives_the_same_run_again(
    arm: SimulatedArm, run: SimulatedRun, motion: FourierSeries
) -> None:
    same, other = simulate(arm, motion, seed=1), simulate(arm, motion, seed=2)
    for name, values in run.signals.items():
        np.testing.assert_array_equal(values, same.signals[name], err_msg=name)
    np.testing.assert_array_equal(run.truth.torque, other.truth.torque)
    assert not np.array_equal(run.signals["current"], other.signals["current"])


def test_measurements_have_the_noise_and_the_steps_they_claim(
    arm: SimulatedArm, run: SimulatedRun
) -> None:
    sensors = arm.truth.sensors
    error = run.signals["current"] - run.truth.torque / arm.truth.gain
    np.testing.assert_allclose(error.std(axis=0), sensors.current_noise, rtol=0.1)
    np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=3e-3)
    steps = run.signals["current"] / sensors.current_step
    np.testing.assert_allclose(steps, np.round(steps), rtol=0, atol=1e-6)
    assert np.abs(run.signals["q"] - run.truth.q).max() <= 0.5 * 5e-6 + 1e-12
    noise = (run.signals["qd"] - run.truth.dq).std(axis=0)
    np.testing.assert_allclose(noise, sensors.velocity_noise, rtol=0.1)


def test_the_arm_follows_the_command_a_lookahead_later(
    arm: SimulatedArm, run: SimulatedRun, motion: FourierSeries
) -> None:
    assert np.abs(run.truth.q - run.signals["target_q"]).max() < 2e-3
    late = motion.evaluate(run.t - arm.servo.lookahead).q
    assert np.abs(run.signals["target_q"] - late)[20:].max() < 3e-3
    assert np.abs(run.signals["target_q"] - motion.evaluate(run.t).q).max() > 5e-2


def test_targets_are_derivatives_of_each_other(run: SimulatedRun) -> None:
    step = 0.008
    dq = (run.signals["target_q"][2:] - run.signals["target_q"][:-2]) / (2 * step)
    ddq = (run.signals["target_qd"][2:] - run.signals["target_qd"][:-2]) / (2 * step)
    np.testing.assert_allclose(run.signals["target_qd"][1:-1], dq, rtol=0, atol=5e-3)
    np.testing.assert_allclose(run.signals["target_qdd"][1:-1], ddq, rtol=0, atol=0.3)


def test_periods_repeat_after_the_first(arm: SimulatedArm, motion: FourierSeries) -> None:
    cool = replace(
        arm,
        truth=replace(arm.truth, thermal=replace(arm.truth.thermal, capacity=np.full(6, np.inf))),
    )
    run = simulate(cool, motion, periods=3)
    second, third = run.truth.torque[1250:2500], run.truth.torque[2500:]
    assert np.abs(second - third).max() < 1e-2
    assert len(run.t) == 3750


def test_a_motion_that_is_no_series_repeats_too(arm: SimulatedArm) -> None:
    """The arm stood still from the second period on."""
    pose = np.array([0.0, -1.4, 1.2, -1.3, -1.2, 0.3])
    ways = 0.2 * np.random.default_rng(0).normal(size=(6, 4))
    loop = BSplineFamily(duration=2.0, order=4).trajectory(pose, ways)
    _, second, third = simulate(arm, loop, periods=3).signals["target_q"].reshape(3, 250, 6)
    np.testing.assert_allclose(second, third, rtol=0, atol=1e-9)
    assert np.ptp(second, axis=0).min() > 0.05


def test_longer_lookahead_and_softer_gain(ur5: RobotModel, motion: FourierSeries) -> None:
    soft = simulate(simulated_arm(ur5, servo=Servo(lookahead=0.1, gain=100.0)), motion)
    firm = simulate(simulated_arm(ur5, servo=Servo(lookahead=0.1, gain=2000.0)), motion)
    delay = np.abs(firm.signals["target_q"] - motion.evaluate(firm.t - 0.1).q)[50:]
    assert delay.max() < 3e-2
    errors = [np.abs(run.truth.q - run.signals["target_q"]).max() for run in (soft, firm)]
    assert errors[0] > 5 * errors[1]


def test_runs_at_500_hz_and_other_trajectories(arm: SimulatedArm) -> None:
    move = Quintic(start=np.zeros(6), goal=np.full(6, 0.5), travel_time=1.0)
    run = simulate(arm, move, rate_hz=500)
    assert len(run.t) == 500
    assert np.abs(run.truth.q[0]).max() < 1e-3


def test_torque_limits_saturate_and_say_so(ur5: RobotModel, motion: FourierSeries) -> None:
    limits = replace(ur5.limits, torque=np.array([150.0, 75.0, 150.0, 28.0, 28.0, 28.0]))
    run = simulate(simulated_arm(replace(ur5, limits=limits)), motion)
    assert np.abs(run.truth.torque).max(axis=0)[1] <= 75.0
    np.testing.assert_array_equal(
        run.truth.saturated.any(axis=0), [False, True, False, False, False, False]
    )


def test_any_robot_with_inertias_can_be_simulated() -> None:
    robot = build_chain(2, joints=4)
    arm = simulated_arm(robot)
    run = simulate(arm, random_excitation(robot.limits, seed=0, acceleration=10.0))
    np.testing.assert_array_equal(arm.truth.gain, 1.0)
    assert np.abs(run.truth.q - run.signals["target_q"]).max() < 0.05


def test_unknown_tensors_become_balls(ur5: RobotModel) -> None:
    rows = simulated_arm(ur5).truth.inertials.copy()
    rows[:, 4:] = np.nan
    arm = simulated_arm(replace(ur5, name="ur6", inertias=rows))
    found = arm.truth.inertials
    np.testing.assert_array_equal(found[:, :4], rows[:, :4])
    mass, _, tensor = link_body(found[1])
    radius = np.sqrt(tensor[0, 0] / (0.4 * mass))
    np.testing.assert_allclose(tensor, tensor[0, 0] * np.eye(3), rtol=0, atol=1e-12)
    np.testing.assert_allclose(mass / (4 / 3 * np.pi * radius**3), 1000.0)


def test_a_urdf_called_ur5_keeps_its_own_inertias() -> None:
    chain = build_chain(joints=6)
    named = robot_from_chain(
        placements=chain.placements,
        axes=chain.axes,
        joint_types=chain.joint_types,
        name="ur5",
    )
    for frames in ("urdf", "dh"):
        robot = replace(named, inertias=chain.inertias, default_frames=frames)
        np.testing.assert_array_equal(simulated_arm(robot).truth.inertials, robot.inertias)


def test_links_as_built_are_near_the_published_ones(ur5: RobotModel) -> None:
    published = simulated_arm(ur5).truth.inertials
    arms = [simulated_arm(ur5, serial=k).truth.inertials for k in (1, 1, 2)]
    np.testing.assert_array_equal(arms[0], arms[1])
    for found in (arms[0], arms[2]):
        for row, known in zip(found, published, strict=True):
            (mass, com, tensor), (m, c, t) = link_body(row), link_body(known)
            assert 0 < abs(mass / m - 1) <= 0.1
            assert 0 < np.abs(com - c).max() <= 0.01
            assert np.linalg.eigvalsh(np.trace(tensor) / 2 * np.eye(3) - tensor).min() >= 0
            assert 0 < abs(np.trace(tensor) / np.trace(t) - 1) <= 0.3


def test_ground_truth_tells_its_parameters(arm: SimulatedArm, ur5: RobotModel) -> None:
    truth = arm.truth
    table = truth.standard_parameters
    assert table.shape == (6, 13)
    np.testing.assert_array_equal(table[:, 10], truth.friction.coulomb)
    np.testing.assert_array_equal(table[:, 11], truth.friction.viscous)
    np.testing.assert_array_equal(table[:, 12], truth.motor_inertia)
    warm = truth.standard_parameters_at(truth.thermal.warm_degC)
    assert (warm[:, 11] < 0.8 * table[:, 11]).all()
    assert "not UR's" in truth.label
    # In the DH frames the first moments are mass times UR's published centres of mass.
    dh = arm.standard_parameters_in("dh")
    np.testing.assert_allclose(dh[1, :4], 8.393 * np.array([1, 0.2125, 0, 0.11336]), atol=1e-12)
    np.testing.assert_allclose(arm.standard_parameters_in("urdf"), table, atol=1e-15)
    for row in dh:
        about = np.array(
            [[row[4], row[9], row[8]], [row[9], row[5], row[7]], [row[8], row[7], row[6]]]
        )
        com = row[1:4] / row[0]
        central = about - row[0] * (com @ com * np.eye(3) - np.outer(com, com))
        moments = np.linalg.eigvalsh(central)
        assert moments[0] > 0
        assert moments[2] <= moments[0] + moments[1]
    with pytest.raises(InputError, match="frames: unknown word"):
        arm.standard_parameters_in("mdh")


def test_counterbalances_carry_their_share(ur5: RobotModel, motion: FourierSeries) -> None:
    spring = Counterbalance(
        joint=1,
        outer=0.4,
        inner=0.1,
        rest_length=0.3,
        offset=0.2,
        piston_area=1e-3,
        gas_work=300.0,
        gas_volume=1e-3,
    )
    parameters = simulated_arm(ur5).truth.standard_parameters
    alone = simulate(ideal_arm(ur5, parameters), motion)
    helped = simulate(ideal_arm(replace(ur5, counterbalances=(spring,)), parameters), motion)
    share = spring.torque(helped.truth.q[:, 1])
    assert np.abs(share).max() > 5.0
    difference = alone.truth.torque - helped.truth.torque
    moving = np.abs(alone.truth.dq[:, 1]) > 0.2
    np.testing.assert_allclose(difference[moving, 1], share[moving], rtol=0, atol=1.5)
    # Of two on one joint the last one alone acted.
    both = simulate(ideal_arm(replace(ur5, counterbalances=(spring, spring)), parameters), motion)
    difference = helped.truth.torque - both.truth.torque
    np.testing.assert_allclose(difference[moving, 1], share[moving], rtol=0, atol=1.5)


def test_sensors() -> None:
    generator = np.random.default_rng(0)
    true = generator.normal(size=(100, 2))
    np.testing.assert_array_equal(chosen_sensors(2).read("current", true, generator), true)
    noisy = chosen_sensors(2, position=0.1).read("position", true, generator)
    np.testing.assert_allclose((noisy - true).std(), 0.1, rtol=0.2)
    with pytest.raises(InputError):
        chosen_sensors(2, current=-1.0)
    values = {item.name: np.zeros(2) for item in fields(JointSensors)}
    with pytest.raises(InputError):
        JointSensors(**(values | {"velocity_step": np.zeros(3)}))


def test_refuses_what_cannot_be(arm: SimulatedArm, ur5: RobotModel, motion: FourierSeries) -> None:
    with pytest.raises(InputError, match="repetitions"):
        simulate(arm, motion, periods=0)
    with pytest.raises(InputError, match="position jumps"):
        simulate(arm, Quintic(start=np.zeros(6), goal=np.ones(6), travel_time=1.0), periods=2)
    with pytest.raises(InputError, match="control rate"):
        simulate(arm, motion, rate_hz=5000)
    with pytest.raises(InputError, match="thermal state"):
        simulate(arm, motion, thermal="tepid")
    with pytest.raises(InputError, match="joints of the trajectory"):
        simulate(arm, Quintic(start=np.zeros(2), goal=np.ones(2), travel_time=1.0))
    with pytest.raises(InputError, match="lookahead"):
        Servo(lookahead=0.001)
    with pytest.raises(InputError, match="no known mass"):
        simulated_arm(replace(ur5, name="ur6"))
    with pytest.raises(InputError, match="six joints"):
        ur5_truth(build_chain())
    with pytest.raises(InputError, match="masses must be positive"):
        ideal_arm(ur5, np.zeros((6, 13)))
    table = arm.truth.standard_parameters.copy()
    table[2, 4] = -5.0
    with pytest.raises(InputError, match="MuJoCo refuses"):
        mujoco_model(ur5, table[:, :10], table[:, 12], 1e-3)
    coupling = np.eye(6)
    coupling[4, 5] = 0.1
    coupled = Drives(gain=ur5.drives.gain, gear_ratio=ur5.drives.gear_ratio, coupling=coupling)
    with pytest.raises(InputError, match="coupled"):
        simulated_arm(replace(ur5, drives=coupled))
    with pytest.raises(InputError, match="truth and controller"):
        SimulatedArm(robot=build_chain(), truth=arm.truth, controller=arm.controller)
    with pytest.raises(InputError, match="set point"):
        SimulatedPlant(arm).tick([float("nan")] * 6)


def test_a_runaway_is_an_error_not_data(arm: SimulatedArm) -> None:
    free = replace(arm.robot, limits=replace(arm.robot.limits, torque=np.full(6, np.nan)))
    plant = SimulatedPlant(replace(arm, robot=free))
    with pytest.raises(JobError, match="ran away"):
        _ = [plant.tick(np.full(6, sign * 1e4)) for sign in (1, -1) * 5]


def test_without_mujoco_one_sentence_says_how(
    arm: SimulatedArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'dynid\[sim\]'"):
        SimulatedPlant(arm)
