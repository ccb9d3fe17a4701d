"""Friction at an unseen temperature, against the simulated arm's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynid.core import Finding, InputError, JobError
from dynid.identification import fit_law
from dynid.recording import ExperimentRecord
from dynid.regressor import LoadFriction, parse_terms
from dynid.robot import load_robot
from dynid.simulation import SimulatedRun, simulate, simulated_arm
from dynid.trajectory import random_excitation
from dynid.validation import validate
from dynid.workflow import (
    IdentifySettings,
    TemperatureIdentification,
    identify_shared,
    identify_temperature,
)
from dynid.workflow.running import record_of

ASKED = 0.05
"""Relative error of the friction at an unseen temperature."""
MOVING = 0.05
"""Slower joints may stick: the torque of a stuck joint is not friction's to predict [rad/s]."""
ROBOT = load_robot("ur5")
ARM = simulated_arm(ROBOT)
SETTINGS = IdentifySettings(preset="paper", terms=parse_terms("fc,fv,im", width=0.01))


def run_at(temperature_degC: float, motion: int, seed: int) -> SimulatedRun:
    series = random_excitation(ROBOT.limits, seed=motion, margin=0.8, acceleration=10.0)
    return simulate(ARM, series, thermal=temperature_degC, seed=seed)


@pytest.fixture(scope="module")
def records() -> list[ExperimentRecord]:
    return [record_of(run_at(degC, 0, k)) for k, degC in enumerate((20.0, 28.0, 36.0))]


@pytest.fixture(scope="module")
def found(records: list[ExperimentRecord]) -> TemperatureIdentification:
    return identify_temperature(records, ROBOT, SETTINGS)


@pytest.fixture(scope="module")
def unseen() -> SimulatedRun:
    """Another temperature, another motion, other noise."""
    return run_at(32.0, 10, 9)


def test_friction_of_an_unseen_temperature(
    found: TemperatureIdentification, unseen: SimulatedRun
) -> None:
    warm = unseen.signals["temperature"].mean(axis=0)
    estimate = found.estimate_at(warm)
    model, truth = estimate.model, unseen.truth
    friction = estimate.standard_parameters().copy()
    rigid = [k for k, name in enumerate(model.names) if name[:2] not in ("Fc", "Fv")]
    friction[rigid] = 0.0
    predicted = model.inverse_dynamics(truth.q, truth.dq, truth.ddq, friction)
    moving = np.abs(truth.dq) > MOVING
    error = np.linalg.norm((predicted - truth.friction) * moving, axis=0)
    assert (error < ASKED * np.linalg.norm(truth.friction * moving, axis=0)).all()
    values = dict(zip(estimate.names, estimate.values, strict=True))
    for symbol, true in (
        ("Fv", ARM.truth.friction.viscous_at(warm)),
        ("Fc", ARM.truth.friction.coulomb_at(warm)),
    ):
        ours = np.array([values[f"{symbol}{j}"] for j in range(1, 7)])
        assert np.abs(ours / true - 1).max() < ASKED
    assert not estimate.warnings


def test_the_order_of_the_recordings_changes_nothing(records: list[ExperimentRecord]) -> None:
    load = LoadFriction(joints=tuple(range(6)), parameters=(0.0,) * 60)
    terms = replace(parse_terms("fc,fv,im", width=0.01), load=load)
    settings = replace(SETTINGS, terms=terms)
    motion = np.random.default_rng(0).uniform(-2, 2, (3, 50, 6))
    torques = [
        identify_temperature(order, ROBOT, settings).estimate_at(30.0).predict(*motion)
        for order in (records, records[::-1])
    ]
    # By 2e-4 with the inertias of the first recording.
    np.testing.assert_allclose(torques[0], torques[1], atol=1e-9 * np.abs(torques[0]).max())


def test_the_law_is_the_arm_s(found: TemperatureIdentification) -> None:
    decay = [law.slope[law.symbols.index("Fv")] for law in found.laws]
    np.testing.assert_allclose(decay, ARM.truth.friction.viscous_decay, rtol=0.1)
    assert [law.law for law in found.laws] == ["exponential"] * 6
    data = found.to_json()
    assert [item["joint"] for item in data["laws"]] == list(ROBOT.joint_names)
    assert not data["warnings"]


