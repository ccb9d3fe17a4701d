"""Plans and the slow pass: the same path, whole cycles, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.core import InputError
from dynid.experiment import ExperimentPlan
from dynid.experiment.plan import slowed, whole_cycles_share
from dynid.robot import load_robot
from dynid.trajectory import (
    BSpline,
    FourierSeries,
    MotionSequence,
    Quintic,
    Repetition,
    Trajectory,
)
from rest_motions import rest_series

UR5 = load_robot("ur5")
FREE = 0.1 * np.random.default_rng(0).normal(size=(6, 8))
SERIES = rest_series(10.0, np.zeros(6), FREE)
POSES = np.random.default_rng(1).normal(size=(3, 6))
THERE = Quintic(start=POSES[0], goal=POSES[1], travel_time=2.0)
BACK = Quintic(start=POSES[1], goal=POSES[0], travel_time=3.0)
CONTROL = np.repeat(POSES[0][:, None], 12, axis=1)
CONTROL[:, 3:9] += np.random.default_rng(2).normal(size=(6, 6))
MOTIONS: tuple[Trajectory, ...] = (
    SERIES,
    THERE,
    BSpline(travel_time=4.0, control=CONTROL),
    MotionSequence(parts=(THERE, BACK)),
    Repetition(part=MotionSequence(parts=(THERE, BACK)), times=2),
)


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda motion: type(motion).__name__)
@pytest.mark.parametrize("share", [0.2, 0.77, 1.0])
def test_the_slow_pass_takes_the_same_path(motion: Trajectory, share: float) -> None:
    slow = slowed(motion, share)
    assert type(slow) is type(motion)
    assert slow.duration == pytest.approx(motion.duration / share, rel=1e-12)
    t = np.linspace(0.0, motion.duration, 101)
    fast, late = motion.evaluate(t), slow.evaluate(t / share)
    inner = slice(1, -1)
    np.testing.assert_allclose(late.q, fast.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(late.dq[inner], share * fast.dq[inner], rtol=0, atol=1e-8)
    np.testing.assert_allclose(late.ddq[inner], share**2 * fast.ddq[inner], rtol=0, atol=1e-7)


def test_a_motion_that_carries_no_time_cannot_be_slowed() -> None:
    class Own(Trajectory):
        joints, duration = 6, 10.0

        def evaluate(self, t):
            return SERIES.evaluate(t)

    with pytest.raises(InputError, match="cannot be slowed"):
        slowed(Own(), 0.5)


@given(cycles=st.integers(2, 5000), share=st.floats(0.05, 1.0))
@settings(max_examples=200)
def test_slow_periods_are_whole_cycles_and_never_faster(cycles: int, share: float) -> None:
    duration = cycles / 125.0
    found = whole_cycles_share(duration, share, 125.0)
    assert found <= share * (1 + 1e-6)
    slow = duration / found * 125.0
    assert abs(slow - round(slow)) < 1e-6
    assert round(slow) - cycles / share < 1.0 + 1e-6


@pytest.mark.parametrize("share", [0.0, -0.2, 1.5, float("nan")])
def test_shares_out_of_range_are_refused(share: float) -> None:
    with pytest.raises(InputError, match="share"):
        slowed(SERIES, share)
    with pytest.raises(InputError, match="share"):
        ExperimentPlan(robot=UR5, trajectory=SERIES, slow=share)


def test_passes_come_in_their_order() -> None:
    plan = ExperimentPlan(
        robot=UR5, trajectory=SERIES, periods=2, settle=True, slow=0.2, warm_up_s=25.0
    )
    slow, warm, run = plan.passes()
    assert [step.name for step in plan.passes()] == ["slow", "warm-up", "run"]
    assert slow.execution.cycles == 5 * 1250
    assert (warm.execution.periods, warm.execution.settle) == (3, 0)
    assert (run.execution.periods, run.execution.settle) == (2, 1)
    assert run.execution.first_recorded == 1250
    assert run.execution.total == 3750
    assert len(ExperimentPlan(robot=UR5, trajectory=SERIES).passes()) == 1


def test_the_watchdogs_limits_lie_just_beyond_the_robots() -> None:
    limits = ExperimentPlan(robot=UR5, trajectory=SERIES).passes()[0].execution.limits
    for beyond in (UR5.limits.lower - limits.lower, limits.upper - UR5.limits.upper):
        assert ((beyond > 0) & (beyond < 0.03)).all()
    assert (limits.velocity > UR5.limits.velocity).all()
    assert (limits.velocity < 1.2 * UR5.limits.velocity).all()


@pytest.mark.parametrize("period", [10.003, 10.000005])
def test_a_period_of_no_whole_cycles_is_refused(period: float) -> None:
    """By the plan, not by the driver after the slow pass."""
    odd = replace(SERIES, period=period)
    with pytest.raises(InputError, match="whole number of control cycles"):
        ExperimentPlan(robot=UR5, trajectory=odd)


def test_part_of_a_period_is_refused() -> None:
    """The arm would be stopped in motion, or jump to the end of the period."""
    half = ExperimentPlan(robot=UR5, trajectory=SERIES, periods=1.5)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="whole number"):
        half.passes()


def test_a_motion_that_does_not_rest_at_its_ends_is_refused() -> None:
    moving = FourierSeries(period=10.0, offset=np.zeros(6), a=FREE[:, :2], b=FREE[:, 2:4])
    with pytest.raises(InputError, match="at rest"):
        ExperimentPlan(robot=UR5, trajectory=moving)


def test_a_motion_that_ends_elsewhere_can_run_once_alone() -> None:
    assert not ExperimentPlan(robot=UR5, trajectory=THERE, periods=1).repeats
    for more in ({}, {"settle": True}, {"slow": 0.5}, {"warm_up_s": 5.0}):
        with pytest.raises(InputError, match="repeat 1"):
            ExperimentPlan(robot=UR5, trajectory=THERE, **{"periods": 1 if more else 3, **more})


def test_other_joints_are_refused() -> None:
    five = rest_series(10.0, np.zeros(5), FREE[:5])
    with pytest.raises(InputError, match="5 joints"):
        ExperimentPlan(robot=UR5, trajectory=five)
