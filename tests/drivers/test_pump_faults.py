"""Whatever goes wrong in the thread that watches the robot, the robot stops first."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import replace
from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gentle_motion import ListRecorder

from dynid.drivers import Cycle, Execution, Watchdog, WatchLimits
from dynid.drivers.ur.pump import Intake, Pump
from dynid.drivers.ur.variables import Layout, recorded
from rest_motions import rest_series

FREE, ZERO = np.full(6, np.inf), np.zeros(6)
LIMITS = WatchLimits(lower=-FREE, upper=FREE, velocity=FREE, deviation=FREE)
EXECUTION = Execution(
    trajectory=rest_series(2.0, np.zeros(6), np.zeros((6, 4))), periods=1, limits=LIMITS
)


class Link:
    """Packages without end."""

    rate_hz = 125.0

    def __init__(self, layout: Layout) -> None:
        self.messages = ["the arm hums"]
        self.package = [0.0] * max(place.stop for place in layout.places.values())

    def packages(self) -> list[list[float]]:
        return [self.package]

    def write(self, package: bytes) -> None:
        assert package


class Broken:
    """A conversation that fails as no error of ours is meant to."""

    halted = 0

    def answer(self, numbers: Any) -> bytes | None:
        raise ZeroDivisionError("a bug")

    def begun(self, cycle: Any, numbers: Any) -> bool:
        return False

    def over(self, cycle: Any, numbers: Any) -> bool:
        return False

    def halt(self) -> None:
        self.halted += 1


class Begun(Broken):
    """A program that runs, and needs no answer."""

    def answer(self, numbers: Any) -> None: ...

    def begun(self, cycle: Any, numbers: Any) -> bool:
        return True


class Waiting(Begun):
    """A program that the controller has not begun."""

    def begun(self, cycle: Any, numbers: Any) -> bool:
        return False


def watched(link: Any, layout: Layout, conversation: Broken) -> Pump:
    watchdog = Watchdog(LIMITS, 125.0, EXECUTION.total)
    return Pump(link, layout, watchdog, conversation, cancel=threading.Event())


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"safety_mode": 3}, "safety mode became protective stop"),
        ({"robot_mode": 3}, "robot mode became power off"),
        ({"freedrive": True}, "teach button"),
    ],
)
def test_what_keeps_a_program_from_its_start_is_told_at_once(
    monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], said: str
) -> None:
    """Between two passes; it took 10 s, and remote control was blamed."""
    layout = recorded((3, 15, 8))
    link: Any = Link(layout)
    still = Cycle(timestamp=0.0, index=-1, q=ZERO, qd=ZERO, target_q=ZERO, runtime_state=1)
    cycles = iter([still, replace(still, **changes)])
    monkeypatch.setattr(type(layout), "cycle", lambda *_: next(cycles))
    pump = watched(link, layout, Waiting())
    pump.run()
    assert pump.fault is None
    assert pump.abort is not None
    assert said in pump.abort.message


def test_a_program_that_starved_is_told_with_the_pause_of_the_network(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    layout, times = recorded((3, 15, 8)), iter([0.0, 0.01, 0.31, 0.32])
    monkeypatch.setattr(
        "dynid.drivers.ur.pump.time", SimpleNamespace(monotonic=lambda: next(times))
    )
    link: Any = Link(layout)
    playing = Cycle(timestamp=0.0, index=-1, q=ZERO, qd=ZERO, target_q=ZERO)
    cycles = iter([playing, playing, replace(playing, runtime_state=1)])
    monkeypatch.setattr(type(layout), "cycle", lambda *_: next(cycles))
    pump = watched(link, layout, Begun())
    pump.run()
    assert pump.abort is not None
    assert "(no package came for 0.3 s; the arm hums)" in pump.abort.message


def test_another_program_is_not_waited_for_after_the_last_sample(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nor is it recorded, where it uses our register."""
    layout = recorded((3, 15, 8))
    link: Any = Link(layout)
    first = Cycle(timestamp=0.0, index=0, q=ZERO, qd=ZERO, target_q=ZERO)
    cycles = (
        replace(first, timestamp=k / link.rate_hz, index=k % EXECUTION.total) for k in count()
    )
    monkeypatch.setattr(type(layout), "cycle", lambda *_: next(cycles))
    pump = watched(link, layout, Begun())
    pump.run()
    assert pump.abort is None
    assert len(pump.rows) == EXECUTION.total


def test_only_periods_with_all_their_samples_count() -> None:
    """Time starts with the first recorded one; settling is watched and not recorded."""
    layout, execution = recorded((3, 15, 8)), replace(EXECUTION, periods=3, settle=1)
    lost, over = 2 * execution.cycles + 7, threading.Event()
    rows = [Link(layout).package.copy() for _ in range(execution.total)]
    for k, row in enumerate(rows):
        row[layout.places[layout.index]] = [float(k)]
        row[layout.places["timestamp"]] = [1000 + k / 125]
    over.set()
    pump: Any = SimpleNamespace(
        rows=deque(rows[:lost] + rows[lost + 1 :]),
        over=over, join=lambda: None, fault=None, gaps=1, abort=None,
    )  # fmt: skip
    recorder, told = ListRecorder(), list[float]()
    outcome = Intake(execution, layout, recorder, lambda _, share: told.append(share)).take(pump)
    count = execution.total - execution.cycles - 1
    assert (outcome.samples, outcome.periods, outcome.gaps) == (count, 2, 1)
    times = np.delete(np.arange(3 * execution.cycles), lost - execution.cycles) / 125
    np.testing.assert_allclose(recorder.t, times, rtol=0, atol=1e-9)
    assert told == sorted(told)
    assert 0.9 < told[-1] <= 1.0


def test_a_bug_stops_the_robot_and_is_raised_where_it_is_seen() -> None:
    layout = recorded((3, 15, 8))
    link: Any = Link(layout)
    conversation = Broken()
    pump = watched(link, layout, conversation)
    pump.start()
    with pytest.raises(ZeroDivisionError, match="a bug"):
        Intake(EXECUTION, layout, None, None).take(pump)
    assert conversation.halted == 1
    assert not pump.is_alive()
    assert pump.abort is not None
    assert pump.abort.code == "program"
    assert "ZeroDivisionError: a bug (the arm hums)" in pump.abort.message
