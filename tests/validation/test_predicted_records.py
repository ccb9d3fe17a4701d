import json
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_arm import RATE, estimate, record, samples, samples_without_torque

from dynid.core import InputError
from dynid.identification import Assessment
from dynid.identification.selection.regions import TorqueInterval
from dynid.recording import ExperimentRecord
from dynid.robot import Counterbalance, load_robot
from dynid.signals import ProcessingSettings
from dynid.validation import (
    MOVING_SPEED,
    ValidationResult,
    record_findings,
    reproduce,
    validate,
    validate_samples,
)

FORMULA = 1e-12
FILTERED = 0.02
"""Of the torque's norm: what filtering a known motion costs, its ends included."""
SMEARED = 8.0
"""[%] of the torque."""
METRICS = {
    "samples",
    "normalized_error",
    "rmse",
    "nrmse",
    "relative_error_percent",
    "relative_error_overall_percent",
    "r2",
}


def _codes(result: ValidationResult) -> list[str]:
    return [notice.code for notice in result.warnings]


def test_the_errors_are_measurement_less_prediction() -> None:
    error = np.random.default_rng(1).normal(size=(2000, 6)) * np.arange(1, 7)
    result = validate_samples(estimate(), samples(error))
    np.testing.assert_allclose(result.measured - result.predicted, error, rtol=0, atol=1e-9)
    rms = np.sqrt(np.square(error).mean(axis=0))
    np.testing.assert_allclose(result.metrics.rmse, rms, rtol=1e-9, atol=0)
    assert result.metrics.samples == 2000


def test_json_has_the_keys_of_the_design_at_every_level() -> None:
    result = validate_samples(estimate(), samples(0.5))
    data = json.loads(json.dumps(result.to_json(), allow_nan=False))
    assert set(data) == METRICS | {
        "moving",
        "at_rest",
        "residual_autocorrelation",
        "warnings",
        "findings",
    }
    assert set(data["moving"]) == set(data["at_rest"]) == METRICS
    for part in (data, data["moving"], data["at_rest"]):
        for key in ("rmse", "nrmse", "relative_error_percent", "r2"):
            assert len(part[key]) == 6
    assert len(data["residual_autocorrelation"]) == 6


def test_moving_and_resting_samples_are_told_apart_joint_by_joint() -> None:
    resting = np.abs(samples().dq) <= MOVING_SPEED
    assert resting[1001:, 5].all()
    result = validate_samples(estimate(), samples(np.where(resting, 3.0, 0.5)))
    np.testing.assert_allclose(result.at_rest.rmse, 3.0, rtol=1e-9, atol=0)
    np.testing.assert_allclose(result.moving.rmse, 0.5, rtol=1e-9, atol=0)
    assert result.at_rest.samples == round(resting.sum() / 6)
    assert result.moving.samples + result.at_rest.samples == pytest.approx(2000, abs=1)


def test_a_slow_joint_moves_below_the_speed_of_others() -> None:
    made = estimate()
    limits = made.model.robot.limits
    slow = replace(limits, velocity=limits.velocity * np.array([0.004, 1, 1, 1, 1, 1]))
    robot = replace(made.model.robot, limits=slow)
    here = replace(made, model=replace(made.model, robot=robot))
    result = validate_samples(here, replace(samples(), dq=0.004 * samples().dq))
    assert result.moves[:, 0].mean() > 0.7
    assert not result.moves[:, 1:].any()


def test_a_joint_that_always_moves_has_no_error_at_rest() -> None:
    whole = samples(0.5)
    # Away from every turning point of joint 1.
    fast = np.abs(whole.dq[:, 0]) > 2 * MOVING_SPEED
    part = {name: getattr(whole, name)[fast] for name in ("t", "q", "dq", "ddq", "tau")}
    data = validate_samples(estimate(), replace(whole, **part)).to_json()
    assert data["at_rest"]["rmse"][0] is None
    assert data["at_rest"]["rmse"][5] is not None


@pytest.mark.parametrize(("correlation", "low", "high"), [(0.0, -0.1, 0.1), (0.95, 0.9, 0.98)])
def test_the_colour_of_the_error_is_shown(correlation: float, low: float, high: float) -> None:
    random = np.random.default_rng(2)
    error = np.zeros((2000, 6))
    for k in range(1, 2000):
        error[k] = correlation * error[k - 1] + random.normal(size=6)
    rho = validate_samples(estimate(), samples(error)).residual_autocorrelation
    assert ((low < rho) & (rho < high)).all()


def test_a_perfect_prediction_has_no_colour_and_is_still_json() -> None:
    data = validate_samples(estimate(), samples()).to_json()
    assert data["normalized_error"] == 0
    assert data["residual_autocorrelation"] == [0.0] * 6
    json.dumps(data, allow_nan=False)


def test_known_motions_are_not_extrapolated() -> None:
    assert "extrapolated" not in _codes(validate_samples(estimate(), samples()))
    # Within 15 % nothing is said.
    assert "extrapolated" not in _codes(validate_samples(estimate(), samples(size=1.07)))


