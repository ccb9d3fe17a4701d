import numpy as np
import pytest

from dynid.core import InputError, MotionBounds
from dynid.trajectory import (
    FourierSeries,
    MotionSequence,
    Quintic,
    Repetition,
    rest_to_rest,
    through_poses,
)
from rest_motions import rest_series

LIMITS = MotionBounds(
    lower=np.full(2, -6.0), upper=np.full(2, 6.0), velocity=[2.0, 3.0], acceleration=[8.0, 9.0]
)


def some_series() -> FourierSeries:
    return rest_series(5.0, [0.3, -0.4], 0.1 * np.random.default_rng(0).normal(size=(2, 8)))


def test_periods_follow_each_other_exactly() -> None:
    series = some_series()
    repeated = Repetition(part=series, times=3)
    assert repeated.duration == 15.0
    t = np.linspace(0.0, 4.99, 77)
    once = series.evaluate(t)
    for period in range(3):
        again = repeated.evaluate(t + 5.0 * period)
        np.testing.assert_allclose(again.q, once.q, rtol=0, atol=1e-13)
        np.testing.assert_allclose(again.ddq, once.ddq, rtol=0, atol=1e-11)
    after = repeated.evaluate([15.0, 99.0])
    np.testing.assert_allclose(after.q, series.evaluate([0.0, 0.0]).q, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(after.dq[1], 0.0)


def way_and_repeats(
    series: FourierSeries, home: list[float], periods: int, margin: float = 0.25
) -> MotionSequence:
    """From a pose onto a motion, half a second at rest, then the motion several times."""
    way = rest_to_rest(home, series.evaluate([0.0]).q[0], LIMITS, margin=margin)
    rest = Quintic(start=way.goal, goal=way.goal, travel_time=0.5)
    return MotionSequence(parts=(way, rest, Repetition(part=series, times=periods)))


def test_a_way_leads_onto_the_motion_and_respects_its_limits() -> None:
    series, home = some_series(), [1.0, -1.0]
    whole = way_and_repeats(series, home, 2, margin=0.4)
    way = whole.parts[0]
    assert whole.duration == pytest.approx(way.duration + 0.5 + 10.0, abs=1e-12)
    np.testing.assert_allclose(whole.starts, [0.0, way.duration, way.duration + 0.5], atol=1e-12)
    on_the_way = whole.evaluate(np.linspace(0.0, way.duration, 500))
    assert (np.abs(on_the_way.dq) <= 0.4 * LIMITS.velocity + 1e-9).all()
    assert (np.abs(on_the_way.ddq) <= 0.4 * LIMITS.acceleration + 1e-9).all()
    np.testing.assert_array_equal(whole.evaluate([0.0]).q[0], home)
    t = np.linspace(0.0, 10.0, 33)
    np.testing.assert_allclose(
        whole.evaluate(t + way.duration + 0.5).q, series.evaluate(t).q, rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(whole.evaluate([way.duration + 0.25]).dq, 0.0, rtol=0, atol=1e-12)


def test_sequences_are_smooth_where_the_parts_meet() -> None:
    whole = way_and_repeats(some_series(), [1.0, -1.0], 3)
    for meeting in (whole.starts[1], whole.starts[2], whole.starts[2] + 5.0):
        sides = whole.evaluate([meeting - 1e-9, meeting + 1e-9])
        for name in ("q", "dq", "ddq"):
            value = getattr(sides, name)
            np.testing.assert_allclose(value[0], value[1], rtol=0, atol=1e-6, err_msg=name)


def test_a_path_through_poses_rests_in_each() -> None:
    poses = np.array([[0.0, 0.0], [1.0, -2.0], [0.5, 0.5], [0.5, 0.6]])
    path = through_poses(poses, LIMITS, margin=0.9)
    assert isinstance(path, MotionSequence)
    meetings = path.evaluate([*path.starts, path.duration])
    np.testing.assert_allclose(meetings.q, poses, rtol=0, atol=1e-12)
    np.testing.assert_allclose(meetings.dq, 0.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(meetings.ddq, 0.0, rtol=0, atol=1e-12)
    motion = path.evaluate(np.linspace(0.0, path.duration, 3000))
    assert (np.abs(motion.dq) <= 0.9 * LIMITS.velocity + 1e-9).all()
    assert isinstance(through_poses(poses[:2], LIMITS), Quintic)


def test_derivatives_agree_with_central_differences() -> None:
    whole, step = way_and_repeats(some_series(), [1.0, -1.0], 2), 1e-5
    t = np.linspace(0.011, whole.duration - 0.011, 97)
    before, now, after = (whole.evaluate(t + k * step) for k in (-1, 0, 1))
    np.testing.assert_allclose(now.dq, (after.q - before.q) / (2 * step), rtol=0, atol=1e-7)
    np.testing.assert_allclose(now.ddq, (after.dq - before.dq) / (2 * step), rtol=0, atol=1e-6)


def test_refuses_motions_that_do_not_meet() -> None:
    series, moving = some_series(), FourierSeries(period=1.0, offset=[0], a=[[1.0]], b=[[0.0]])
    stay = Quintic(start=[0.0], goal=[0.0], travel_time=1.0)
    with pytest.raises(InputError, match="velocity jumps"):
        MotionSequence(parts=(stay, moving))
    with pytest.raises(InputError, match="joint 1: the position jumps"):
        MotionSequence(parts=(stay, Quintic(start=[0.1], goal=[0.0], travel_time=1.0)))
    with pytest.raises(InputError, match="joints of the motion"):
        MotionSequence(parts=(stay, series))
    with pytest.raises(InputError, match="needs a part"):
        MotionSequence(parts=())
    with pytest.raises(InputError, match="the position jumps"):
        Repetition(part=Quintic(start=[0.1], goal=[0.0], travel_time=1.0), times=2)
    with pytest.raises(InputError, match="repetitions"):
        Repetition(part=series, times=0)
    with pytest.raises(InputError, match="whole number"):
        Repetition(part=series, times=1.5)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="two poses"):
        through_poses([[0.0, 0.0]], LIMITS)
    with pytest.raises(InputError, match="outside the position limits"):
        rest_to_rest([0.0, 9.0], [0.0, 0.0], LIMITS)
