"""A recording played again, past the watchdog."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gentle_motion import CYCLES, ListRecorder, gentle_execution, ur5

from dynid.core.errors import InputError
from dynid.drivers.replay import ReplayDriver
from dynid.drivers.simulated import SimulatedDriver
from dynid.recording.record import ExperimentRecord
from dynid.simulation.library import simulated_arm


@pytest.fixture(scope="module")
def record() -> ExperimentRecord:
    recorder = ListRecorder()
    SimulatedDriver(simulated_arm(ur5())).execute(gentle_execution(2), recorder)
    return ExperimentRecord(
        t=np.array(recorder.t),
        signals={name: recorder.array(name) for name in recorder.signals[0]},
        channels={"index": recorder.channel("index")},
    )


def test_it_hands_out_the_recording(record: ExperimentRecord) -> None:
    recorder = ListRecorder()
    outcome = ReplayDriver(record).execute(gentle_execution(2), recorder)
    assert (outcome.samples, outcome.periods, outcome.abort) == (2 * CYCLES, 2, None)
    np.testing.assert_array_equal(recorder.array("q"), record.signals["q"])


def test_a_missing_sample_is_a_gap(record: ExperimentRecord) -> None:
    kept = np.delete(np.arange(record.samples), 100)
    holed = ExperimentRecord(
        t=record.t[kept], signals={name: value[kept] for name, value in record.signals.items()}
    )
    outcome = ReplayDriver(holed).execute(gentle_execution(2), ListRecorder())
    assert outcome.abort is not None
    assert (outcome.abort.code, outcome.gaps) == ("gap", 1)


@pytest.mark.parametrize(
    ("channel", "value", "code"),
    [
        ("safety_mode", 3.0, "safety"),
        ("robot_mode", 5.0, "mode"),
        ("speed_scaling", 0.5, "speed"),
        ("target_speed_fraction", 0.5, "speed"),
    ],
)
def test_recorded_modes_are_watched(
    record: ExperimentRecord, channel: str, value: float, code: str
) -> None:
    normal = {"safety_mode": 1.0, "robot_mode": 7.0}.get(channel, 1.0)
    values = np.full(record.samples, normal)
    values[123] = value
    marked = replace(record, channels={**record.channels, channel: values})
    outcome = ReplayDriver(marked).execute(gentle_execution(2), ListRecorder())
    assert outcome.abort is not None
    assert outcome.abort.code == code
    assert outcome.samples == 124


def test_the_end_of_the_recording_is_a_lost_connection(record: ExperimentRecord) -> None:
    outcome = ReplayDriver(record).execute(gentle_execution(3), ListRecorder())
    assert outcome.abort is not None
    assert outcome.abort.code == "connection"
    assert outcome.periods == 2


def test_other_joints_are_refused(record: ExperimentRecord) -> None:
    fewer = ExperimentRecord(t=record.t, signals={"q": record.signals["q"][:, :4]})
    with pytest.raises(InputError, match="joints"):
        ReplayDriver(fewer).execute(gentle_execution(), ListRecorder())