def test_faster_motions_are_extrapolated_and_named() -> None:
    result = validate_samples(estimate(), samples(speed=1.5))
    (notice,) = [n for n in result.warnings if n.code == "extrapolated"]
    name = estimate().model.robot.joint_names[0]
    assert f"{name} speed 1.6 against 1.1 rad/s" in notice.message
    # Four facts are enough.
    assert notice.message.count(" against ") == 4


@pytest.mark.parametrize(("share", "beyond"), [(0.1, False), (0.2, True)])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_places_a_little_beyond_are_still_known(share: float, beyond: bool, side: float) -> None:
    moved = samples()
    known = estimate().motion
    away = replace(moved, q=moved.q + side * share * (known.upper - known.lower))
    assert ("extrapolated" in _codes(validate_samples(estimate(), away))) == beyond


def test_a_place_that_no_torque_depends_on_is_not_extrapolated() -> None:
    # The UR5 stands upright: its first joint turns about gravity.
    here = samples()
    turned = replace(here, q=here.q + np.array([2.0, 0, 0, 0, 0, 0]))
    assert "extrapolated" not in _codes(validate_samples(estimate(), turned))


def test_motions_elsewhere_are_extrapolated() -> None:
    here = samples()
    there = replace(here, q=here.q + np.array([0, 0, 0.5, 0, 0, 0]))
    (notice,) = [
        n for n in validate_samples(estimate(), there).warnings if n.code == "extrapolated"
    ]
    name = estimate().model.robot.joint_names[2]
    assert f"{name} position -0.5 to 1.5 against -1 to 1" in notice.message
    assert notice.message.count(" against ") == 1


def test_resting_joints_are_warned_of_when_they_are_many() -> None:
    still = samples()
    assert "at_rest" not in _codes(validate_samples(estimate(), still))
    dq = still.dq.copy()
    dq[600:, 3:] = 0.0
    (notice,) = [
        n
        for n in validate_samples(estimate(), replace(still, dq=dq)).warnings
        if n.code == "at_rest"
    ]
    assert "36 % of the joint samples are at rest" in notice.message


def test_a_record_is_processed_as_the_identification_was() -> None:
    result = validate(estimate(), record())
    assert result.metrics.relative_error_overall_percent < 100 * FILTERED
    # Measured torques are compared as they are: nothing is filtered or averaged.
    np.testing.assert_array_equal(result.measured, record().signals["effort"])
    np.testing.assert_allclose(result.t, record().t - record().t[0], rtol=0, atol=1e-9)


