from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.core import InputError, MotionBounds
from dynid.trajectory import Quintic, rest_to_rest

LIMITS = MotionBounds(
    lower=[-3.0, -3.0], upper=[3.0, 3.0], velocity=[1.0, 2.0], acceleration=[4.0, np.nan]
)


@given(st.lists(st.floats(-3, 3), min_size=4, max_size=4), st.floats(0.1, 1.0))
@settings(max_examples=60)
def test_respects_and_uses_the_limits(numbers: list[float], margin: float) -> None:
    start, goal = np.array(numbers[:2]), np.array(numbers[2:])
    move = rest_to_rest(start, goal, LIMITS, margin=margin)
    motion = move.evaluate(np.linspace(0, move.duration, 2001))
    dq, ddq = np.abs(motion.dq).max(axis=0), np.abs(motion.ddq).max(axis=0)
    assert (dq <= margin * LIMITS.velocity + 1e-9).all()
    assert ddq[0] <= margin * 4.0 + 1e-9
    if move.duration > 0.1:
        assert max(*(dq / LIMITS.velocity / margin), ddq[0] / 4.0 / margin) > 0.999
    np.testing.assert_array_equal(motion.q[0], start)
    np.testing.assert_array_equal(motion.q[-1], goal)
    for end in (0, -1):
        np.testing.assert_array_equal(motion.dq[end], 0)
        np.testing.assert_array_equal(motion.ddq[end], 0)


def test_derivatives_agree_with_finite_differences() -> None:
    move = Quintic(start=np.array([0.0, 1.0]), goal=np.array([2.0, -1.0]), travel_time=3.0)
    t, step = np.linspace(0.1, 2.9, 40), 1e-5
    before, now, after = (move.evaluate(t + k * step) for k in (-1, 0, 1))
    np.testing.assert_allclose(now.dq, (after.q - before.q) / (2 * step), rtol=0, atol=1e-8)
    np.testing.assert_allclose(now.ddq, (after.dq - before.dq) / (2 * step), rtol=0, atol=1e-8)


def test_stands_still_outside() -> None:
    move = Quintic(start=np.zeros(1), goal=np.ones(1), travel_time=2.0)
    motion = move.evaluate([-1.0, 5.0])
    np.testing.assert_array_equal(motion.q[:, 0], [0.0, 1.0])
    np.testing.assert_array_equal(motion.dq, 0)
    np.testing.assert_array_equal(motion.ddq, 0)


def test_no_way_takes_the_shortest_time() -> None:
    assert rest_to_rest([1.0, 1.0], [1.0, 1.0], LIMITS).duration == 0.1


def test_joints_that_turn_without_end_are_limited_by_speed_alone() -> None:
    endless = replace(LIMITS, lower=[-np.inf, -np.inf], upper=[np.inf, np.inf])
    assert rest_to_rest([0.0, 0.0], [1.0, 1.0], endless) == rest_to_rest(
        [0.0, 0.0], [1.0, 1.0], LIMITS
    )


def test_refuses_what_cannot_be() -> None:
    with pytest.raises(InputError, match="joint 2: the goal pose"):
        rest_to_rest([0.0, 0.0], [0.0, 4.0], LIMITS)
    with pytest.raises(InputError, match="margin"):
        rest_to_rest([0.0, 0.0], [0.0, 1.0], LIMITS, margin=0.0)
    with pytest.raises(InputError, match="wrong shape"):
        rest_to_rest([0.0], [0.0, 1.0], LIMITS)
    with pytest.raises(InputError, match="travel time"):
        Quintic(start=np.zeros(1), goal=np.ones(1), travel_time=0.0)
    free = MotionBounds(lower=[-1], upper=[1], velocity=[np.nan], acceleration=[np.nan])
    with pytest.raises(InputError, match="neither"):
        rest_to_rest([0.0], [1.0], free)
    assert rest_to_rest([0.0], [1.0], free, acceleration=1.0).duration > 1.0
