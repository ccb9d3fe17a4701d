import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.core import InputError
from dynid.recording import ExperimentRecord
from dynid.robot import load_robot
from dynid.signals import (
    GAP_STEPS,
    ProcessingSettings,
    UniformSignals,
    uniform_signals,
    window,
)
from dynid.signals.resample import MAX_GROWTH

RATE = 125.0
CUBIC_RMS = 2e-5
"""Of a 0.5 Hz motion of 1 rad at 125 Hz with steps up to 1.6 times too long."""
CUBIC = STRAIGHT = 3e-4
"""At the turning points, where a curve that does not overshoot is as flat as a line."""


def _wave(t: np.ndarray) -> np.ndarray:
    return np.column_stack([np.sin(np.pi * t), np.cos(0.6 * np.pi * t)])


def _on_grid(
    t: np.ndarray, q: np.ndarray, qd: np.ndarray | None, torque: np.ndarray
) -> UniformSignals:
    """Two joints' signals on the grid of a recording, seen thrice by a robot of six."""
    signals = {"q": q, "effort": torque} | ({} if qd is None else {"qd": qd})
    record = ExperimentRecord(t=t, signals={k: np.tile(x, 3) for k, x in signals.items()})
    return uniform_signals(record, load_robot("ur5"), ProcessingSettings())


def _jittered(seed: int, count: int = 1000, share: float = 0.3) -> np.ndarray:
    random = np.random.default_rng(seed)
    return (np.arange(count) + random.uniform(-share, share, count)) / RATE


