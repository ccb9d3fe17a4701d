from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.core import Array, InputError, MotionBounds
from dynid.trajectory import FourierSeries, peaks, random_excitation, usable_bounds

NAN = np.nan
UR5 = MotionBounds(
    lower=np.full(6, -2 * np.pi),
    upper=np.full(6, 2 * np.pi),
    velocity=np.full(6, np.pi),
    acceleration=np.full(6, NAN),
)


def dense_peaks(series: FourierSeries, points: int = 40_001) -> tuple[Array, Array, Array]:
    motion = series.evaluate(np.linspace(0, series.period, points))
    return motion.q, np.abs(motion.dq).max(axis=0), np.abs(motion.ddq).max(axis=0)


@given(st.integers(0, 10_000), st.integers(2, 8), st.floats(2.0, 40.0), st.floats(0.2, 1.0))
@settings(max_examples=40)
def test_stays_inside_the_limits_and_touches_one(
    seed: int, harmonics: int, period: float, margin: float
) -> None:
    series = random_excitation(
        UR5, harmonics=harmonics, period_s=period, seed=seed, margin=margin, acceleration=17.28
    )
    q, dq, ddq = dense_peaks(series, 4001)
    assert (np.abs(q) <= 2 * np.pi * margin + 1e-9).all()
    assert (dq <= np.pi * margin + 1e-9).all()
    assert (ddq <= 17.28 * margin + 1e-9).all()
    use = np.max(
        [np.ptp(q, axis=0) / (4 * np.pi * margin), dq / np.pi / margin, ddq / 17.28 / margin],
        axis=0,
    )
    assert (use > 0.99).all()


def test_peaks_are_never_below_the_true_ones() -> None:
    for seed in range(5):
        series = random_excitation(UR5, seed=seed)
        q, dq, ddq = dense_peaks(series)
        found = peaks(series)
        assert (found.upper >= q.max(axis=0)).all()
        assert (found.lower <= q.min(axis=0)).all()
        assert ((found.velocity >= dq) & (found.velocity < 1.002 * dq)).all()
        assert ((found.acceleration >= ddq) & (found.acceleration < 1.002 * ddq)).all()


def test_a_seed_gives_the_same_series_again() -> None:
    one, same, other = (random_excitation(UR5, seed=seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(one.a, same.a)
    np.testing.assert_array_equal(one.offset, same.offset)
    assert not np.array_equal(one.a, other.a)


def test_starts_at_rest_around_the_offset_asked_for() -> None:
    home = np.array([0.0, -1.57, 1.0, -1.0, 0.5, 0.0])
    series = random_excitation(UR5, seed=1, offset=home)
    start = series.evaluate([0.0])
    np.testing.assert_array_equal(series.offset, home)
    assert np.abs(start.dq).max() < 1e-12
    assert np.abs(start.ddq).max() < 1e-12


def test_unknown_positions_count_as_half_a_turn() -> None:
    unknown = MotionBounds(
        lower=[NAN, 4.0, NAN],
        upper=[NAN, NAN, -4.0],
        velocity=np.full(3, NAN),
        acceleration=np.full(3, NAN),
    )
    bounds = usable_bounds(unknown)
    np.testing.assert_allclose(bounds.lower, [-np.pi, 4.0, -4.0 - 2 * np.pi])
    np.testing.assert_allclose(bounds.upper, [np.pi, 4.0 + 2 * np.pi, -4.0])
    assert np.isinf(bounds.velocity).all()
    q, _, _ = dense_peaks(random_excitation(unknown, seed=0, margin=1.0))
    assert (q >= bounds.lower - 1e-9).all()
    assert (q <= bounds.upper + 1e-9).all()


def test_infinite_positions_count_as_half_a_turn() -> None:
    """Of a joint that turns without end; the mean position was not a number."""
    endless = MotionBounds(lower=[-np.inf], upper=[np.inf], velocity=[1.0], acceleration=[2.0])
    half_a_turn = replace(endless, lower=[-np.pi], upper=[np.pi])
    assert random_excitation(endless, seed=0) == random_excitation(half_a_turn, seed=0)


def test_a_joint_without_room_stands_still() -> None:
    fixed = MotionBounds(lower=[0.3], upper=[0.3], velocity=[1.0], acceleration=[1.0])
    series = random_excitation(fixed, seed=0)
    np.testing.assert_allclose(series.evaluate(np.linspace(0, 10, 50)).q, 0.3, rtol=0, atol=1e-12)


def test_refuses_what_cannot_be() -> None:
    with pytest.raises(InputError, match="margin"):
        random_excitation(UR5, seed=0, margin=1.5)
    for harmonics in (1, 4.5):
        with pytest.raises(InputError, match="harmonics of a motion from rest"):
            random_excitation(UR5, seed=0, harmonics=harmonics)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="period"):
        random_excitation(UR5, seed=0, period_s=-1.0)
    with pytest.raises(InputError, match="joint 2: the mean position"):
        random_excitation(UR5, seed=0, offset=[0, 9, 0, 0, 0, 0])
    with pytest.raises(InputError, match="acceleration"):
        random_excitation(UR5, seed=0, acceleration=[1.0, 2.0])
    with pytest.raises(InputError, match="above the upper"):
        MotionBounds(lower=[1.0], upper=[0.0], velocity=[1.0], acceleration=[1.0])
    with pytest.raises(InputError, match="positive"):
        MotionBounds(lower=[0.0], upper=[1.0], velocity=[-1.0], acceleration=[1.0])
