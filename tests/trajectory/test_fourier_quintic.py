import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from dynid.core import Array, InputError
from dynid.trajectory import FourierQuintic

AT_THE_ENDS = 1e-12


def some_motion(seed: int, harmonics: int = 5, period: float = 10.0) -> FourierQuintic:
    generator = np.random.default_rng(seed)
    return FourierQuintic(
        period=period,
        start=generator.normal(size=6),
        goal=generator.normal(size=6),
        a=0.2 * generator.normal(size=(6, harmonics)),
        b=0.2 * generator.normal(size=(6, harmonics)),
    )


@given(st.integers(0, 10_000), st.integers(1, 10), st.floats(2.0, 60.0))
@settings(max_examples=60)
def test_ends_at_the_given_poses_at_rest(seed: int, harmonics: int, period: float) -> None:
    motion = some_motion(seed, harmonics, period)
    t = np.linspace(0.0, period, 301)
    inside, ends = motion.evaluate(t), motion.evaluate([0.0, period])
    np.testing.assert_allclose(ends.q, [motion.start, motion.goal], rtol=0, atol=AT_THE_ENDS)
    for name in ("dq", "ddq"):
        scale = max(1.0, np.abs(getattr(inside, name)).max())
        assert np.abs(getattr(ends, name)).max() < AT_THE_ENDS * scale


def solved_polynomial(motion: FourierQuintic, joint: int) -> Polynomial:
    """The six coefficients by solving the six end conditions, nothing shared with the product."""
    period, w = motion.period, 2 * np.pi / motion.period
    order = np.arange(1, motion.harmonics + 1)
    a, b = motion.a[joint], motion.b[joint]

    def series(t: float) -> Array:
        sine, cosine = np.sin(order * w * t), np.cos(order * w * t)
        return np.array(
            [
                a @ sine - b @ cosine,
                (a * order * w) @ cosine + (b * order * w) @ sine,
                -(a * (order * w) ** 2) @ sine + (b * (order * w) ** 2) @ cosine,
            ]
        )

    rows = [
        [np.polynomial.polynomial.Polynomial.basis(k).deriv(m)(t) if m else t**k for k in range(6)]
        for t in (0.0, period)
        for m in range(3)
    ]
    asked = np.array([motion.start[joint], 0, 0, motion.goal[joint], 0, 0])
    return Polynomial(
        np.linalg.solve(np.array(rows), asked - np.concatenate([series(0.0), series(period)]))
    )


def test_the_polynomial_is_the_solution_of_the_six_conditions() -> None:
    motion = some_motion(4)
    t = np.linspace(0.0, 10.0, 57)
    w, order = 2 * np.pi / 10.0, np.arange(1, 6)
    got = motion.evaluate(t)
    for joint in range(6):
        solved = solved_polynomial(motion, joint)
        series = (
            np.sin(np.outer(t, order * w)) @ motion.a[joint]
            - np.cos(np.outer(t, order * w)) @ motion.b[joint]
        )
        np.testing.assert_allclose(got.q[:, joint], series + solved(t), rtol=0, atol=1e-11)
        mine = Polynomial(motion.polynomial()[joint])
        np.testing.assert_allclose(mine(t / 10.0), solved(t), rtol=0, atol=1e-11)


@given(st.integers(0, 10_000))
@settings(max_examples=20)
def test_derivatives_agree_with_central_differences(seed: int) -> None:
    motion, step = some_motion(seed), 1e-5
    t = np.linspace(0.1, 9.9, 50)
    before, now, after = (motion.evaluate(t + k * step) for k in (-1, 0, 1))
    np.testing.assert_allclose(now.dq, (after.q - before.q) / (2 * step), rtol=0, atol=1e-7)
    np.testing.assert_allclose(now.ddq, (after.dq - before.dq) / (2 * step), rtol=0, atol=1e-7)


def test_stands_still_outside() -> None:
    motion = some_motion(0)
    outside = motion.evaluate([-2.0, 12.0])
    np.testing.assert_allclose(outside.q, [motion.start, motion.goal], rtol=0, atol=AT_THE_ENDS)
    assert np.abs(outside.dq).max() < AT_THE_ENDS


@pytest.mark.parametrize(
    "change",
    [
        {"period": -1.0},
        {"goal": np.zeros(3)},
        {"a": np.zeros((2, 0)), "b": np.zeros((2, 0))},
        {"b": np.zeros((2, 4))},
        {"start": np.full(2, np.nan)},
    ],
)
def test_refuses_nonsense(change: dict[str, object]) -> None:
    good = {
        "period": 1.0,
        "start": np.zeros(2),
        "goal": np.zeros(2),
        "a": np.zeros((2, 3)),
        "b": np.zeros((2, 3)),
    }
    with pytest.raises(InputError):
        FourierQuintic(**(good | change))  # type: ignore[arg-type]
