import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.core import InputError
from dynid.trajectory import FourierSeries, rest_basis
from rest_motions import rest_series


def some_series(seed: int = 0, joints: int = 6, harmonics: int = 5) -> FourierSeries:
    generator = np.random.default_rng(seed)
    return FourierSeries(
        period=10.0,
        offset=generator.normal(size=joints),
        a=generator.normal(size=(joints, harmonics)),
        b=generator.normal(size=(joints, harmonics)),
    )


def test_is_the_papers_formula() -> None:
    series = some_series(joints=2, harmonics=3)
    t, w = 1.234, 2 * np.pi / 10.0
    expected = series.offset.copy()
    for order in (1, 2, 3):
        expected = expected + series.a[:, order - 1] * np.sin(w * order * t)
        expected = expected - series.b[:, order - 1] * np.cos(w * order * t)
    np.testing.assert_allclose(series.evaluate([t]).q[0], expected, rtol=0, atol=1e-14)


@given(st.integers(0, 10_000), st.integers(1, 8))
@settings(max_examples=30)
def test_derivatives_agree_with_finite_differences(seed: int, harmonics: int) -> None:
    series = some_series(seed, joints=3, harmonics=harmonics)
    t = np.linspace(0.1, 9.9, 50)
    step = 1e-4
    before, now, after = (series.evaluate(t + k * step) for k in (-1, 0, 1))
    np.testing.assert_allclose(now.dq, (after.q - before.q) / (2 * step), rtol=0, atol=1e-5)
    np.testing.assert_allclose(now.ddq, (after.dq - before.dq) / (2 * step), rtol=0, atol=1e-4)


@given(st.integers(0, 10_000), st.integers(2, 12), st.floats(1.0, 60.0))
@settings(max_examples=60)
def test_rest_series_starts_and_ends_at_rest(seed: int, harmonics: int, period: float) -> None:
    free = np.random.default_rng(seed).normal(size=(6, 2 * harmonics - 2))
    series = rest_series(period, np.zeros(6), free / np.linalg.norm(free, axis=1)[:, None])
    ends = series.evaluate([0.0, period])
    assert np.abs(ends.dq).max() < 1e-12 * max(1.0, 2 * np.pi * harmonics / period)
    assert np.abs(ends.ddq).max() < 1e-12 * max(1.0, (2 * np.pi * harmonics / period) ** 2)
    np.testing.assert_array_equal(ends.q[0], ends.q[1])


def test_the_papers_series_is_at_rest_to_1e_12() -> None:
    free = np.random.default_rng(3).normal(size=(6, 8))
    ends = rest_series(10.0, np.zeros(6), free).evaluate([0.0, 10.0])
    assert np.abs(ends.dq).max() < 1e-12
    assert np.abs(ends.ddq).max() < 1e-12


@pytest.mark.parametrize("harmonics", [2, 3, 5, 9])
def test_rest_basis_is_orthonormal_and_complete(harmonics: int) -> None:
    basis = rest_basis(harmonics)
    order = np.arange(1, harmonics + 1)
    conditions = np.zeros((2, 2 * harmonics))
    conditions[0, :harmonics], conditions[1, harmonics:] = order, order**2
    assert basis.shape == (2 * harmonics, 2 * harmonics - 2)
    np.testing.assert_allclose(basis.T @ basis, np.eye(2 * harmonics - 2), rtol=0, atol=1e-14)
    np.testing.assert_allclose(conditions @ basis, 0, rtol=0, atol=1e-12)


def test_sample_leaves_the_last_end_out_and_repeats() -> None:
    series = some_series()
    motion = series.sample(125, periods=3)
    assert len(motion.t) == 3750
    np.testing.assert_allclose(motion.q[:1250], motion.q[2500:], rtol=0, atol=1e-11)
    assert motion.t[1] == 0.008


@pytest.mark.parametrize(
    "change",
    [
        {"period": 0.0},
        {"period": float("nan")},
        {"offset": np.zeros(5)},
        {"a": np.zeros((6, 4))},
        {"a": np.zeros((6, 0)), "b": np.zeros((6, 0))},
        {"b": np.full((6, 5), np.inf)},
    ],
)
def test_refuses_nonsense(change: dict[str, object]) -> None:
    good = {"period": 10.0, "offset": np.zeros(6), "a": np.zeros((6, 5)), "b": np.zeros((6, 5))}
    with pytest.raises(InputError):
        FourierSeries(**(good | change))  # type: ignore[arg-type]


def test_refuses_bad_questions() -> None:
    series = some_series()
    with pytest.raises(InputError):
        series.evaluate([0.0, float("nan")])
    with pytest.raises(InputError):
        series.sample(0.0)
    with pytest.raises(InputError):
        series.sample(125, periods=0)
    with pytest.raises(InputError):
        rest_basis(1)
    with pytest.raises(InputError):
        rest_series(10.0, np.zeros(2), np.zeros((2, 5)))
