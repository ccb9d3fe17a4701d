import numpy as np
import pytest
from known_robot import recording, ur5

from dynid import identify
from dynid.recording import ExperimentRecord
from dynid.signals import ProcessingSettings, process, samples_at_stamps

SETTINGS = ProcessingSettings(cutoff_hz=20.0)
MOTION = 2e-3
"""Filter and linear interpolation between samples of 8 ms [rad]."""


def irregular(record: ExperimentRecord, share: float = 0.7) -> ExperimentRecord:
    """Lose rows at random, as a slow reader does."""
    kept = np.random.default_rng(0).random(record.samples) < share
    return ExperimentRecord(
        t=record.t[kept], signals={name: x[kept] for name, x in record.signals.items()}
    )


def test_a_uniform_record_is_judged_on_all_its_samples() -> None:
    record = recording(0)
    ours, plain = (f(record, ur5(), SETTINGS) for f in (samples_at_stamps, process))
    np.testing.assert_array_equal(ours.tau, record.signals["effort"])
    # An identification leaves out the ends, where filters settle.
    cut = (record.samples - plain.count) // 2
    assert cut > 0
    for name in ("tau", "q", "dq", "ddq"):
        np.testing.assert_array_equal(getattr(ours, name)[cut:-cut], getattr(plain, name))


def test_lost_rows_are_not_made_up() -> None:
    record = irregular(recording(0))
    grid = process(record, ur5(), SETTINGS)
    samples = samples_at_stamps(record, ur5(), SETTINGS)
    assert grid.count > samples.count == record.samples
    rows = np.searchsorted(record.t - record.t[0], samples.t + 1e-9) - 1
    np.testing.assert_allclose(samples.tau, record.signals["effort"][rows], rtol=0, atol=1e-9)
    np.testing.assert_allclose(samples.q, record.signals["q"][rows], rtol=0, atol=MOTION)


def test_a_delay_moves_the_torque() -> None:
    record = irregular(recording(0, noise=0.0))
    late = ProcessingSettings(cutoff_hz=20.0, delays_s=(0.0072,) * 6)
    samples = samples_at_stamps(record, ur5(), late)
    assert samples.late_s is not None
    stamps, want = record.t - record.t[0], samples.t + 0.0072
    apart = np.abs(stamps - want[:, None])
    rows = apart.argmin(axis=1)
    np.testing.assert_array_equal(samples.tau, record.signals["effort"][rows])
    np.testing.assert_allclose(samples.late_s[:, 1], stamps[rows] - want, rtol=0, atol=1e-9)


@pytest.mark.long
def test_the_error_of_a_jittered_record_is_that_of_its_noise() -> None:
    result = identify([recording(0)], ur5(), validation=irregular(recording(1)), progress=None)
    assert result.validation is not None
    whole = identify([recording(0)], ur5(), validation=recording(1)).validation
    assert whole is not None
    np.testing.assert_allclose(
        result.validation.metrics.rmse, whole.metrics.rmse, rtol=0.08, atol=0
    )
    assert result.validation.metrics.samples < 0.75 * whole.metrics.samples
    assert result.validation.metrics.normalized_error == pytest.approx(
        whole.metrics.normalized_error
        * np.sqrt(whole.metrics.samples / result.validation.metrics.samples),
        rel=0.08,
    )