@pytest.mark.parametrize("start", [0.0, 3.7, 1.7e9])
@pytest.mark.parametrize("digits", [None, 4])
def test_a_uniform_recording_passes_untouched(start: float, digits: int | None) -> None:
    t = np.arange(1000) / RATE + start
    t = t if digits is None else np.round(t, digits)
    q, torque = _wave(t), 3 * _wave(t)
    signals = _on_grid(t, q, q, torque)
    np.testing.assert_array_equal(signals.t, t)
    np.testing.assert_array_equal(signals.q, np.tile(q, 3))
    np.testing.assert_array_equal(signals.qd, np.tile(q, 3))
    np.testing.assert_array_equal(signals.torque, np.tile(torque, 3))
    assert signals.valid.all()
    assert signals.rate_hz == pytest.approx(RATE, rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_a_jittered_wave_comes_back(seed: int) -> None:
    t = _jittered(seed)
    signals = _on_grid(t, _wave(t), 2 * _wave(t), 3 * _wave(t))
    np.testing.assert_allclose(np.diff(signals.t), 1 / signals.rate_hz, rtol=1e-9, atol=0)
    assert signals.rate_hz == pytest.approx(RATE, rel=0.02)
    assert signals.t[0] == t[0]
    assert t[-1] - 1 / signals.rate_hz < signals.t[-1] <= t[-1]
    truth = np.tile(_wave(signals.t), 3)
    assert signals.qd is not None
    np.testing.assert_allclose(signals.q, truth, rtol=0, atol=CUBIC)
    assert np.sqrt(np.square(signals.q - truth).mean()) < CUBIC_RMS
    np.testing.assert_allclose(signals.qd, 2 * truth, rtol=0, atol=2 * CUBIC)
    np.testing.assert_allclose(signals.torque, 3 * truth, rtol=0, atol=3 * STRAIGHT)
    assert signals.valid.all()


def test_velocities_that_were_not_recorded_are_not_made() -> None:
    t = _jittered(1)
    assert _on_grid(t, _wave(t), None, _wave(t)).qd is None


@pytest.mark.parametrize("steps", [GAP_STEPS - 1, GAP_STEPS + 1, 40])
def test_inside_a_gap_nothing_is_valid_and_outside_nothing_is_lost(steps: int) -> None:
    t = np.delete(np.arange(1000) / RATE, np.arange(401, 400 + steps))
    before, after = 400 / RATE, (400 + steps) / RATE
    assert t[401] - t[400] == pytest.approx(steps / RATE)
    signals = _on_grid(t, _wave(t), None, _wave(t))
    inside = (signals.t > before + 1e-9) & (signals.t < after - 1e-9)
    if steps < GAP_STEPS:
        assert signals.valid.all()
        return
    assert inside.sum() == steps - 1
    assert not signals.valid[inside].any()
    # The sample that opens a gap may be counted with it; no other may.
    assert signals.valid[~inside].sum() >= len(t) - 1
    valid = signals.valid > 0
    np.testing.assert_allclose(signals.q[valid, :2], _wave(signals.t[valid]), rtol=0, atol=CUBIC)


def test_every_gap_is_seen_in_jittered_stamps() -> None:
    t = _jittered(2)
    keep = np.ones(len(t), dtype=bool)
    keep[300:330] = keep[700:710] = False
    signals = _on_grid(t[keep], _wave(t[keep]), None, _wave(t[keep]))
    for first, last in ((299, 330), (699, 710)):
        inside = (signals.t > t[first]) & (signals.t < t[last])
        assert inside.sum() >= last - first - 2
        assert not signals.valid[inside].any()
    assert signals.valid.sum() >= keep.sum() - 8


@given(
    seed=st.integers(0, 2**31),
    count=st.integers(40, 200),
    spread=st.floats(0.01, 1.5),
)
@settings(derandomize=True, max_examples=60)
def test_a_grid_stays_inside_what_was_recorded(seed: int, count: int, spread: float) -> None:
    random = np.random.default_rng(seed)
    steps = np.exp(spread * random.normal(size=count))
    t = np.cumsum(steps)
    values = 1e-3 * random.normal(size=(count, 2))
    try:
        signals = _on_grid(t, values, None, values)
    except InputError:
        assert t[-1] - t[0] > MAX_GROWTH * 0.9 * count * np.median(np.diff(t))
        return
    assert signals.q.shape == (len(signals.t), 6)
    assert t[0] <= signals.t[0]
    assert signals.t[-1] <= t[-1] + 1e-9
    # Neither curve overshoots: no position or torque is invented.
    for made in (signals.q, signals.torque):
        assert (made[:, :2] >= values.min(axis=0) - 1e-12).all()
        assert (made[:, :2] <= values.max(axis=0) + 1e-12).all()


def test_stamps_without_a_rate_are_refused() -> None:
    t = np.concatenate([np.arange(100) / RATE, 60 + np.arange(100) / RATE])
    with pytest.raises(InputError, match=r"too irregular for a uniform grid; got 7600 points"):
        _on_grid(t, _wave(t), None, _wave(t))


@pytest.mark.parametrize(
    ("start", "stop", "first", "last"),
    [
        (None, None, 0, 1000),
        (0.0, 8.0, 0, 1000),
        (2.0, None, 250, 1000),
        (None, 2.0, 0, 250),
        (2.0, 4.0, 250, 500),
        (2.001, 4.001, 251, 501),
        (1.0, 100.0, 125, 1000),
    ],
)
def test_a_window_counts_from_the_records_start_and_leaves_its_end_to_the_next(
    start: float | None, stop: float | None, first: int, last: int
) -> None:
    t = 55.5 + np.arange(1000) / RATE
    assert window(t, start, stop) == slice(first, last)


@pytest.mark.parametrize(
    ("start", "stop", "message"),
    [
        (
            100.0,
            None,
            r"start_s 100 stop_s 7.992: the window holds too few samples; got 0; allowed:",
        ),
        (2.0, 2.1, r"start_s 2 stop_s 2.1: .*got 13; .*at least 32; the record lasts 7.992 s"),
        (None, 0.1, r"start_s 0 stop_s 0.1"),
    ],
)
def test_a_window_with_next_to_nothing_is_refused(
    start: float | None, stop: float | None, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        window(np.arange(1000) / RATE, start, stop)
