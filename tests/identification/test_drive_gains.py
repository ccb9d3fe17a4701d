"""Drive gains from the controller's targets, against the gains that the simulated arm has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynid.core import InputError, JobError
from dynid.identification import DriveGains, drive_gains
from dynid.recording import ExperimentRecord
from dynid.robot import RobotModel, load_robot
from dynid.simulation import simulated_arm
from dynid.trajectory import random_excitation
from dynid.workflow import identify_gains, simulate_recording

ASKED = 0.01
"""Relative error of a gain."""
NAMES = ("a", "b")


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return load_robot("ur5")


@pytest.fixture(scope="module")
def record(robot: RobotModel) -> ExperimentRecord:
    motion = random_excitation(robot.limits, seed=3, margin=0.5, acceleration=5.0, period_s=6.0)
    return simulate_recording(robot, motion, seed=3)


def without(record: ExperimentRecord, name: str) -> ExperimentRecord:
    signals = {key: value for key, value in record.signals.items() if key != name}
    return replace(record, signals=signals)


def test_gains_of_the_simulated_arm(robot: RobotModel, record: ExperimentRecord) -> None:
    arm = simulated_arm(robot)
    found = identify_gains(record, robot)
    assert np.abs(found.gain / arm.truth.gain - 1).max() < ASKED
    assert not found.warnings
    assert (found.r2 > 0.99).all()
    np.testing.assert_allclose(found.coulomb, arm.controller.coulomb, rtol=1e-6)
    np.testing.assert_allclose(found.viscous, arm.controller.viscous, rtol=1e-6)


def test_measured_velocities_tell_less_and_say_so(
    robot: RobotModel, record: ExperimentRecord
) -> None:
    found = identify_gains(without(record, "target_qd"), robot)
    known = np.isfinite(found.gain)
    assert known.sum() >= 3
    # The last joint carries next to no moment: its gain hides behind the velocities' noise.
    assert not known[5]
    assert len(found.warnings) == (~known).sum()
    error = np.abs(found.gain - simulated_arm(robot).truth.gain)[known]
    assert (error < 3 * found.std[known]).all()
    assert (found.std[known] < 0.05 * found.gain[known]).all()


def test_rounded_targets_lose_the_joint_that_carries_nothing(
    robot: RobotModel, record: ExperimentRecord
) -> None:
    """A log with four decimals: enough for five joints."""
    signals = {name: np.round(values, 4) for name, values in record.signals.items()}
    found = identify_gains(replace(record, signals=signals), robot)
    truth = simulated_arm(robot).truth.gain
    assert np.abs(found.gain[:5] / truth[:5] - 1).max() < ASKED
    assert np.isnan(found.gain[5])
    assert "wrist_3" in found.warnings[0].message


def made(seed: int, noise: float, rest: bool = False) -> tuple[DriveGains, np.ndarray]:
    """Two joints with correlated noise on the current; the second may carry no moment."""
    generator = np.random.default_rng(seed)
    t = np.arange(2000) / 125.0
    phase = generator.uniform(0, 2 * np.pi, size=(2, 3))
    velocity = np.stack([np.sin(t + phase[j, 0]) for j in range(2)], axis=1)
    moment = np.stack([20 * np.cos(0.7 * t + phase[j, 1]) for j in range(2)], axis=1)
    if rest:
        moment[:, 1] = 0.0
    white = generator.normal(size=(*t.shape, 2))
    kernel = np.ones(10) / np.sqrt(10)
    slow = np.stack([np.convolve(white[:, j], kernel, mode="same") for j in range(2)], axis=1)
    gain = np.array([13.0, 9.0])
    current = moment / gain + 0.5 * np.tanh(velocity / 0.01) + 0.7 * velocity + noise * slow
    return drive_gains(current, moment, velocity, rate_hz=125.0, names=NAMES), gain


def test_deviations_are_honest_under_correlated_noise() -> None:
    scores = []
    for seed in range(60):
        found, gain = made(seed, 0.2)
        scores.append((found.gain - gain) / found.std)
    spread = np.std(scores)
    assert 0.7 < spread < 1.35


def test_a_joint_without_a_moment_gets_no_gain() -> None:
    found, gain = made(0, 0.05, rest=True)
    assert np.isnan(found.gain[1])
    assert found.gain[0] == pytest.approx(gain[0], rel=0.02)
    assert [notice.code for notice in found.warnings] == ["low_excitation"]
    assert found.warnings[0].message.startswith("no drive gain for b")
    assert found.to_json(NAMES)["gains"][1]["gain"] is None


def test_a_moment_like_friction_gets_no_gain() -> None:
    t = np.arange(1000) / 125.0
    velocity = np.stack([np.sin(t), np.sin(2 * t)], axis=1)
    moment = np.stack([3.0 * velocity[:, 0], 5.0 * np.cos(t)], axis=1)
    found = drive_gains(moment / 10 + velocity, moment, velocity, rate_hz=125.0, names=NAMES)
    assert np.isnan(found.gain[0])
    assert found.gain[1] == pytest.approx(10.0, rel=1e-9)


def test_gains_buried_in_noise_are_refused() -> None:
    with pytest.raises(JobError, match="no drive gain"):
        made(0, 50.0)


def test_what_is_missing_is_named(robot: RobotModel, record: ExperimentRecord) -> None:
    with pytest.raises(InputError, match="no target_moment"):
        identify_gains(without(record, "target_moment"), robot)
    with pytest.raises(InputError, match="target_qd or qd"):
        identify_gains(without(without(record, "qd"), "target_qd"), robot)
    short = ExperimentRecord(
        t=record.t, signals={name: values[:, :5] for name, values in record.signals.items()}
    )
    with pytest.raises(InputError, match="5 joints but ur5 has 6"):
        identify_gains(short, robot)
