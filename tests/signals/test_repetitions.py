from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from dynid.core import InputError
from dynid.signals import UniformSignals, find_period, fold_periods

CHANCE = 1e-6
"""How often a correct noise estimate may fall outside its bounds."""
EXACT = 1e-12


def _series(phase: np.ndarray, seed: int, joints: int = 3, harmonics: int = 5) -> np.ndarray:
    """A Fourier series of a phase in periods, all harmonics equally fast."""
    random = np.random.default_rng(seed)
    sines, cosines = random.normal(size=(2, harmonics, joints))
    orders = np.arange(1, harmonics + 1)
    angle = 2 * np.pi * np.outer(phase, orders)
    return np.sin(angle) @ (sines / orders[:, None]) + np.cos(angle) @ (cosines / orders[:, None])


@given(
    length=st.integers(150, 700),
    repeats=st.integers(2, 4),
    rest=st.floats(0, 0.99),
    seed=st.integers(0, 2**31),
    noise=st.sampled_from([0.0, 1e-4, 1e-3]),
)
@settings(derandomize=True, max_examples=40)
def test_the_period_is_found_to_the_sample(
    length: int, repeats: int, rest: float, seed: int, noise: float
) -> None:
    count = int(length * (repeats + rest))
    q = _series(np.arange(count) / length, seed)
    q += noise * np.random.default_rng(seed).normal(size=q.shape)
    assert find_period(q, 125.0) == length / 125.0


@pytest.mark.parametrize(("rate", "period"), [(50.0, 100.0), (125.0, 10.0), (500.0, 20.0)])
def test_slow_and_fast_periods_are_found_alike(rate: float, period: float) -> None:
    t = np.arange(int(2.2 * period * rate)) / rate
    q = _series(t / period, seed=5, harmonics=2)
    assert find_period(q, rate) == period


def test_half_a_sample_more_a_period_adds_up() -> None:
    """Ten periods of 1000.5 samples were averaged as ten of 1000, the last 5 samples late."""
    q = _series(np.arange(10_005) / 1000.5, seed=5)
    assert find_period(q, 50.0) is None


def test_a_strong_overtone_is_not_the_period() -> None:
    t = np.arange(2600) / 125.0
    q = (np.sin(2 * np.pi * t / 5) + 0.05 * np.sin(2 * np.pi * t / 10))[:, None]
    assert find_period(q, 125.0) == 10.0


def test_joints_of_different_periods_repeat_together() -> None:
    t = np.arange(2000) / 100.0
    q = np.column_stack([np.sin(2 * np.pi * t / 2), np.sin(2 * np.pi * t / 3)])
    assert find_period(q[:, :1], 100.0) == 2.0
    assert find_period(q[:, 1:], 100.0) == 3.0
    assert find_period(q, 100.0) == 6.0


def test_joints_at_rest_have_no_say() -> None:
    t = np.arange(900) / 100.0
    still = 2e-5 * np.random.default_rng(1).normal(size=(900, 2))
    assert find_period(np.hstack([np.sin(np.pi * t)[:, None], still]), 100.0) == 2.0


def test_two_repetitions_are_enough_and_less_is_not() -> None:
    q = _series(np.arange(1500) / 500, seed=2)
    assert find_period(q[:1000], 100.0) == 5.0
    assert find_period(q[:960], 100.0) is None


def _sweep(t: np.ndarray) -> np.ndarray:
    return np.sin(2 * np.pi * (0.2 * t + 0.01 * t**2))[:, None]


@pytest.mark.parametrize(
    "motion",
    [
        pytest.param(_sweep, id="sweep"),
        pytest.param(lambda t: t[:, None], id="straight"),
        pytest.param(lambda t: (np.exp(-t / 10) * np.sin(2 * t))[:, None], id="decay"),
        pytest.param(
            lambda t: np.column_stack([np.sin(t), np.sin(np.sqrt(2) * t)]), id="never together"
        ),
        pytest.param(
            lambda t: np.cumsum(np.random.default_rng(1).normal(size=(len(t), 2)), axis=0),
            id="random walk",
        ),
        pytest.param(
            lambda t: np.where(t < 10, np.sin(np.pi * t), 0.8 * np.sin(np.pi * t))[:, None],
            id="smaller the second time",
        ),
        pytest.param(lambda t: np.zeros((len(t), 2)), id="rest"),
    ],
)
def test_what_does_not_repeat_has_no_period(motion) -> None:  # type: ignore[no-untyped-def]
    assert find_period(motion(np.arange(2000) / 100.0), 100.0) is None


