import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import interpolate

from dynid.core import InputError
from dynid.trajectory import BSpline, BSplineFamily

# Relative to the largest value: SciPy's de Boor recursion sums in another order.
SCIPY = 1e-12


@given(st.integers(0, 10_000), st.integers(3, 6), st.integers(1, 12), st.floats(0.5, 60.0))
@settings(max_examples=50)
def test_is_scipys_spline(seed: int, degree: int, spans: int, duration: float) -> None:
    control = np.random.default_rng(seed).normal(size=(3, degree + spans))
    spline = BSpline(travel_time=duration, control=control, degree=degree)
    t = np.linspace(0.0, duration, 101)
    motion = spline.evaluate(t)
    inner = np.linspace(0.0, duration, spans + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.full(degree, duration)])
    theirs = interpolate.BSpline(knots, control.T, degree)
    for name, order in (("q", 0), ("dq", 1), ("ddq", 2)):
        expected = theirs.derivative(order)(t) if order else theirs(t)
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(
            getattr(motion, name), expected, rtol=0, atol=SCIPY * scale, err_msg=name
        )


@given(st.integers(0, 10_000), st.integers(1, 30), st.floats(0.5, 60.0))
@settings(max_examples=50)
def test_the_family_rests_exactly(seed: int, points: int, duration: float) -> None:
    generator = np.random.default_rng(seed)
    pose = generator.normal(size=4)
    spline = BSplineFamily(duration=duration, order=points).trajectory(
        pose, generator.normal(size=(4, points))
    )
    ends = spline.evaluate([0.0, duration])
    np.testing.assert_array_equal(ends.q, [pose, pose])
    np.testing.assert_array_equal(ends.dq, 0.0)
    np.testing.assert_array_equal(ends.ddq, 0.0)


def test_stands_still_outside() -> None:
    spline = BSpline(travel_time=2.0, control=[[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]])
    motion = spline.evaluate([-1.0, 3.0])
    np.testing.assert_array_equal(motion.q[:, 0], [0.0, 5.0])
    np.testing.assert_array_equal(motion.dq, 0.0)
    assert spline.evaluate([0.0]).dq[0, 0] > 1.0


@pytest.mark.parametrize(
    "change",
    [
        {"travel_time": 0.0},
        {"degree": 2},
        {"control": np.zeros((2, 5))},
        {"control": np.zeros((0, 9))},
        {"control": np.full((2, 9), np.nan)},
        {"control": np.zeros(9)},
    ],
)
def test_refuses_nonsense(change: dict[str, object]) -> None:
    with pytest.raises(InputError):
        BSpline(**({"travel_time": 1.0, "control": np.zeros((2, 9))} | change))  # type: ignore[arg-type]
