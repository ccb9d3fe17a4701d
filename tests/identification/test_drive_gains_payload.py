"""Drive gains from a weighed payload, on the simulated arm and on one that obeys the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynid.core import InputError, JobError
from dynid.recording import ExperimentRecord
from dynid.regressor import InverseDynamicModel
from dynid.robot import Drives, RobotModel, load_robot, move
from dynid.simulation import cylinder, link_parameters, simulate, simulated_arm, with_payload
from dynid.trajectory import random_excitation
from dynid.workflow import identify_gains_from_payload
from dynid.workflow.running import record_of
from dynid.workflow.shared_inertias import known_payload

EXACT = 3e-5
"""Relative error of gains from torques that obey the model, up to the filter of the motion."""
NEAR = 0.03
"""Relative error on the simulated arm, whose friction is richer than the model's."""
CANCELS = 0.005
"""Relative change of gains by a torque that both runs share."""
ROBOT = load_robot("ur5")
ARM = simulated_arm(ROBOT)
MASS, CENTRE = 5.0, np.array([0.05, -0.03, 0.08])
TENSOR = cylinder(MASS, 0.05, 0.1, 2)
GAIN = np.array([11.0, 14.0, 12.0, 9.0, 8.0, 10.0])


@pytest.fixture(scope="module")
def runs() -> tuple[ExperimentRecord, ExperimentRecord]:
    series = random_excitation(ROBOT.limits, seed=4, margin=0.9, acceleration=13.5)
    loaded = with_payload(ARM, MASS, CENTRE, TENSOR)
    return (
        record_of(simulate(ARM, series, seed=4)),
        record_of(simulate(loaded, series, seed=104)),
    )


def test_gains_of_the_simulated_arm(runs: tuple[ExperimentRecord, ExperimentRecord]) -> None:
    truth = ARM.truth.gain
    for known in ({}, {"centre": CENTRE, "inertia": TENSOR}):
        found = identify_gains_from_payload(*runs, ROBOT, mass=MASS, **known)
        assert np.abs(found.gain / truth - 1).max() < NEAR
        assert (np.abs(found.gain - truth) < 3 * found.std).all()
        assert not found.warnings
    np.testing.assert_allclose(found.payload, known_payload(MASS, CENTRE, TENSOR))


def ideal(motion: int, loaded: bool) -> ExperimentRecord:
    """Exact torques of known parameters, as currents."""
    series = random_excitation(ROBOT.limits, seed=motion, margin=0.8, acceleration=12.0)
    t = np.arange(1250) / 125.0
    state = series.evaluate(t)
    model = InverseDynamicModel(robot=ROBOT)
    standard = ARM.truth.standard_parameters
    frame = np.linalg.inv(ROBOT.parameter_frames[model.frames])
    links = np.array([move(row[:10], frame[i]) for i, row in enumerate(standard)])
    if loaded:
        body = link_parameters(MASS, CENTRE, TENSOR)
        links[-1] += move(body, frame[-1] @ ROBOT.flange)
    parameters = np.concatenate([links.ravel(), *standard[:, 10:].T])
    torque = model.inverse_dynamics(state.q, state.dq, state.ddq, parameters)
    return ExperimentRecord(t=t, signals={"q": state.q, "current": torque / GAIN})


def without_gains() -> RobotModel:
    return replace(ROBOT, drives=Drives(gain=np.full(6, np.nan), gear_ratio=np.full(6, np.nan)))


@pytest.mark.parametrize("robot", [ROBOT, without_gains()])
def test_torques_that_obey_the_model_give_the_gains_back(robot: RobotModel) -> None:
    found = identify_gains_from_payload(
        ideal(1, False),
        ideal(1, True),
        robot,
        mass=MASS,
        friction=InverseDynamicModel(robot=ROBOT).friction,
        cutoff_hz=40.0,
    )
    np.testing.assert_allclose(found.gain, GAIN, rtol=EXACT)
    np.testing.assert_allclose(found.payload, link_parameters(MASS, CENTRE, TENSOR), atol=EXACT)


def test_what_the_model_of_the_arm_gets_wrong_alike_in_both_runs_cancels(
    runs: tuple[ExperimentRecord, ExperimentRecord],
) -> None:
    """A torque of the pose, as of a cable."""

    def biased(record: ExperimentRecord) -> ExperimentRecord:
        q = np.asarray(runs[0].signals["q"])
        torque = 3.0 * np.sin(2 * q + 0.3) + 2.0 * np.cos(3 * q)
        current = record.signals["current"] + torque / ARM.truth.gain
        return ExperimentRecord(t=record.t, signals={**record.signals, "current": current})

    plain, moved = (
        identify_gains_from_payload(*pair, ROBOT, mass=MASS, centre=CENTRE)
        for pair in (runs, tuple(map(biased, runs)))
    )
    assert np.abs(moved.gain / plain.gain - 1).max() < CANCELS


def slow(mass: float, centre: list[float]) -> list[ExperimentRecord]:
    series = random_excitation(ROBOT.limits, seed=4, margin=0.3, acceleration=2.0)
    light = with_payload(ARM, mass, centre, cylinder(mass, 0.02, 0.04, 2))
    return [record_of(simulate(arm, series, seed=k)) for k, arm in enumerate((ARM, light))]


def test_a_payload_too_light_for_a_joint_gives_it_no_gain() -> None:
    found = identify_gains_from_payload(*slow(1.0, [0.05, 0.0, 0.05]), ROBOT, mass=1.0)
    assert np.isnan(found.gain[0])
    assert found.warnings[0].code == "low_excitation"
    assert "shoulder_pan" in found.warnings[0].message


@pytest.mark.parametrize("robot", [ROBOT, without_gains()])
def test_a_payload_that_sets_no_scale_is_refused(robot: RobotModel) -> None:
    # On the last axis, joint 6 does not feel it.
    with pytest.raises(JobError, match=r"set the scale .*joints \d"):
        identify_gains_from_payload(*slow(0.2, [0.0, 0.0, 0.02]), robot, mass=0.2)


def test_misuse_is_refused(runs: tuple[ExperimentRecord, ExperimentRecord]) -> None:
    without, carrying = runs
    with pytest.raises(InputError, match="mass must be positive"):
        identify_gains_from_payload(without, carrying, ROBOT, mass=0.0)
    with pytest.raises(InputError, match="needs the centre"):
        identify_gains_from_payload(without, carrying, ROBOT, mass=1.0, inertia=np.eye(3))
    with pytest.raises(InputError, match="with and without"):
        identify_gains_from_payload(without, [], ROBOT, mass=1.0)
    blind = replace(without, signals={"q": without.signals["q"]})
    with pytest.raises(InputError, match="recorded currents"):
        identify_gains_from_payload(blind, carrying, ROBOT, mass=1.0)


def test_noise_and_unknown_gains_do_not_keep_a_heavy_payload_from_setting_the_scale() -> None:
    random = np.random.default_rng(0)
    noisy = [
        replace(
            record,
            signals={
                "q": record.signals["q"],
                "current": record.signals["current"] + random.normal(scale=0.1, size=(1250, 6)),
            },
        )
        for record in (ideal(1, False), ideal(1, True))
    ]
    found = identify_gains_from_payload(*noisy, without_gains(), mass=MASS)
    assert (np.abs(found.gain - GAIN) < 3 * found.std).all()