def test_a_handful_of_samples_has_no_period() -> None:
    assert find_period(np.sin(np.arange(60))[:, None], 10.0) is None


LENGTH = 500


def _repeated(repeats: float, noise: float = 0.0, seed: int = 1) -> UniformSignals:
    count = int(LENGTH * repeats)
    phase = np.arange(count) / LENGTH
    q = _series(phase, seed=7)
    random = np.random.default_rng(seed)
    torque = 10 * _series(phase, seed=8) + noise * random.normal(size=(count, 3))
    return UniformSignals(
        t=5 + np.arange(count) / 100.0,
        rate_hz=100.0,
        q=q,
        qd=_series(phase, seed=9),
        torque=torque,
        valid=np.ones(count),
    )


def test_repetitions_become_one_and_the_rest_is_left() -> None:
    whole = _repeated(3.7)
    one = fold_periods(whole, 5.0)
    np.testing.assert_array_equal(one.t, whole.t[:LENGTH])
    assert one.qd is not None
    assert whole.qd is not None
    for mean, first in ((one.q, whole.q), (one.qd, whole.qd), (one.torque, whole.torque)):
        np.testing.assert_allclose(mean, first[:LENGTH], rtol=0, atol=EXACT * 100)
    assert one.valid.all()
    assert fold_periods(replace(whole, qd=None), 5.0).qd is None


@pytest.mark.parametrize("repeats", [2, 3, 8])
def test_scatter_is_the_noise_of_the_mean(repeats: int) -> None:
    noise = np.array([0.5, 2.0, 0.1])
    signals = _repeated(repeats, noise=1.0)
    truth = _repeated(1).torque
    clean = np.tile(truth, (repeats, 1))
    signals = replace(signals, torque=clean + noise * (signals.torque - clean))
    one = fold_periods(signals, 5.0)
    assert one.noise is not None
    freedom = LENGTH * (repeats - 1)
    low, high = chi2.ppf([CHANCE / 6, 1 - CHANCE / 6], freedom) / freedom
    ratio = np.square(one.noise) * repeats / np.square(noise)
    assert ((low < ratio) & (ratio < high)).all()
    # And that is how far the mean really is from the truth.
    low, high = chi2.ppf([CHANCE / 6, 1 - CHANCE / 6], LENGTH) / LENGTH
    real = np.square(one.torque - truth).mean(axis=0) * repeats / np.square(noise)
    assert ((low < real) & (real < high)).all()


def test_what_changes_slowly_between_repetitions_is_no_noise() -> None:
    """As a payload that is carried in some of them, or friction that becomes less."""
    whole = _repeated(4, noise=0.3)
    carried = np.repeat([0.0, 1.0, 1.0, 0.0], LENGTH)[:, None]
    added = 2 * np.sin(2 * np.pi * np.arange(4 * LENGTH)[:, None] / LENGTH + np.arange(3))
    one = fold_periods(replace(whole, torque=whole.torque + carried * added), 5.0)
    assert one.noise is not None
    assert one.changed is not None
    np.testing.assert_allclose(one.noise, 0.3 / np.sqrt(4), rtol=0.1, atol=0)
    # Two of four: a variance of a third.
    size = np.sqrt(np.square(added).mean(axis=0) / 3)
    np.testing.assert_allclose(one.changed, size, rtol=0.05, atol=0)
    steady = fold_periods(whole, 5.0)
    assert steady.changed is not None
    assert (steady.changed < 0.1 * one.changed).all()


def test_one_period_knows_no_noise() -> None:
    assert fold_periods(_repeated(1.5), 5.0).noise is None