def test_the_record_s_own_temperature_predicts_best(
    found: TemperatureIdentification, unseen: SimulatedRun
) -> None:
    record = record_of(unseen)
    warm = validate(
        found.estimate_at(unseen.signals["temperature"].mean(axis=0)), record
    ).metrics.rmse
    cold = validate(found.shared.estimates[0], record).metrics.rmse
    assert (warm < 0.5 * cold).all()


def test_beyond_the_records_it_says_so(found: TemperatureIdentification) -> None:
    notices = found.estimate_at(60.0).warnings
    assert [notice.code for notice in notices] == ["extrapolated"]
    assert "joint 1 at 60 degC" in notices[0].message
    with pytest.raises((InputError, ValueError)):
        found.estimate_at([20.0, 30.0])


def test_what_a_record_tells_of_itself_is_passed_on(records: list[ExperimentRecord]) -> None:
    stopped = Finding("aborted", "aborted after 900 samples: someone pressed stop")
    found = identify_temperature(
        [records[0], replace(records[2], problems=(stopped,))], ROBOT, SETTINGS
    )
    assert found.warnings == (stopped,)
    assert [stopped in one.warnings for one in found.shared.estimates] == [False, True]


def test_a_tool_of_the_robot_is_part_of_the_last_link(records: list[ExperimentRecord]) -> None:
    loaded = replace(ROBOT, tool=replace(ROBOT.tool, mass=4.0, com=np.array([0.0, 0.0, 0.1])))
    robot = identify_shared(records[:1], loaded, SETTINGS).estimates[0].model.robot
    assert robot.inertias[-1, 0] == ROBOT.inertias[-1, 0] + 4.0
    assert robot.notes == ("link 6 includes 4 kg at the flange, as the robot file says",)


def test_inertias_are_one_and_friction_each_record_s(records: list[ExperimentRecord]) -> None:
    shared = identify_shared(records, ROBOT, SETTINGS)
    first, _, last = shared.estimates
    place = {name: k for k, name in enumerate(first.names)}
    for name in shared.shared:
        assert first.values[place[name]] == last.values[place[name]]
    falls = [last.values[place[f"Fv{j}"]] / first.values[place[f"Fv{j}"]] for j in range(1, 7)]
    expected = ARM.truth.friction.viscous_at(np.full(6, 36.0)) / ARM.truth.friction.viscous_at(
        np.full(6, 20.0)
    )
    np.testing.assert_allclose(falls, expected, rtol=0.05)
    # Another motion adds knowledge of the inertias; repeating one adds little, as what the
    # model gets wrong repeats too.
    other = record_of(run_at(28.0, 11, 5))
    inertial = [place[name] for name in shared.shared]
    alone, twice, both = (
        identify_shared(several, ROBOT, SETTINGS).estimates[0].std[inertial]
        for several in (records[:1], records[:2], [records[0], other])
    )
    assert np.median(both / alone) < 0.8
    assert 0.85 < np.median(twice / alone) < 1.05


@pytest.mark.parametrize("law", ["exponential", "linear"])
def test_laws_recover_what_they_are_made_of(law: str) -> None:
    temperature = np.array([20.0, 26.0, 31.0, 38.0])
    rise = temperature - temperature.mean()
    fv = 12.0 * (np.exp(-0.03 * rise) if law == "exponential" else 1 - 0.03 * rise)
    values = np.stack([9.0 * (1 - 0.002 * rise), fv, np.full(4, 0.7)], axis=1)
    root = np.random.default_rng(0).normal(size=(12, 12))
    found = fit_law(values, root @ root.T + np.eye(12), temperature, ("Fc", "Fv", "Fo"))
    assert found.law == law
    np.testing.assert_allclose(found.reference, [9.0, 12.0, 0.7], rtol=1e-6)
    np.testing.assert_allclose(found.slope, [0.002, 0.03, 0.0], atol=1e-8)
    at, _ = found.at(30.0)
    step = 30.0 - found.reference_degC
    assert at[0] == pytest.approx(9.0 * (1 - 0.002 * step), rel=1e-6)


