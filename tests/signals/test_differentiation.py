from collections.abc import Callable

import numpy as np
import pytest

from dynid.core import InputError
from dynid.signals import ProcessingSettings, derivative
from dynid.signals.filters import fourier_derivative

ORDER = 0.05
"""How far a fitted order of convergence may be from a whole number."""
EXACT = 1e-12
POLYNOMIAL = 1e-9


def _order(error: Callable[[float], float], rates: tuple[float, ...]) -> float:
    slope = np.polyfit(np.log([1 / rate for rate in rates]), np.log([error(r) for r in rates]), 1)
    return float(slope[0])


def _error(rate: float, part: slice) -> float:
    t = np.arange(int(4 * rate) + 1) / rate
    values = np.sin(3 * t + 0.3)[:, None]
    slope = derivative(values, rate, "central", 10.0)[:, 0]
    return float(np.abs(slope - 3 * np.cos(3 * t + 0.3))[part].max())


def test_central_differences_are_of_fourth_order_inside_and_second_at_the_ends() -> None:
    rates = (25.0, 50.0, 100.0, 200.0)
    assert _order(lambda rate: _error(rate, slice(2, -2)), rates) == pytest.approx(4, abs=ORDER)
    fine = (200.0, 400.0, 800.0, 1600.0)
    for end in (slice(0, 1), slice(-1, None), slice(1, 2), slice(-2, -1)):
        assert _order(lambda rate, end=end: _error(rate, end), fine) == pytest.approx(2, abs=ORDER)


@pytest.mark.parametrize(("method", "degree"), [("central", 4), ("savgol", 3)])
def test_polynomials_are_differentiated_exactly_inside(method: str, degree: int) -> None:
    t = np.arange(120) / 40.0
    factors = np.random.default_rng(1).normal(size=(degree + 1, 3))
    values = np.polynomial.polynomial.polyval(t, factors).T
    slopes = np.polynomial.polynomial.polyval(t, np.polynomial.polynomial.polyder(factors)).T
    found = derivative(values, 40.0, method, 5.0)
    inside = slice(2, -2) if method == "central" else slice(None)
    scale = np.abs(slopes).max()
    np.testing.assert_allclose(found[inside], slopes[inside], rtol=0, atol=POLYNOMIAL * scale)


def test_savitzky_golay_averages_noise_over_a_period_of_the_cut_off() -> None:
    noise = np.random.default_rng(2).normal(size=(4000, 1))
    rate = 500.0
    loud = derivative(noise, rate, "central", 10.0).std()
    quiet = [derivative(noise, rate, "savgol", cutoff).std() for cutoff in (50.0, 10.0, 2.0)]
    assert loud > quiet[0] > quiet[1] > quiet[2]
    # Variance of the slope of a cubic fitted to m points falls with m^3.
    assert quiet[1] / quiet[2] == pytest.approx(5**1.5, rel=0.2)


def test_the_least_cubic_is_that_of_five_samples() -> None:
    """Fitted to fewer it would be any; to five, it has the differences of fourth order."""
    values = np.random.default_rng(3).normal(size=(60, 2))
    slopes = [derivative(values, 100.0, method, 40.0)[2:-2] for method in ("savgol", "central")]
    np.testing.assert_allclose(*slopes, rtol=0, atol=1e-10)


@pytest.mark.parametrize("count", [7, 8, 31])
def test_savitzky_golay_fits_into_short_records(count: int) -> None:
    line = np.linspace(0, 1, count)[:, None]
    slope = derivative(line, 100.0, "savgol", 0.1)
    np.testing.assert_allclose(slope, 100 / (count - 1), rtol=1e-9, atol=0)


@pytest.mark.parametrize("count", [3, 4, 5, 6])
def test_central_differences_need_three_samples(count: int) -> None:
    t = np.arange(count) / 10
    slope = derivative((t**2)[:, None], 10.0, "central", 1.0)[:, 0]
    np.testing.assert_allclose(slope, 2 * t, rtol=0, atol=1e-12)


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(InputError, match=r"derivative; got spline; allowed: .*savgol"):
        ProcessingSettings(derivative="spline")


@pytest.mark.parametrize("count", [1250, 1251])
@pytest.mark.parametrize("harmonics", [1, 5, 40])
def test_harmonics_are_differentiated_exactly(count: int, harmonics: int) -> None:
    random = np.random.default_rng(harmonics)
    sines, cosines = random.normal(size=(2, harmonics, 2)) / harmonics
    phase = 2 * np.pi * np.outer(np.arange(count) / count, np.arange(1, harmonics + 1))
    rate = 125.0
    turn = 2 * np.pi * rate / count * np.arange(1, harmonics + 1)[:, None]
    values = 0.7 + np.sin(phase) @ sines + np.cos(phase) @ cosines
    slopes = np.cos(phase) @ (turn * sines) - np.sin(phase) @ (turn * cosines)
    smooth, found = fourier_derivative(values, rate, (harmonics + 0.5) * rate / count)
    np.testing.assert_allclose(smooth, values, rtol=0, atol=EXACT)
    np.testing.assert_allclose(found, slopes, rtol=0, atol=EXACT * np.abs(turn).max())


def test_harmonics_above_the_cut_off_are_dropped_and_those_below_kept() -> None:
    count, rate = 1000, 100.0
    t = np.arange(count) / rate
    kept, dropped = np.sin(2 * np.pi * 2 * t), np.sin(2 * np.pi * 8 * t)
    smooth, slope = fourier_derivative((kept + dropped)[:, None], rate, 5.0)
    np.testing.assert_allclose(smooth[:, 0], kept, rtol=0, atol=EXACT)
    expected = 4 * np.pi * np.cos(2 * np.pi * 2 * t)
    np.testing.assert_allclose(slope[:, 0], expected, rtol=0, atol=10 * EXACT)
    both, _ = fourier_derivative((kept + dropped)[:, None], rate, 8.0)
    np.testing.assert_allclose(both[:, 0], kept + dropped, rtol=0, atol=EXACT)
