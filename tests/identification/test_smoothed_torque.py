"""A record whose torque was smoothed before it was written still tells the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from known_robot import COULOMB, MOTOR, NOISE, identified, recording, ur5
from scipy.signal import butter, sosfiltfilt

from dynid import identify
from dynid.identification import IdentificationProblem, read_estimate, write_estimate
from dynid.recording import ExperimentRecord
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.signals import ProcessingSettings, TorqueFilter, process
from dynid.validation import validate
from dynid.workflow import Identification, identify_shared

pytestmark = pytest.mark.usefixtures("undiagnosed")

CUTOFF_HZ = 2.5
ORDER = 3
DECAYED = 1e-4
"""Of a chunk against the whole, over the torque [N.m]."""


def smoothed(seed: int) -> ExperimentRecord:
    """The known UR5, its torque low-passed as by a program after the recording."""
    record = recording(seed, seconds=20.0, period=20.0, velocities=True)
    sections = butter(ORDER, CUTOFF_HZ, fs=125.0, output="sos")
    effort = sosfiltfilt(sections, record.signals["effort"], axis=0)
    return ExperimentRecord(t=record.t, signals={**record.signals, "effort": effort})


@pytest.fixture(scope="module")
def found() -> Identification:
    return identify(smoothed(0), ur5(), validation=smoothed(1))


def test_the_filter_is_found_and_said(found: Identification) -> None:
    passed = found.estimate.settings.torque_filter
    assert passed is not None
    assert passed.cutoff_hz == pytest.approx(CUTOFF_HZ, rel=0.1)
    assert "low-passed" in found.estimate.choices[0]


def test_friction_and_motor_inertia_are_those_of_the_arm(found: Identification) -> None:
    estimate = found.estimate
    value = dict(zip(estimate.names, estimate.values, strict=True))
    assert [value[f"Fc{j + 1}"] for j in range(6)] == pytest.approx(COULOMB, rel=0.1)
    assert [value[f"Im{j + 1}"] for j in range(2, 6)] == pytest.approx(MOTOR[2:], abs=0.35)


def test_predictions_are_compared_as_the_record_shows_them(found: Identification) -> None:
    assert found.validation is not None
    # What the filter leaves of white noise, and what the parameters lack.
    passed = np.sqrt(2 * CUTOFF_HZ / 125.0)
    assert (found.validation.metrics.rmse < 2.5 * passed * NOISE).all()
    assert found.validation.metrics.samples == len(found.validation.t)


def test_it_survives_the_file(found: Identification, tmp_path: Path) -> None:
    write_estimate(found.estimate, tmp_path / "model.json")
    read = read_estimate(tmp_path / "model.json")
    assert read.settings == found.estimate.settings
    again = validate(read, smoothed(1))
    assert found.validation is not None
    np.testing.assert_allclose(again.metrics.rmse, found.validation.metrics.rmse, rtol=1e-9)


def test_another_record_is_judged_as_it_was_measured(found: Identification) -> None:
    raw = validate(found.estimate, recording(1, seconds=20.0, period=20.0, velocities=True))
    assert (raw.metrics.rmse < 1.15 * NOISE).all()
    assert (raw.metrics.rmse > 0.9 * NOISE).all()


@pytest.mark.long
def test_a_filter_must_hold_for_all_records() -> None:
    both = [smoothed(0), recording(1, seconds=20.0, period=20.0, velocities=True)]
    assert identify(both, ur5()).estimate.settings.torque_filter is None


@pytest.mark.long
def test_shared_inertias_pass_it_too() -> None:
    result = identify_shared([smoothed(0), smoothed(1)], ur5())
    for estimate in result.estimates:
        assert estimate.settings.torque_filter is not None
        value = dict(zip(estimate.names, estimate.values, strict=True))
        assert [value[f"Fc{j + 1}"] for j in range(6)] == pytest.approx(COULOMB, rel=0.1)


def test_a_record_as_it_was_measured_passes_no_filter() -> None:
    assert identified().estimate.settings.torque_filter is None


def test_chunks_together_are_the_whole_record() -> None:
    record, robot = recording(3, seconds=60.0, period=20.0), ur5()
    passed = TorqueFilter(cutoff_hz=5.0, order=2)
    samples = process(record, robot, ProcessingSettings(cutoff_hz=10.0, torque_filter=passed))
    base = reduce_model(InverseDynamicModel(robot=robot))
    problem = IdentificationProblem(base=base, samples=samples)
    parts = list(problem.chunks())
    assert len(parts) > 2
    columns = np.concatenate([part for _, part, _ in parts], axis=-1)
    stack = base.model.stack(samples.q, samples.dq, samples.ddq)[list(base.independent)]
    whole = samples.as_recorded(stack)[..., samples.rows]
    scale = np.abs(whole).max()
    np.testing.assert_allclose(columns, whole, rtol=0, atol=DECAYED * scale)
    torque = np.concatenate([part for _, _, part in parts], axis=-1)
    np.testing.assert_array_equal(torque, samples.tau[samples.rows].T)
