"""The simulated arm as a driver: the same as the simulation itself, and stopped by anything."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gentle_motion import CYCLES, RATE, ListRecorder, gentle, gentle_execution, ur5

from dynid.core import InputError, JobError
from dynid.drivers import Execution, SimulatedDriver
from dynid.experiment.plan import watch_limits
from dynid.recording import RecordMetadata, RecordWriter, read_record
from dynid.robot import load_robot
from dynid.simulation import simulate, simulated_arm
from dynid.trajectory import FourierSeries, Quintic

STOP_S = 0.1
STILL = 0.01
"""[rad/s]"""


def driver(**options: object) -> SimulatedDriver:
    return SimulatedDriver(simulated_arm(ur5()), **options)  # pyright: ignore[reportArgumentType]


def test_it_records_what_the_simulation_does(tmp_path: Path) -> None:
    one = driver(seed=3)
    source = one.source
    path = tmp_path / "run.parquet"
    with RecordWriter(
        path,
        ur5().joint_names,
        source.quantities,
        RecordMetadata(robot="ur5"),
        channels=source.channels,
    ) as recorder:
        outcome = one.execute(gentle_execution(2), recorder)
    record = read_record(path)
    reference = simulate(simulated_arm(ur5()), gentle(), periods=2, seed=3)
    assert (outcome.samples, outcome.periods, outcome.gaps) == (2 * CYCLES, 2, 0)
    assert outcome.abort is None
    np.testing.assert_allclose(record.t, reference.t, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(record.channels["index"], np.arange(2 * CYCLES))
    for name in ("target_q", "target_qd", "target_qdd", "target_moment", "target_current"):
        np.testing.assert_allclose(
            record.signals[name], reference.signals[name], rtol=1e-9, atol=1e-9
        )
    true = np.stack([state.q for state in one.states])
    np.testing.assert_allclose(true, reference.truth.q, rtol=0, atol=1e-9)


def test_settling_periods_are_moved_and_not_recorded() -> None:
    recorder = ListRecorder()
    outcome = driver().execute(gentle_execution(2, settle=1), recorder)
    assert outcome.samples == 2 * CYCLES
    targets = recorder.array("target_q").reshape(2, CYCLES, 6)
    np.testing.assert_allclose(targets[0], targets[1], rtol=0, atol=1e-12)
    # The first period of all differs: the target filter still settles.
    recorder = ListRecorder()
    driver().execute(gentle_execution(2), recorder)
    targets = recorder.array("target_q").reshape(2, CYCLES, 6)
    assert np.abs(targets[0] - targets[1]).max() > 1e-9


def test_a_seed_gives_the_same_again_and_another_does_not() -> None:
    def currents(seed: int):
        recorder = ListRecorder()
        driver(seed=seed).execute(gentle_execution(), recorder)
        return recorder.array("current")

    np.testing.assert_array_equal(currents(1), currents(1))
    assert np.abs(currents(1) - currents(2)).max() > 0


def test_the_joints_get_warmer_from_one_execution_to_the_next() -> None:
    one = driver(thermal=24.0)
    for _ in range(2):
        one.execute(gentle_execution(), ListRecorder())
    first, second = one.states[:CYCLES], one.states[CYCLES:]
    assert (second[0].temperature >= first[-1].temperature - 1e-9).all()
    assert (second[-1].temperature > first[0].temperature).all()


@pytest.mark.parametrize("samples", [1, 100, 333])
def test_a_wish_to_stop_is_followed_within_a_tenth_of_a_second(samples: int) -> None:
    cancel = threading.Event()

    class Asks(ListRecorder):
        def append(self, t, signals, channels=None) -> None:
            super().append(t, signals, channels)
            if len(self.t) == samples:
                cancel.set()

    recorder, one = Asks(), driver()
    outcome = one.execute(gentle_execution(2), recorder, cancel=cancel)
    assert outcome.abort is not None
    assert outcome.abort.code == "interrupted"
    assert outcome.samples == len(recorder.t)
    assert outcome.samples - samples <= STOP_S * RATE
    assert one.rest is not None
    assert np.abs(one.rest.dq).max() < STILL


def test_a_recorder_that_refuses_stops_the_arm() -> None:
    class Full(ListRecorder):
        def append(self, t, signals, channels=None) -> None:
            if len(self.t) == 77:
                raise JobError("the recording cannot be written", value="No space left on device")
            super().append(t, signals, channels)

    recorder, one = Full(), driver()
    outcome = one.execute(gentle_execution(), recorder)
    assert outcome.abort is not None
    assert outcome.abort.code == "recording"
    assert "No space left" in outcome.abort.message
    assert outcome.samples == 77
    assert one.rest is not None
    assert np.abs(one.rest.dq).max() < STILL


def test_a_joint_beyond_its_limit_stops_the_arm() -> None:
    limits = replace(watch_limits(ur5()), velocity=np.full(6, 0.05))
    outcome = driver().execute(Execution(trajectory=gentle(), limits=limits), ListRecorder())
    assert outcome.abort is not None
    assert outcome.abort.code == "limit"
    assert 0 < outcome.samples < CYCLES


SWING = FourierSeries(period=2.0, offset=np.zeros(6), a=np.full((6, 1), 0.25), b=np.zeros((6, 1)))
AWAY = Quintic(start=np.zeros(6), goal=np.ones(6), travel_time=2.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"rate_hz": 0.0}, "control rate"),
        ({"rate_hz": 100.3}, "whole number of control cycles"),
        ({"trajectory": SWING}, "start and end at rest"),
        ({"trajectory": AWAY, "periods": 2}, "position jumps"),
    ],
)
def test_a_motion_that_begins_ends_or_repeats_with_a_jerk_is_refused(
    changes: dict[str, Any], said: str
) -> None:
    """Set points were streamed of one that starts at 0.8 rad/s."""
    with pytest.raises(InputError, match=said):
        replace(gentle_execution(), **changes)


def test_a_motion_for_other_joints_is_refused() -> None:
    robot = load_robot("ur5")
    execution = gentle_execution()
    seven = replace(
        execution.trajectory,
        offset=np.zeros(7),
        a=np.zeros((7, 3)),
        b=np.zeros((7, 3)),
    )
    with pytest.raises(InputError, match="joints of the motion"):
        SimulatedDriver(simulated_arm(robot)).execute(
            replace(execution, trajectory=seven), ListRecorder()
        )


def test_nothing_is_recorded_without_a_recorder() -> None:
    one, told = driver(), [0.0]
    outcome = one.execute(gentle_execution(), None, progress=lambda _, share: told.append(share))
    assert (outcome.samples, outcome.abort, one.states) == (0, None, [])
    # Nothing was told of slow and settling periods.
    assert told[-1] == 1.0
    assert max(np.diff(told)) < 0.05
