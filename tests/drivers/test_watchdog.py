"""Each cause of a stop, alone and in the order in which causes explain each other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.core import InputError
from dynid.drivers import Abort, Cycle, Watchdog, WatchLimits
from dynid.experiment.plan import watch_limits
from dynid.robot import load_robot

LIMITS = WatchLimits(
    lower=np.array([-1.0, np.nan]),
    upper=np.array([1.0, np.nan]),
    velocity=np.array([2.0, np.nan]),
    deviation=np.array([0.1, 0.1]),
)
TOTAL = 20
ZERO = np.zeros(2)


def cycle(k: int, **changes: object) -> Cycle:
    good = Cycle(timestamp=60.0 + 0.008 * k, index=k, q=ZERO, qd=ZERO, target_q=ZERO)
    return replace(good, **changes)  # pyright: ignore[reportArgumentType]


def watch(cycles: list[Cycle], **options: Any) -> Abort | None:
    watchdog = Watchdog(LIMITS, 125.0, TOTAL, **options)
    for one in cycles:
        if abort := watchdog.see(one):
            return abort
    return None


def run_with(bad: Cycle, at: int = 5) -> Abort | None:
    return watch([*(cycle(k) for k in range(at)), bad])


def test_a_whole_motion_passes() -> None:
    watchdog = Watchdog(LIMITS, 125.0, TOTAL)
    approach = [cycle(k - 10, index=-1) for k in range(9)]
    for one in [*approach, *(cycle(k) for k in range(TOTAL))]:
        assert watchdog.see(one) is None
    assert watchdog.finished
    # Our program counts one further, then ends.
    assert watchdog.see(cycle(TOTAL)) is None
    assert watchdog.see(cycle(TOTAL + 1, index=TOTAL, runtime_state=1)) is None


WAY = np.array([[0.0, 0.0], [0.4, 0.0], [0.4, 0.8]])
"""Where the arm stands, a way point and the first set point."""


def on_the_way(targets: list[list[float]]) -> list[Cycle]:
    return [
        cycle(k - len(targets), index=-1, target_q=np.array(at), q=np.array(at))
        for k, at in enumerate(targets)
    ]


def test_the_way_to_the_start_is_watched() -> None:
    there = [[0.0, 0.0], [0.2, 0.0], [0.4, 0.0], [0.4, 0.5], [0.4, 0.8]]
    assert watch(on_the_way(there), way=WAY) is None
    for elsewhere in ([0.2, 0.1], [-0.1, 0.0], [0.4, 0.9]):
        abort = watch(on_the_way([*there[:2], elsewhere]), way=WAY)
        assert abort is not None
        assert abort.code == "program"
        assert "another program" in abort.message
    # It was moved between the check of its way, or the pass before, and this motion.
    for way in (WAY, np.stack([ZERO, ZERO])):
        abort = watch(on_the_way([[0.0, 0.05]]), way=way)
        assert abort is not None
        assert "0.05 rad off its way" in abort.message
    # Whose way nobody knows comes from where it stands.
    assert watch(on_the_way([[0.0, 0.05], [0.2, 0.425]]), way=WAY[2:]) is None
    # Nobody waits for ever for a program that stands still.
    abort = watch(on_the_way([[0.2, 0.0]] * (125 * 60)), way=WAY)
    assert abort is not None
    assert "not arriving" in abort.message
    assert watch(on_the_way([[0.2, 0.0]] * (125 * 15)), way=WAY) is None


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"timestamp": 60.0 + 0.008 * 6}, "gap", "16.0 ms after sample 4"),
        ({"timestamp": 60.0 + 0.008 * 4}, "gap", "gap"),
        ({"timestamp": float("nan")}, "gap", "nan ms"),
        ({"timestamp": float("inf")}, "gap", "inf ms"),
        ({"index": 6}, "index", "6, where 5 was due"),
        ({"index": 4}, "index", "4, where 5 was due"),
        ({"robot_mode": 5}, "mode", "idle"),
        ({"robot_mode": 77}, "mode", "unknown"),
        ({"safety_mode": 3}, "safety", "protective stop"),
        ({"safety_mode": 2}, "safety", "reduced"),
        ({"runtime_state": 1}, "program", "the network is slow or loses packets"),
        ({"freedrive": True}, "mode", "teach button"),
        ({"runtime_state": 4}, "program", "someone paused it"),
        ({"speed_scaling": 0.9}, "speed", "90 %"),
        ({"speed_scaling": float("nan")}, "speed", "nan"),
        ({"speed_fraction": 0.5}, "speed", "slider was moved to 50 %"),
        ({"q": np.array([1.01, 0.0]), "target_q": np.array([1.01, 0.0])}, "limit", "joint 1"),
        ({"qd": np.array([-2.1, 9.0])}, "limit", "-2.1 rad/s"),
        ({"qd": np.array([0.0, np.nan])}, "limit", "joint 2"),
        ({"q": np.array([0.0, 0.2])}, "deviation", "joint 2"),
        ({"q": np.array([0.0, np.nan])}, "deviation", "joint 2"),
    ],
)
def test_each_cause_stops_the_motion(changes: dict[str, object], code: str, words: str) -> None:
    abort = run_with(cycle(5, **changes))
    assert abort is not None
    assert abort.code == code
    assert words in abort.message


def test_a_joint_that_slides_is_told_in_metres() -> None:
    robot = load_robot("ur5")
    slides = replace(robot, joint_types=("prismatic", *robot.joint_types[1:]))
    still = Cycle(timestamp=60.0, index=0, q=np.zeros(6), qd=np.zeros(6), target_q=np.zeros(6))
    for changes, words in (
        ({"q": np.eye(6)[0] * 9}, "at 9 m, outside"),
        ({"qd": np.eye(6)[0] * 9}, "at 9 m/s, above"),
        ({"q": np.eye(6)[0]}, "1 m away"),
        ({"q": np.eye(6)[1]}, "1 rad away"),
    ):
        abort = Watchdog(watch_limits(slides), 125.0, TOTAL).see(replace(still, **changes))
        assert abort is not None
        assert words in abort.message


def test_the_same_cycles_without_the_cause_pass() -> None:
    assert run_with(cycle(5)) is None
    # Unknown limits do not bind, and 0.1 rad is not beyond 0.1 rad.
    assert run_with(cycle(5, qd=np.array([2.0, 100.0]), q=np.array([0.1, 0.0]))) is None


def test_what_the_controller_says_explains_what_follows_from_it() -> None:
    # A protective stop ends the program, pauses the index and slows the motion to nothing.
    late = cycle(
        5, safety_mode=3, runtime_state=1, speed_scaling=0.0, index=4, q=np.array([5.0, 0.0])
    )
    assert run_with(late).code == "safety"  # pyright: ignore[reportOptionalMemberAccess]
    program = replace(late, safety_mode=1)
    assert run_with(program).code == "program"  # pyright: ignore[reportOptionalMemberAccess]


def test_the_way_to_the_start_is_watched_too() -> None:
    assert watch([cycle(0, index=-1, q=np.array([0.0, 0.5]))]).code == "deviation"  # pyright: ignore[reportOptionalMemberAccess]
    assert watch([cycle(0, index=-1, runtime_state=1)]).code == "program"  # pyright: ignore[reportOptionalMemberAccess]
    # A package may be late there: nothing is recorded yet.
    assert watch([cycle(0, index=-1), cycle(9, index=-1)]) is None


def test_the_first_index_must_be_the_first() -> None:
    assert watch([cycle(3)]).code == "index"  # pyright: ignore[reportOptionalMemberAccess]


def test_an_emergency_after_the_last_sample_still_counts() -> None:
    end = [cycle(k) for k in range(TOTAL)]
    abort = watch([*end, cycle(TOTAL, safety_mode=6)])
    assert abort is not None
    assert abort.code == "safety"


@given(missing=st.integers(1, 50), at=st.integers(1, 10))
def test_gaps_are_counted(missing: int, at: int) -> None:
    watchdog = Watchdog(LIMITS, 125.0, 100)
    for k in range(at):
        assert watchdog.see(cycle(k)) is None
    abort = watchdog.see(cycle(at + missing))
    assert abort is not None
    assert abort.code == "gap"
    assert watchdog.gaps == missing


@given(steps=st.lists(st.integers(-2, 4), min_size=1, max_size=15), slack=st.integers(0, 3))
def test_streams_may_be_off_by_their_slack(steps: list[int], slack: int) -> None:
    cycles = [cycle(k, index=i) for k, i in enumerate([0, *np.cumsum(steps).tolist()])]
    watchdog = Watchdog(LIMITS, 125.0, 1000, slack=slack)
    for k, one in enumerate(cycles):
        abort = watchdog.see(one)
        assert (abort is not None) == (abs(one.index - k) > slack)
        if abort is not None:
            assert ("set points came late" if slack else "another program") in abort.message
            return


def test_a_stream_that_stands_still_is_late() -> None:
    """Its index was compared with the one before: it never was more than one cycle late."""
    stalled = [cycle(k, index=min(k, 3)) for k in range(30)]
    assert watch(stalled[:9], slack=5) is None
    abort = watch(stalled, slack=5)
    assert abort is not None
    assert "index is 3, where 9 was due; set points came late" in abort.message


def test_limits_must_fit_each_other() -> None:
    with pytest.raises(InputError, match="watch upper"):
        replace(LIMITS, upper=np.zeros(3))
    with pytest.raises(InputError, match="deviation"):
        replace(LIMITS, deviation=np.zeros(2))
