"""What differs in another recording is told by cause; friction is refitted alone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pinocchio_arm import NOISE, Wrong, arm, recording

from dynid import ExperimentRecord, identify
from dynid.core import Finding
from dynid.identification import Estimate
from dynid.validation import CAUSES, refit_friction, samples_of, validate
from dynid.workflow import IdentifySettings, verdict


@pytest.fixture(scope="module")
def estimate(tmp_path_factory: pytest.TempPathFactory) -> Estimate:
    settings = IdentifySettings(preset="paper", estimator="wls")
    return identify(recording(Wrong()), arm(tmp_path_factory.mktemp("arm")), settings).estimate


def test_a_gain_shows_as_gravity_and_inertia(estimate: Estimate) -> None:
    result = validate(estimate, recording(Wrong(scales=(1.0, 1.2, 1.0), seed=9)))
    assert result.transfer is not None
    gravity, inertia = result.transfer.share
    assert gravity[1] == pytest.approx(0.2, abs=0.02)
    assert inertia[1] == pytest.approx(0.2, abs=0.04)
    assert abs(gravity[2]) < 0.05
    assert CAUSES[int(np.argmax(result.transfer.rms[:, 1]))] == "gravity"
    assert set(json.loads(json.dumps(result.to_json()))["transfer"]) >= set(CAUSES)


@pytest.mark.parametrize("encoder", [0.0, 1e-5])
def test_what_a_pose_cannot_tell_from_an_offset_is_one(estimate: Estimate, encoder: float) -> None:
    """Half of it was gravity's; with an encoder's noise, hundreds of N.m of one and the other."""
    plain, rng = recording(Wrong(seed=9)), np.random.default_rng(1)
    q = plain.signals["q"][:1] + encoder * rng.normal(size=plain.signals["q"].shape)
    torque = estimate.predict(q, 0 * q, 0 * q) + [0.0, 1.0, 0.0] + 0.1 * rng.normal(size=q.shape)
    still = replace(plain, signals={"q": q, "qd": 0 * q, "effort": torque})
    found = validate(estimate, still).transfer
    assert found is not None
    assert found.rms[0] == pytest.approx([0.0, 1.0, 0.0], abs=0.05)
    assert found.rms[1].max() < 0.05


@pytest.mark.parametrize(("mass", "length"), [(0.01, 1.0), (1.0, 6.0)])
def test_a_load_is_weighed_on_a_light_arm_and_a_long_one(
    tmp_path: Path, mass: float, length: float
) -> None:
    """Of one's own size: 0.02 kg, or 2 kg 1.5 m from the joint."""
    robot = arm(tmp_path)
    stretch, by = np.diag([1.0, 1.0, 1.0, length]), np.repeat([1.0, length, length**2], [1, 3, 6])
    places = np.linalg.inv(stretch) @ robot.placements @ stretch
    robot = replace(robot, placements=places, inertias=mass * by * robot.inertias)

    def seen(wrong: Wrong) -> ExperimentRecord:
        plain, slower = recording(wrong), np.sqrt(length)
        signals = {"q": plain.signals["q"], "effort": mass * length * plain.signals["effort"]}
        return ExperimentRecord(t=slower * plain.t, signals=signals)

    settings = IdentifySettings(preset="paper", estimator="wls")
    loaded = seen(Wrong(carried=2.0, seed=9))
    found = identify(seen(Wrong()), robot, settings, validation=loaded)
    (load,) = [one for one in found.warnings if one.kind == "payload"]
    assert "over_fitted" not in [one.code for one in found.warnings]
    assert load.value == pytest.approx(2.0 * mass, rel=0.02)
    # The load is no fault of the model.
    error = verdict(found).prediction.value
    assert error is not None
    assert error < 2.0


