import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.recording import ExperimentRecord
from dynid.robot import load_robot
from dynid.signals import (
    NYQUIST_SHARE,
    ProcessingSettings,
    UniformSignals,
    default_cutoff,
    low_pass,
    motion_bandwidth,
    samples_from,
    uniform_signals,
)
from dynid.signals.filters import HARMONIC_FACTOR, LOWEST_DEFAULT_HZ

PHASE = 1e-3
"""[rad]"""
AMPLITUDE = 1e-3
LINE, LINE_AT_8_KHZ = 1e-9, 3e-9
"""Rounding; at 8 kHz 0.7e-9 with SciPy 1.17, 1.2e-9 with 1.18."""
AT_ENDS = 0.02
"""Share of the largest acceleration."""


def _phasor(values: np.ndarray, rate: float, frequency: float) -> complex:
    """Amplitude and phase of one frequency, from the middle of a signal."""
    t = np.arange(len(values)) / rate
    middle = slice(len(values) // 4, 3 * len(values) // 4)
    waves = np.column_stack([np.cos(2 * np.pi * frequency * t), np.sin(2 * np.pi * frequency * t)])
    (cosine, sine), *_ = np.linalg.lstsq(waves[middle], values[middle], rcond=None)
    return complex(cosine, -sine)


@pytest.mark.parametrize("rate", [125.0, 500.0, 5000.0])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 1.0, 1.5])
def test_waves_keep_their_phase_and_lose_amplitude_as_butterworth_twice(
    rate: float, share: float
) -> None:
    cutoff = 5.0
    frequency = share * cutoff
    t = np.arange(int(12 * rate)) / rate
    out = low_pass(np.cos(2 * np.pi * frequency * t + 0.4)[:, None], rate, cutoff)[:, 0]
    found = _phasor(out, rate, frequency)
    ratio = np.tan(np.pi * frequency / rate) / np.tan(np.pi * cutoff / rate)
    # Half the amplitude at the cut-off itself.
    assert abs(found) == pytest.approx(1 / (1 + ratio**8), rel=AMPLITUDE, abs=AMPLITUDE)
    assert np.angle(found) == pytest.approx(0.4, abs=PHASE)


def test_columns_do_not_mix() -> None:
    values = np.random.default_rng(1).normal(size=(300, 3))
    together = low_pass(values, 125.0, 8.0)
    for j in range(3):
        np.testing.assert_allclose(
            together[:, j], low_pass(values[:, [j]], 125.0, 8.0)[:, 0], rtol=0, atol=1e-12
        )


@pytest.mark.parametrize("count", [3, 32, 1001])
def test_constants_pass_untouched_to_their_ends(count: int) -> None:
    level = np.full((count, 1), 2.5)
    np.testing.assert_allclose(low_pass(level, 125.0, 6.0), level, rtol=0, atol=LINE)


@pytest.mark.parametrize(
    ("rate", "rounding"), [(125.0, LINE), (1000.0, LINE), (8000.0, LINE_AT_8_KHZ)]
)
def test_cubics_pass_untouched_to_their_ends(rate: float, rounding: float) -> None:
    time = np.linspace(-1, 1, int(8 * rate))[:, None]
    motion = np.hstack([time, 3 + time**2, time**3 - 0.2 * time + 1])
    np.testing.assert_allclose(low_pass(motion, rate, 6.0), motion, rtol=0, atol=rounding)


@pytest.mark.parametrize("rate", [125.0, 1000.0])
def test_a_motion_that_begins_and_ends_moving_keeps_its_acceleration(rate: float) -> None:
    """Mirrored ends would turn accelerations round: 70 % of the largest would be wrong."""
    t, rng = np.arange(int(8.3 * rate)) / rate, np.random.default_rng(0)
    waves = 2 * np.pi * np.array([0.5, 0.9])
    phases, sizes = np.array([0.3, 1.0]), np.array([1.0, 0.3])
    q = np.cos(np.outer(t, waves) + phases) @ sizes
    acceleration = -np.cos(np.outer(t, waves) + phases) @ (sizes * waves**2)
    measured = q + 1e-5 * rng.normal(size=len(q))
    signals = UniformSignals(
        t=t,
        rate_hz=rate,
        q=measured[:, None],
        qd=None,
        torque=np.zeros((len(t), 1)),
        valid=np.ones(len(t)),
    )
    found = samples_from(signals, ProcessingSettings(cutoff_hz=9.0), trim=False).ddq[:, 0]
    assert np.abs(found - acceleration).max() < AT_ENDS * np.abs(acceleration).max()


