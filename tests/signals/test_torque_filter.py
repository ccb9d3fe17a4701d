"""Torques that were low-passed before they were written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from dynid.core import InputError
from dynid.signals import Samples, TorqueFilter, UniformSignals, torque_end, was_smoothed

RATE = 125.0
ROUNDING = 1e-12
DECAYED = 1e-5
"""What is left of the response where a chunk ends, over the signals."""
BETWEEN_STAMPS = 5e-3
"""Straight lines between jittered stamps."""
FILTER = TorqueFilter(cutoff_hz=2.0, order=3)


def signals(count: int = 2500) -> np.ndarray:
    t = np.arange(count) / RATE
    return np.array([np.sign(np.sin(0.9 * t + k)) + np.sin(2.3 * t) for k in range(3)])


def samples(torque_filter: TorqueFilter | None, count: int = 2500) -> Samples:
    zeros = np.zeros((count, 3))
    return Samples(
        t=np.arange(count) / RATE,
        q=zeros,
        dq=zeros,
        ddq=zeros,
        tau=zeros,
        rate_hz=RATE,
        cutoff_hz=10.0,
        torque_filter=torque_filter,
    )


def uniform(torque: np.ndarray) -> UniformSignals:
    count = torque.shape[1]
    return UniformSignals(
        t=np.arange(count) / RATE,
        rate_hz=RATE,
        q=torque.T,
        qd=None,
        torque=torque.T,
        valid=np.ones(count),
    )


def reference(values: np.ndarray) -> np.ndarray:
    sections = butter(3, 2.0, fs=RATE, output="sos")
    return sosfiltfilt(sections, values, axis=-1, padlen=125)


def test_it_is_the_zero_phase_butterworth() -> None:
    values = signals()
    passed = FILTER.passed(values, np.arange(values.shape[1]) / RATE, RATE)
    np.testing.assert_allclose(passed, reference(values), rtol=0, atol=ROUNDING)


def test_what_lies_beyond_its_reach_does_not_matter() -> None:
    values, whole = signals(), samples(FILTER)
    passed = whole.as_recorded(values)
    part = slice(1000, 1300)
    wide, inner = whole.surroundings(part)
    assert wide.start > 0
    assert wide.stop < whole.count
    alone = whole.as_recorded(values[:, wide], wide)[:, inner]
    np.testing.assert_allclose(alone, passed[:, part], rtol=0, atol=DECAYED)


def test_stretches_between_gaps_pass_alone() -> None:
    values = signals()
    t = np.arange(values.shape[1]) / RATE
    t[1200:] += 3.0
    passed = FILTER.passed(values, t, RATE)
    np.testing.assert_allclose(passed[:, :1200], reference(values[:, :1200]), atol=ROUNDING)
    np.testing.assert_allclose(passed[:, 1200:], reference(values[:, 1200:]), atol=ROUNDING)


def test_jittered_stamps_pass_on_the_grid() -> None:
    generator = np.random.default_rng(0)
    even = np.arange(2500) / RATE
    t = even + generator.uniform(-0.3, 0.3, 2500) / RATE
    smooth = np.array([np.sin(1.3 * t), np.cos(4.0 * t)])
    expected = FILTER.passed(np.array([np.sin(1.3 * even), np.cos(4.0 * even)]), even, RATE)
    passed = FILTER.passed(smooth, t, RATE)
    at_grid = np.array([np.interp(even[50:-50], t, row) for row in passed])
    np.testing.assert_allclose(at_grid, expected[:, 50:-50], rtol=0, atol=BETWEEN_STAMPS)


def test_without_a_filter_nothing_changes() -> None:
    values, plain = signals(), samples(None)
    assert plain.as_recorded(values) is values
    assert plain.rows == slice(0, plain.count)
    part = slice(10, 20)
    assert plain.surroundings(part) == (part, slice(0, 10))


def test_rows_at_the_ends_are_not_used() -> None:
    used = samples(FILTER).rows
    assert used.start == samples(FILTER).count - used.stop == FILTER.settled(RATE) > 0
    # A short record keeps three quarters.
    assert samples(FILTER, 80).rows == slice(10, 70)


@pytest.mark.parametrize("noise", [1e-4, 1e-2])
def test_noise_says_that_nobody_smoothed(noise: float) -> None:
    generator = np.random.default_rng(1)
    values = signals() + noise * generator.normal(size=(3, 2500))
    assert not was_smoothed(uniform(values))
    assert was_smoothed(uniform(reference(values)))


def test_friction_alone_is_not_smooth() -> None:
    assert not was_smoothed(uniform(signals()))
    assert not was_smoothed(uniform(np.zeros((3, 2500))))


def test_the_torque_ends_a_little_above_the_cut_off() -> None:
    generator = np.random.default_rng(2)
    values = reference(signals() + 0.01 * generator.normal(size=(3, 2500)))
    assert 2.0 < torque_end(uniform(values)) < 8.0


@pytest.mark.parametrize("wrong", [{"cutoff_hz": 0.0}, {"cutoff_hz": -1.0}, {"order": 9}])
def test_filters_that_cannot_be_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match="torque filter"):
        replace(FILTER, **wrong)


def test_a_filter_above_what_a_record_shows_takes_nothing_away() -> None:
    """A record of 1 kHz had it; this one, of 125 Hz, was smoothed by something else."""
    passed = TorqueFilter(cutoff_hz=80.0, order=2).passed(signals(), np.arange(2500) / RATE, RATE)
    np.testing.assert_array_equal(passed, signals())