def test_a_gain_shows_so_where_motors_are_coupled(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    coupling = np.diag([80.0, 80.0, 50.0])
    coupling[1, 0] = -40.0
    motors = coupling.T @ np.diag([1e-4, 2e-3, 1e-4]) @ coupling
    coupled = replace(robot, drives=replace(robot.drives, coupling=coupling))

    def recorded(seed: int, gain: float) -> ExperimentRecord:
        plain = recording(Wrong(seed=seed))
        speed = np.gradient(plain.signals["q"], plain.t, axis=0)
        effort = plain.signals["effort"] + np.gradient(speed, plain.t, axis=0) @ motors
        effort = effort * np.array([1.0, gain, 1.0])
        return replace(plain, signals={**plain.signals, "effort": effort})

    settings = IdentifySettings(preset="paper", estimator="wls")
    estimate = identify(recorded(0, 1.0), coupled, settings).estimate
    found = validate(estimate, recorded(9, 1.2)).transfer
    assert found is not None
    assert found.share[:, 1] == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize("known", [0, pytest.param(2, marks=pytest.mark.long)])
def test_guessed_links_that_are_far_off_cost_nothing(tmp_path: Path, known: int) -> None:
    """Delays of 22 and 48 ms compensated for them; another part was predicted ten times worse."""
    robot = arm(tmp_path)
    inertias = robot.inertias.copy()
    inertias[known:] = np.nan
    unpublished = replace(robot, inertias=inertias)
    record = recording(Wrong(carried=2.0, seconds=24.0))
    settings = IdentifySettings(stop_s=8.0)
    result = identify(record, unpublished, settings, validation=record, validation_start_s=10.0)
    assert result.estimate.settings.delays_s is None
    assert result.validation is not None
    assert (result.validation.metrics.rmse < 1.1 * NOISE).all()


@pytest.mark.parametrize("estimator", ["bayes", "sdp"])
def test_a_guessed_last_link_has_a_lever(tmp_path: Path, estimator: str) -> None:
    """A URDF ends at its last joint: 2 kg there gave 9.4 and 2.2 times the noise."""
    robot = arm(tmp_path)
    unpublished = replace(robot, inertias=np.full_like(robot.inertias, np.nan))
    record = recording(Wrong(carried=2.0, seconds=24.0))
    settings = IdentifySettings(preset="paper", estimator=estimator, stop_s=8.0)
    result = identify(record, unpublished, settings, validation=record, validation_start_s=10.0)
    assert result.validation is not None
    assert (result.validation.metrics.rmse < 1.1 * NOISE).all()


def test_joints_that_stood_are_not_known(tmp_path: Path) -> None:
    """Their friction was made of noise, or none with an interval of none."""
    robot, record = arm(tmp_path), recording(Wrong(still=(1, 2)))
    result = identify(record, robot, validation=recording(Wrong(seed=9)))
    named = {name for name in result.estimate.names if name[0] == "F"}
    assert named
    assert not {name for name in named if int(name[-1]) > 1 and name[:2] != "Fo"}
    assert result.validation is not None
    assert result.validation.covered is not None
    assert (result.validation.covered > 0.8).all()
    assert not {f.kind for f in result.warnings} & {"clock_scale", "friction_compensated"}


def test_other_friction_is_refitted_and_inertias_stay(estimate: Estimate) -> None:
    other = recording(Wrong(load_friction=0.15, seed=9))
    before = validate(estimate, other)
    assert before.transfer is not None
    assert CAUSES[int(np.argmax(before.transfer.rms[:, 1]))] == "friction"
    adapted = refit_friction(estimate, samples_of(estimate, other))
    after = validate(adapted, other)
    assert after.metrics.rmse[1] < 0.8 * before.metrics.rmse[1]
    friction = [name.startswith(("Fc", "Fv")) for name in estimate.names]
    kept = ~np.array(friction)
    np.testing.assert_array_equal(adapted.values[kept], estimate.values[kept])
    assert (adapted.values[~kept] != estimate.values[~kept]).all()
    assert np.linalg.eigvalsh(adapted.covariance).min() > -1e-12


def test_friction_that_a_recording_does_not_show_stays(estimate: Estimate) -> None:
    """It was made of rounding: -3.7e7 N.m.s/rad, or 0.0 +- 0.0."""
    other = recording(Wrong(still=(1, 2), seed=9))
    # Also of joints that stood when they were identified.
    stood = replace(estimate.motion, speed=estimate.motion.speed * np.array([1.0, 0.0, 0.0]))
    for known in (estimate, replace(estimate, motion=stood)):
        adapted = refit_friction(known, samples_of(known, other))
        (told,) = [one for one in adapted.warnings if one.kind == "low_excitation"]
        for name, before, after, std in zip(
            known.names, known.values, adapted.values, adapted.std, strict=True
        ):
            if name[0] == "F" and int(name[-1]) > 1:
                assert name in told.message
                assert abs(after - before) < 2 * std
                assert std > 0.5 * abs(before)


def test_a_refitted_estimate_says_so(estimate: Estimate, tmp_path: Path) -> None:
    from dynid.identification import read_estimate, write_estimate
    from dynid.recording import write_record
    from dynid.workflow import validate_files

    paths = [tmp_path / name for name in ("known.json", "warm.parquet", "warm.json")]
    write_estimate(estimate, paths[0])
    write_record(recording(Wrong(load_friction=0.15, seed=9)), paths[1])
    told = validate_files(*paths[:2], refit="friction", output=paths[2]).warnings
    assert "same_record" in {one.kind for one in told}
    assert any("refitted to" in one for one in read_estimate(paths[2]).choices)
    assert "same_record" in {one.kind for one in validate_files(paths[2], paths[1]).warnings}
    # Of a part, that part.
    validate_files(*paths[:2], refit="friction", start_s=2.0, stop_s=7.0, output=paths[2])
    assert "2 s to 7 s" in read_estimate(paths[2]).choices[-1]
    for start, stop, seen in ((2.0, 7.0, True), (7.5, None, False)):
        after = validate_files(paths[2], paths[1], start_s=start, stop_s=stop).warnings
        assert ("same_record" in {one.kind for one in after}) == seen
    told = validate_files(paths[2], paths[1]).warnings
    assert any(one.text.startswith("2.0 to 7.0 s of the validation window") for one in told)
    # What was found when it was identified is no finding of the refit.
    doubted = replace(estimate, warnings=(Finding("low_excitation", "as it was identified"),))
    write_estimate(doubted, paths[0])
    told = validate_files(*paths[:2], refit="friction").warnings
    assert "low_excitation" not in {one.kind for one in told}


def test_unknown_parts_are_refused(tmp_path: Path) -> None:
    from dynid.core import InputError
    from dynid.workflow import validate_files

    with pytest.raises(InputError, match=r"refit.*friction"):
        validate_files(tmp_path / "e.json", tmp_path / "r.csv", refit="gravity")
