"""The way to the start: straight where it can be, planned where the arm is in its own way."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from threading import Event

import numpy as np
import pytest

from dynid.constraints import ConstraintSettings, MotionConstraints, safe_constraints
from dynid.core import Array
from dynid.drivers import Execution
from dynid.experiment import ExperimentPlan, plan_approach
from dynid.experiment import preflight as approaches
from dynid.experiment.preflight import (
    APPROACH_SPEED,
    Approach,
    FreeSpace,
    certify_straight,
    find_way,
)
from dynid.robot import load_robot
from rest_motions import rest_series

UR5 = load_robot("ur5")
JUDGE = safe_constraints(UR5)
UPRIGHT = np.array([0.0, -np.pi / 2, 0.0, -np.pi / 2, 0.0, 0.0])
# The hand would pass through the forearm on the straight way.
BEHIND = np.array([0.3, -1.2, 0.5, 3.0, 0.2, 0.0])
DENSE_RAD = 0.002


def dense(poses: Array) -> Array:
    """(N, n) samples of the straight ways between poses."""
    ways = [np.linspace(a, b, int(np.abs(b - a).max() / DENSE_RAD) + 2) for a, b in pairwise(poses)]
    return np.concatenate(ways)


def nearest(q: Array) -> float:
    """Smallest distance between bodies of the arm [m]."""
    assert JUDGE.surroundings is not None
    pairs = JUDGE.surroundings.pairs["self_collision"]
    room = JUDGE.surroundings.bodies.nearest(q, pairs).room.min()
    return float(room) + JUDGE.settings.self_clearance


@pytest.fixture(scope="module")
def planned() -> Approach:
    return plan_approach(UPRIGHT, BEHIND, JUDGE, seed=3)


def test_a_way_is_found_where_the_straight_one_collides(planned: Approach) -> None:
    clearance = JUDGE.settings.self_clearance
    assert nearest(dense(np.stack([UPRIGHT, BEHIND]))) < 0.0
    assert planned.free
    assert len(planned.poses) > 2
    np.testing.assert_array_equal(planned.poses[0], UPRIGHT)
    np.testing.assert_array_equal(planned.poses[-1], BEHIND)
    q = dense(planned.poses)
    assert nearest(q) >= clearance
    bounds = JUDGE.settings.bounds
    assert ((q > bounds.lower) & (q < bounds.upper)).all()


def test_a_seed_gives_the_same_way_again(planned: Approach) -> None:
    told: list[float] = []
    again = plan_approach(
        UPRIGHT, BEHIND, JUDGE, seed=3, progress=lambda _, share: told.append(share)
    )
    np.testing.assert_array_equal(again.poses, planned.poses)
    assert told == sorted(told)
    assert told[0] == 0.0
    assert told[-1] < 1.0
    space = FreeSpace(JUDGE, UPRIGHT, BEHIND, speed=0.5, room=0.0)
    ways = [find_way(space, np.random.default_rng(seed), 400) for seed in (1, 2)]
    assert not np.array_equal(*(np.zeros(0) if way is None else way for way in ways))


def test_a_free_straight_way_is_taken(planned: Approach) -> None:
    near = plan_approach(UPRIGHT, UPRIGHT + 0.3, JUDGE)
    assert near.free
    assert len(near.poses) == 2
    assert near.describe() == "0.3 rad"
    assert len(planned.poses) > 2
    assert f"{len(planned.poses) - 2} way point" in planned.describe()


def test_a_way_is_judged_at_the_speed_at_which_it_is_taken() -> None:
    judge = safe_constraints(UR5, collision=False)
    # From one side to the other: only how far it is counts, not where.
    for reach in (0.4, 1.2):
        a, b = UPRIGHT.copy(), UPRIGHT.copy()
        a[0], b[0] = -reach, reach
        verdict = certify_straight(a, b, judge)
        assert verdict.feasible
        assert verdict.worst["velocity"].value == pytest.approx(APPROACH_SPEED, rel=1e-3)


def test_who_stands_at_the_start_has_no_way_to_go() -> None:
    there = plan_approach(UPRIGHT, UPRIGHT + 1e-4, JUDGE)
    assert there.free
    assert len(there.poses) == 2
    assert there.describe() == "already there"
    # Nor is it asked of him, where he was measured a little beyond a limit.
    start = UPRIGHT.copy()
    start[0] = JUDGE.settings.bounds.upper[0]
    beyond = start + np.array([5e-4, 0, 0, 0, 0, 0])
    assert plan_approach(beyond, start, JUDGE).free
    assert not plan_approach(beyond, UPRIGHT, JUDGE).free


def test_where_no_way_is_found_the_straight_one_and_its_fault_come_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(approaches, "SEARCHES", ((0.0, 100),))
    # The elbow cannot be where the arm is folded into itself.
    folded = np.array([0.0, -1.5, 3.1, 0.0, 0.0, 0.0])
    assert nearest(folded[None]) < 0.0
    found = plan_approach(UPRIGHT, folded, JUDGE)
    assert not found.free
    assert len(found.poses) == 2
    assert found.refused is not None
    assert "self_collision" in found.refused.broken


class AroundDisc(FreeSpace):
    """A point that goes from one side of the unit disc to the other."""

    def __init__(self) -> None:
        self.q, self.goal = np.array([-2.0, 0.0]), np.array([2.0, 0.0])
        self.lower, self.upper = np.full(2, -4.0), np.full(2, 4.0)

    def free(self, a: Array, b: Array) -> bool:
        step = b - a
        share = np.clip(-(a @ step) / max(step @ step, 1e-300), 0.0, 1.0)
        return bool(np.linalg.norm(a + share * step) >= 1.0)


def test_ways_are_hardly_longer_than_the_shortest() -> None:
    """Which is two tangents and the arc between them."""
    space, shortest = AroundDisc(), 2 * np.sqrt(3) + np.pi / 3
    found = [find_way(space, np.random.default_rng(seed), 400) for seed in range(20)]
    longer: list[float] = []
    for way in found:
        assert way is not None
        np.testing.assert_array_equal(way[[0, -1]], [space.q, space.goal])
        assert all(space.free(a, b) for a, b in pairwise(way))
        longer.append(np.linalg.norm(np.diff(way, axis=0), axis=1).sum() / shortest - 1)
        assert len(way) <= 8
    assert min(longer) > 0
    assert np.median(longer) < 0.02
    assert max(longer) < 0.08


def test_nothing_beyond_the_ends_of_a_way_counts() -> None:
    judge = safe_constraints(UR5, collision=False)
    space = FreeSpace(judge, UPRIGHT, UPRIGHT, speed=APPROACH_SPEED, room=0.0)
    inside, outside = UPRIGHT.copy(), UPRIGHT.copy()
    upper = judge.settings.bounds.upper[0]
    inside[0], outside[0] = 0.9 * upper, upper + 1e-3
    assert space.free(UPRIGHT, inside)
    assert space.free(inside, inside)
    assert not space.free(UPRIGHT, outside)


def test_a_search_without_collisions_goes_straight() -> None:
    free = MotionConstraints(
        UR5, ConstraintSettings(bounds=JUDGE.settings.bounds, self_collision=False)
    )
    space = FreeSpace(free, UPRIGHT, UPRIGHT + 2.0, speed=0.5, room=0.0)
    poses = find_way(space, np.random.default_rng(0), 100)
    assert poses is not None
    np.testing.assert_allclose(poses, [UPRIGHT, UPRIGHT + 2.0], rtol=0, atol=0)


def test_only_the_first_pass_goes_through_the_way_points() -> None:
    series = rest_series(2.0, UPRIGHT, np.zeros((6, 4)))
    points = (UPRIGHT, UPRIGHT + 0.1, UPRIGHT + 0.2)
    plan = ExperimentPlan(robot=UR5, trajectory=series, slow=0.5, warm_up_s=2.0, via=points)
    executions: list[Execution] = [step.execution for step in plan.passes()]
    assert executions[0].via == points
    # The others must stand at the start already: nothing else was certified.
    for execution in executions[1:]:
        np.testing.assert_array_equal(execution.via, [plan.start])
    alone = replace(plan, slow=None, warm_up_s=0.0)
    assert [step.execution.via for step in alone.passes()] == [points]


def test_a_way_that_was_found_is_taken_only_with_a_certificate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The search looks at samples; a way through the arm is refused behind it."""
    middle = (UPRIGHT + BEHIND) / 2
    monkeypatch.setattr(approaches, "SEARCHES", ((0.0, 1),))
    monkeypatch.setattr(approaches, "find_way", lambda *_: np.stack([UPRIGHT, middle, BEHIND]))
    found = plan_approach(UPRIGHT, BEHIND, JUDGE)
    assert not found.free
    np.testing.assert_array_equal(found.poses, [UPRIGHT, BEHIND])


def test_nothing_is_searched_where_an_end_collides_or_nobody_waits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def searched(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(approaches, "find_way", searched)
    below = np.array([0.0, -0.3, 0.6, -1.0, -1.0, 0.0])
    for a, b in ((below, UPRIGHT), (UPRIGHT, below)):
        found = plan_approach(a, b, JUDGE)
        assert found.refused is not None
        assert found.refused.broken == ("environment",)
    cancelled = Event()
    cancelled.set()
    assert not plan_approach(UPRIGHT, BEHIND, JUDGE, cancel=cancelled).free
