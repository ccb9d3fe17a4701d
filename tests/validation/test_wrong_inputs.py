"""Wrong gains, signs and mountings are found by what joints share; good records stay silent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pinocchio_arm import Wrong, identified

from dynid.identification import ILL_CONDITIONED
from dynid.validation.findings import gravity_of, suspicious_inputs
from dynid.validation.input_faults import CERTAIN, Inputs, across, profile_of, suspects

SIGMAS = 4.0
LOWER_NOISE = 1e-3


@pytest.mark.parametrize(("seed", "load_friction"), [(0, 0.0), (1, 0.0), (2, 0.0), (3, 0.03)])
def test_a_good_record_raises_no_suspicion(tmp_path: Path, seed: int, load_friction: float) -> None:
    wrong = Wrong(seed=seed, load_friction=load_friction)
    assert suspects(*identified(tmp_path, wrong)) == ()


@pytest.mark.parametrize(("joint", "factor"), [(0, 1.1), (1, 0.9), (1, 1.1), (2, 1.3)])
def test_a_wrong_gain_is_measured(tmp_path: Path, joint: int, factor: float) -> None:
    scales = [1.0, 1.0, 1.0]
    scales[joint] = factor
    (found,) = suspects(*identified(tmp_path, Wrong(scales=(scales[0], scales[1], scales[2]))))
    assert (found.kind, found.joint) == ("gain", joint)
    assert found.value == pytest.approx(factor, abs=max(SIGMAS * found.std, 0.005))
    assert found.std < abs(factor - 1) / CERTAIN
    assert found.others == ()


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_a_reversed_torque_is_found(tmp_path: Path, joint: int) -> None:
    scales = [1.0, 1.0, 1.0]
    scales[joint] = -1.0
    wrong = Wrong(scales=(scales[0], scales[1], scales[2]))
    estimate, samples = identified(tmp_path, wrong)
    strongest = suspects(estimate, samples)[0]
    assert (strongest.kind, strongest.joint) == ("sign", joint)
    notices = suspicious_inputs(estimate, samples)
    assert (notices[0].kind, notices[0].joints) == ("reversed", (joint,))


@pytest.mark.parametrize("degrees", [1.0, 2.0, 5.0])
def test_a_tilted_base_is_measured(tmp_path: Path, degrees: float) -> None:
    estimate, samples = identified(tmp_path, Wrong(tilt_deg=degrees))
    (found,) = suspects(estimate, samples)
    assert found.kind == "mounting"
    assert found.value == pytest.approx(degrees, abs=max(SIGMAS * found.std, 0.05))
    gravity = gravity_of(found.inputs, estimate.model.robot.gravity)
    lean = np.sin(np.radians(degrees))
    expected = 9.80665 * np.array([0.6 * lean, 0.8 * lean, -np.cos(np.radians(degrees))])
    np.testing.assert_allclose(gravity, expected, rtol=0, atol=0.05)


def test_two_wrong_inputs_are_told_apart(tmp_path: Path) -> None:
    found = suspects(*identified(tmp_path, Wrong(scales=(1.0, 1.2, 1.0), tilt_deg=3.0)))
    assert {(f.kind, f.joint) for f in found} == {("gain", 1), ("mounting", None)}


def test_a_motion_that_tells_nothing_apart_accuses_nobody(tmp_path: Path) -> None:
    estimate, samples = identified(tmp_path, Wrong(scales=(1.0, 1.3, 1.0)))
    poor = replace(estimate, motion_condition_number=2 * ILL_CONDITIONED)
    assert suspects(poor, samples) == ()
    assert suspects(estimate, replace(samples, block=samples.count // 20)) == ()


def test_the_profile_is_the_noise_of_a_weighted_fit(tmp_path: Path) -> None:
    estimate, samples = identified(tmp_path, Wrong())
    profile = profile_of(estimate.model, samples)
    told = Inputs(scales=np.ones(3))
    value, weights = profile.log_noise(profile.without(), told)
    freedom = 1 - len(estimate.values) / (3 * profile.rows)
    np.testing.assert_allclose(1 / weights, estimate.noise * np.sqrt(freedom), rtol=0.02)
    assert value == pytest.approx(-np.log(weights).sum(), abs=1e-12)
    # A scale common to all joints only scales the parameters.
    common = profile.log_noise(profile.without(), Inputs(scales=np.full(3, 1.3)))[0]
    assert common == pytest.approx(value, abs=LOWER_NOISE)


def test_axes_lie_across_gravity() -> None:
    for gravity in np.random.default_rng(2).normal(size=(20, 3)):
        axes = across(gravity)
        np.testing.assert_allclose(axes @ axes.T, np.eye(2), rtol=0, atol=1e-12)
        np.testing.assert_allclose(axes @ gravity, 0.0, rtol=0, atol=1e-12)