LAWS = ("exponential", "linear")


def test_an_exponential_law_goes_through_two_records() -> None:
    """The first step from their mean moves its slopes alone, and was the last one."""
    temperature = np.array([20.0, 40.0])
    values = np.array([[9.2, 13.5], [8.8, 7.4]])
    unsure = np.diag([0.01, 0.04, 0.02, 0.01])
    found = fit_law(values, unsure, temperature, ("Fc", "Fv"), law="exponential")
    through = [found.at(degC)[0] for degC in (20.0, 40.0)]
    np.testing.assert_allclose(through, values, rtol=1e-9)
    assert fit_law(values, unsure, temperature, ("Fc", "Fv")).law == "linear"


@pytest.mark.parametrize("viscous", [(0.01, -0.01, 0.06), (0.04, 0.0, -0.05)])
def test_friction_that_is_noise_leaves_a_law(viscous: tuple[float, ...]) -> None:
    """No exponential changes its sign: the search for one ended the whole job."""
    values = np.array([[5.0, 5.1, 4.9], viscous]).T
    unsure = 0.01 * np.diag([1.0, 2.0, 1.0, 1.0, 3.0, 1.0])
    assert fit_law(values, unsure, np.array([20.0, 28.0, 41.0]), ("Fc", "Fv")).law in LAWS


def test_deviations_of_a_law_cover() -> None:
    temperature = np.array([20.0, 28.0, 36.0])
    rise = temperature - temperature.mean()
    truth = np.stack([9.0 * (1 - 0.002 * rise), 12.0 * np.exp(-0.03 * rise)], axis=1)
    generator = np.random.default_rng(1)
    root = np.diag([0.1, 0.05] * 3) @ (np.eye(6) + 0.3 * generator.normal(size=(6, 6)))
    scores = []
    for _ in range(200):
        values = truth + (root @ generator.normal(size=6)).reshape(3, 2)
        found = fit_law(values, root @ root.T, temperature, ("Fc", "Fv"), law="exponential")
        expected = [9.0 * (1 - 0.002 * 4.0), 12.0 * np.exp(-0.03 * 4.0)]
        at, slope = found.at(32.0)
        scores.append((at - expected) / np.sqrt(np.diag(slope @ found.covariance @ slope.T)))
    np.testing.assert_allclose(np.std(scores, axis=0), 1.0, atol=0.15)


def test_equal_temperatures_give_no_law() -> None:
    values = np.array([[9.0, 12.0], [9.2, 11.8]])
    found = fit_law(values, np.eye(4), np.array([25.0, 26.0]), ("Fc", "Fv"))
    assert found.law == "constant"
    np.testing.assert_allclose(found.at(35.0)[0], values.mean(axis=0))


def test_misuse_is_refused(records: list[ExperimentRecord]) -> None:
    with pytest.raises(InputError, match="two records"):
        identify_temperature(records[:1], ROBOT, SETTINGS)
    with pytest.raises(InputError, match="two records"):
        identify_temperature([records[0], records[0]], ROBOT, SETTINGS)
    signals = {k: v for k, v in records[0].signals.items() if k != "temperature"}
    blind = ExperimentRecord(t=records[0].t, signals=signals)
    with pytest.raises(InputError, match=r"records \[2\]"):
        identify_temperature([records[0], blind], ROBOT, SETTINGS)
    with pytest.raises(InputError, match="unknown law"):
        fit_law(np.ones((2, 1)), np.eye(2), np.array([20.0, 30.0]), ("Fv",), law="cubic")
    with pytest.raises(JobError, match="follows from that of another"):
        fit_law(np.ones((2, 1)), np.ones((2, 2)), np.array([20.0, 30.0]), ("Fv",))
    with pytest.raises(InputError, match="weighted least squares"):
        identify_shared(records, ROBOT, IdentifySettings(estimator="tls"))
    with pytest.raises(InputError, match="at least one record"):
        identify_shared([], ROBOT)