def test_the_share_within_the_intervals_is_told_joint_by_joint() -> None:
    each = np.ones(6)
    interval = TorqueInterval(
        root=np.zeros((len(estimate().values), 1)), sigma=each, scale=each, slowest=1e-3 * each,
        quantiles=np.ones((2, 6, 6)), averaged=0 * each,
    )  # fmt: skip
    judged = Assessment(
        anywhere=each, this_motion=each, noise_floor=each, torque=each, models=(), pays=None,
        interval=interval, by_speed=np.zeros((2, 6, 8)),
    )  # fmt: skip
    known = replace(estimate(), assessment=judged)
    wrong = record()
    effort = wrong.signals["effort"].copy()
    effort[: len(effort) // 4, 2] += 1e3
    result = validate(known, replace(wrong, signals={**wrong.signals, "effort": effort}))
    assert result.covered is not None
    # Half widths are 1 N.m and more; filtering a known motion costs less but for its ends.
    assert result.covered[2] == pytest.approx(0.75, abs=0.02)
    assert result != replace(result, covered=None)
    assert np.delete(result.covered, 2).min() > 0.97
    told = result.to_json()["interval"]
    assert (told["level"], told["covered"]) == (0.9, list(result.covered))
    assert validate(estimate(), record()).covered is None


def test_delays_and_cut_off_of_the_estimate_are_used() -> None:
    late = record()
    shifted = np.roll(late.signals["effort"], 3, axis=0)
    late = replace(late, signals={**late.signals, "effort": shifted})
    blind = validate(estimate(), late)
    settings = replace(estimate().settings, delays_s=(3 / RATE,) * 6)
    aware = validate(replace(estimate(), settings=settings), late)
    assert aware.metrics.normalized_error < 0.5 * blind.metrics.normalized_error
    slow = replace(estimate(), settings=replace(estimate().settings, cutoff_hz=0.2))
    plain = validate(estimate(), record())
    assert validate(slow, record()).metrics.normalized_error > 2 * plain.metrics.normalized_error


def test_a_prediction_comes_as_late_as_the_torque_between_samples() -> None:
    here, delay = record(), 2.5 / RATE
    motion = samples_without_torque(here.t - 40.0 - delay, stop=False)
    torque = estimate().predict(motion.q, motion.dq, motion.ddq)
    late = replace(here, signals={**here.signals, "effort": torque})
    exact, half_off = (
        validate(replace(estimate(), settings=each), late).metrics.rmse
        for each in (replace(estimate().settings, delays_s=(by,) * 6) for by in (delay, 2.0 / RATE))
    )
    assert (exact < 0.6 * half_off).all()


@pytest.mark.parametrize("jitter", [0.0, 0.1])
def test_half_a_sample_of_delay_takes_no_noise_away(jitter: float) -> None:
    """Torques between two samples would be means of both, with 0.71 of their noise."""
    noisy, random = record(), np.random.default_rng(0)
    t = noisy.t + jitter / RATE * random.uniform(-1.0, 1.0, len(noisy.t))
    effort = noisy.signals["effort"] + 20.0 * random.normal(size=noisy.signals["effort"].shape)
    noisy = replace(noisy, t=t, signals={**noisy.signals, "effort": effort})
    settings = replace(estimate().settings, delays_s=(0.5 / RATE,) * 6)
    late, plain = (
        validate(replace(estimate(), settings=each), noisy).metrics.rmse
        for each in (settings, estimate().settings)
    )
    np.testing.assert_allclose(late, plain, rtol=0.05)


def test_a_window_counts_from_the_records_start() -> None:
    result = validate(estimate(), record(), start_s=4.0, stop_s=9.0)
    # Every recorded row of the window is judged, its ends included.
    t = record().t - record().t[0]
    rows = (t >= 4.0) & (t < 9.0)
    np.testing.assert_allclose(result.t, t[rows] - 4.0, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(result.measured, record().signals["effort"][rows])
    with pytest.raises(InputError, match="window"):
        validate(estimate(), record(), start_s=50.0)


def test_velocities_are_made_where_the_record_has_none() -> None:
    assert estimate().settings.velocity == "measured"
    with_them, without = (validate(estimate(), record(velocities=v)) for v in (True, False))
    np.testing.assert_allclose(without.dq[200:800], with_them.dq[200:800], rtol=0, atol=1e-3)


def test_a_period_of_the_identification_is_not_asked_of_other_records() -> None:
    periodic = replace(estimate(), settings=replace(estimate().settings, period_s=7.77))
    result = validate(periodic, record())
    assert result.metrics.samples == validate(estimate(), record()).metrics.samples


def test_a_counterbalance_is_taken_off_the_prediction() -> None:
    spring = Counterbalance(
        joint=1,
        outer=0.8,
        inner=0.2,
        rest_length=0.6,
        offset=1.6,
        piston_area=1.7e-3,
        gas_work=1.5e4,
        gas_volume=1e-3,
    )
    plain = estimate()
    robot = replace(plain.model.robot, counterbalances=(spring,))
    balanced = replace(plain, model=replace(plain.model, robot=robot))
    motion = samples()
    torque = motion.tau.copy()
    torque[:, 1] -= spring.torque(motion.q[:, 1])
    result = validate_samples(balanced, replace(motion, tau=torque))
    assert result.metrics.normalized_error < 1e-9
    assert validate_samples(plain, replace(motion, tau=torque)).metrics.normalized_error > 1


def test_a_record_of_another_robot_is_refused() -> None:
    short = record()
    cut = {name: value[:, :4] for name, value in short.signals.items()}
    with pytest.raises(InputError, match="4 joints but ur5 has 6"):
        validate(estimate(), replace(short, signals=cut))


def test_a_robot_of_another_file_is_told_by_the_number_of_its_joints() -> None:
    other = str(Path(__file__).parents[2] / "examples" / "robots" / "gen3.toml")
    for robot, told in (("ur5", []), (other, [f"the record is of robot {other}, not of mine"])):
        metadata = replace(record().metadata, robot=robot)
        found = record_findings(
            replace(load_robot("ur5"), name="mine"), replace(record(), metadata=metadata)
        )
        assert [one.text for one in found] == told


def test_starts_and_stops_are_not_smeared_by_the_cutoff_of_a_slow_record() -> None:
    """Way points ask for more than the 2 Hz that suited slow sines."""
    slow = replace(estimate(), settings=ProcessingSettings(cutoff_hz=2.0, velocity="position"))
    t = np.arange(2000) / RATE
    share = np.clip((t % 2.0) / 1.0, 0.0, 1.0)
    up = share**3 * (10 - 15 * share + 6 * share**2)
    speed = 30 * share**2 * (1 - share) ** 2
    force = 60 * share - 180 * share**2 + 120 * share**3
    reach = np.where((t // 2.0) % 2 == 0, 1.0, -1.0)[:, None] * np.linspace(0.6, 1.2, 6)
    place = np.where((t // 2.0) % 2 == 0, up, 1 - up)[:, None] * np.linspace(0.6, 1.2, 6)
    dq, ddq = speed[:, None] * reach, force[:, None] * reach
    torque = slow.predict(place, dq, ddq)
    waypoints = ExperimentRecord(t=t, signals={"q": place, "effort": torque})
    result = validate(slow, waypoints)
    # The training errors keep to the settings of the fit.
    smeared = reproduce(slow, waypoints)
    assert smeared.moving.relative_error_overall_percent > SMEARED
    assert result.moving.relative_error_overall_percent < SMEARED / 4


def test_a_long_recording_is_predicted_in_parts() -> None:
    """The columns of all rows at once would take 4 kB a row more."""
    long, made = record(seconds=320.0), estimate()
    tracemalloc.start()
    try:
        validate(made, long)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 2500 * long.samples