def test_what_lies_in_a_gap_does_not_count() -> None:
    whole = _repeated(3, noise=0.3)
    gap = slice(LENGTH + 100, LENGTH + 150)
    torn = replace(whole, torque=whole.torque.copy(), valid=whole.valid.copy(), q=whole.q.copy())
    torn.torque[gap] = torn.q[gap] = 1e6
    torn.valid[gap] = 0.0
    one = fold_periods(torn, 5.0)
    assert one.valid.all()
    kept = [whole.torque[100:150], whole.torque[2 * LENGTH + 100 : 2 * LENGTH + 150]]
    np.testing.assert_allclose(one.torque[100:150], np.mean(kept, axis=0), rtol=EXACT, atol=0)
    np.testing.assert_allclose(one.q[100:150], whole.q[100:150], rtol=0, atol=EXACT * 100)
    complete = fold_periods(whole, 5.0)
    np.testing.assert_allclose(one.torque[150:], complete.torque[150:], rtol=EXACT, atol=0)
    assert one.noise is not None
    np.testing.assert_allclose(one.noise, 0.3 / np.sqrt(3), rtol=0.1, atol=0)


def test_friction_from_before_the_first_repetition_does_not_count() -> None:
    whole = _repeated(3)
    q = 0.2 * whole.q
    q[:, 1] = q[0, 1]
    away = np.abs(q - q[0])
    # Joint 1 moves by enough, joint 2 never does, joint 3 by 0.04 in all.
    q[:, 2] = q[0, 2] + 0.04 * (q[:, 2] - q[0, 2]) / away[:, 2].max()
    other = np.zeros_like(whole.torque)
    first = np.argmax(np.abs(q - q[0]) >= np.array([0.06, np.inf, 0.02]), axis=0)
    assert 0 < first[0] < first[2] < LENGTH
    for joint in (0, 2):
        other[: first[joint], joint] = 3.0
    whole = replace(whole, q=q)
    one = fold_periods(replace(whole, torque=whole.torque + other), 5.0)
    np.testing.assert_allclose(one.torque, whole.torque[:LENGTH], rtol=0, atol=EXACT * 100)
    assert one.noise is not None
    assert (one.noise < EXACT * 100).all()
    # From there on, and from the beginning where a joint never moves, it counts as any other.
    late = np.zeros_like(whole.torque)
    for joint in range(3):
        late[(first[joint] if joint != 1 else 0) : LENGTH, joint] = 3.0
    one = fold_periods(replace(whole, torque=whole.torque + late), 5.0)
    expected = whole.torque[:LENGTH] + late[:LENGTH] / 3
    np.testing.assert_allclose(one.torque, expected, rtol=0, atol=EXACT * 100)
    # Where the other repetitions have gaps, it is all that is known.
    torn = replace(whole, valid=np.where(np.arange(3 * LENGTH) % LENGTH < 2, 0.0, 1.0))
    torn.valid[:2] = 1.0
    one = fold_periods(replace(torn, torque=whole.torque + other), 5.0)
    np.testing.assert_allclose(one.torque[:2, 0], whole.torque[:2, 0] + 3, rtol=0, atol=1e-9)


def test_where_every_repetition_has_a_gap_nothing_is_valid() -> None:
    whole = _repeated(2)
    torn = replace(whole, valid=np.where(np.arange(2 * LENGTH) % LENGTH < 20, 0.0, 1.0))
    one = fold_periods(torn, 5.0)
    np.testing.assert_array_equal(one.valid, np.where(np.arange(LENGTH) < 20, 0.0, 1.0))
    # The period stays whole: what bridged the gap stands in for it.
    np.testing.assert_allclose(one.q, whole.q[:LENGTH], rtol=0, atol=EXACT * 100)


def test_a_long_period_may_be_off_by_a_millionth() -> None:
    """Its decimals are worth no more: 5000 samples, by 0.004 and by 0.006 of one."""
    signals = replace(_repeated(20), rate_hz=1000.0)
    assert len(fold_periods(signals, 5.000_004).t) == 5000
    with pytest.raises(InputError, match=r"not a whole number"):
        fold_periods(signals, 5.000_006)


@pytest.mark.parametrize(
    ("period", "message"),
    [
        (5.003, "not a whole number of samples; got 500.3"),
        (0.01, "not a whole number of samples"),
        (20.0, "shorter than its period; got 20"),
    ],
)
def test_periods_that_do_not_fit_are_refused(period: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        fold_periods(_repeated(3), period)