@given(
    count=st.integers(3, 60),
    cutoff=st.floats(0.1, 1e4),
    rate=st.sampled_from([10.0, 125.0, 5000.0]),
)
@settings(derandomize=True, max_examples=80)
def test_short_records_and_extreme_cut_offs_stay_finite(
    count: int, cutoff: float, rate: float
) -> None:
    values = np.random.default_rng(count).normal(size=(count, 2))
    out = low_pass(values, rate, cutoff)
    assert out.shape == values.shape
    assert np.isfinite(out).all()


def test_a_cut_off_beyond_the_rate_is_lowered_to_what_the_rate_carries() -> None:
    values = np.random.default_rng(2).normal(size=(200, 1))
    most = NYQUIST_SHARE * 125.0 / 2
    np.testing.assert_array_equal(low_pass(values, 125.0, 1e5), low_pass(values, 125.0, most))
    assert not np.array_equal(low_pass(values, 125.0, 0.5 * most), low_pass(values, 125.0, most))


def _excitation(t: np.ndarray, highest: float, joints: int = 3) -> np.ndarray:
    """Five harmonics of equal acceleration: the last has 3 % of the velocity's power."""
    base = 2 * np.pi * highest / 5
    waves = [
        [np.sin(k * base * t + j + k) / (k**2 * base) for k in range(1, 6)] for j in range(joints)
    ]
    return np.array(waves).sum(axis=1).T


@pytest.mark.parametrize("highest", [0.5, 1.0, 2.5])
@pytest.mark.parametrize("rate", [50.0, 125.0, 500.0, 5000.0])
@pytest.mark.parametrize("noise", [0.0, 1e-5, 2e-4])
def test_the_bandwidth_is_the_highest_harmonic_whatever_the_noise(
    highest: float, rate: float, noise: float
) -> None:
    random = np.random.default_rng(3)
    duration = 20.0
    nominal = np.arange(int(duration * rate)) / rate
    t = nominal + random.uniform(-0.2, 0.2, len(nominal)) / rate
    q = _excitation(t, highest, joints=6)
    q = q + noise * random.normal(size=q.shape)
    record = ExperimentRecord(t=t, signals={"q": q, "effort": q})
    signals = uniform_signals(record, load_robot("ur5"), ProcessingSettings())
    # The window of a finite record widens every line by two bins.
    found = motion_bandwidth(signals.q, signals.rate_hz)
    assert highest - 0.01 <= found <= highest + 3 / duration
    cutoff = default_cutoff(signals.q, signals.rate_hz)
    expected = max(HARMONIC_FACTOR * found, LOWEST_DEFAULT_HZ)
    assert cutoff == pytest.approx(min(expected, NYQUIST_SHARE * signals.rate_hz / 2))


def test_the_joint_in_the_middle_decides_and_resting_joints_do_not() -> None:
    t = np.arange(2500) / 125.0
    slow, fast = _excitation(t, 0.5), _excitation(t, 4.0)
    still = 1e-5 * np.random.default_rng(4).normal(size=(2500, 4))
    bandwidth = motion_bandwidth(np.hstack([slow[:, :1], still]), 125.0)
    assert bandwidth == pytest.approx(0.5, abs=0.15)
    mixed = np.hstack([slow[:, :1], fast[:, :2] * 0.2])
    assert motion_bandwidth(mixed, 125.0) == pytest.approx(4.0, abs=0.15)


@pytest.mark.parametrize("rate", [125.0, 500.0])
@pytest.mark.parametrize(("noise", "resolution"), [(3e-3, 0.0), (0.0, 0.01)])
def test_coarse_positions_are_no_fast_motion(rate: float, noise: float, resolution: float) -> None:
    t = np.arange(int(20 * rate)) / rate
    true = _excitation(t, 0.5)
    q = true + noise * np.random.default_rng(5).normal(size=true.shape)
    if resolution:
        q = resolution * np.round(true / resolution)
    assert motion_bandwidth(q, rate) == pytest.approx(motion_bandwidth(true, rate), abs=0.15)


@pytest.mark.parametrize("q", [np.zeros((2000, 2)), np.full((2000, 1), 1.234567)])
def test_a_robot_at_rest_gets_the_lowest_cut_off(q: np.ndarray) -> None:
    assert default_cutoff(q, 125.0) == LOWEST_DEFAULT_HZ
    assert motion_bandwidth(q, 125.0) > 0
