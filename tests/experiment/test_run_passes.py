"""The order of passes, and what becomes of a stop or an error in each."""

from __future__ import annotations

import threading
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from dynid.core import Finding, InputError, JobError, Progress
from dynid.drivers import Abort, Driver, Execution, Outcome, Recorder, Source
from dynid.experiment import ExperimentPlan, run
from dynid.recording import RecordWriter
from dynid.robot import load_robot
from rest_motions import rest_series

SERIES = rest_series(2.0, np.zeros(6), 0.05 * np.random.default_rng(0).normal(size=(6, 4)))
PLAN = ExperimentPlan(
    robot=load_robot("ur5"), trajectory=SERIES, slow=0.5, warm_up_s=3.0, periods=2
)
STOP = Abort("speed", "the speed slider was moved to 50 %")


@dataclass
class Scripted(Driver):
    """Ends the executions as it is told, one after the other."""

    ends: list[Abort | None]
    seen: list[tuple[float, int, bool]] = field(default_factory=list)

    @property
    def source(self) -> Source:
        return Source(quantities=("q",), format="test", origin="test")

    def execute(
        self,
        execution: Execution,
        recorder: Recorder | None,
        *,
        cancel: threading.Event | None = None,
        progress: Progress | None = None,
    ) -> Outcome:
        self.seen.append((execution.trajectory.duration, execution.periods, recorder is not None))
        abort = self.ends[len(self.seen) - 1]
        return Outcome(samples=7, periods=0, gaps=0, abort=abort)


@dataclass
class Notes:
    problems: list[Finding] = field(default_factory=list)
    refuses: bool = False

    def append(self, t, signals, channels=None) -> None:
        raise AssertionError

    def report(self, problem: Finding) -> None:
        if self.refuses:
            raise JobError("the disk is full")
        self.problems.append(problem)


def test_all_passes_run_and_the_last_is_recorded() -> None:
    driver = Scripted([None, None, None])
    result = run(PLAN, driver, lambda: nullcontext(Notes()))
    assert driver.seen == [(4.0, 1, False), (2.0, 2, False), (2.0, 2, True)]
    assert result.stopped_in is None
    assert result.outcome.samples == 7


@pytest.mark.parametrize(("before", "name"), [(0, "slow"), (1, "warm-up")])
def test_a_stop_before_the_recording_ends_the_run(before: int, name: str) -> None:
    driver = Scripted([*[None] * before, STOP])
    result = run(PLAN, driver, lambda: nullcontext(Notes()))
    assert result.stopped_in == name
    assert result.outcome.abort == STOP
    assert result.outcome.samples == 0
    assert len(driver.seen) == before + 1


def test_a_stop_is_written_into_the_recording() -> None:
    notes = Notes()
    result = run(PLAN, Scripted([None, None, STOP]), lambda: nullcontext(notes))
    assert result.stopped_in == "run"
    assert [finding.kind for finding in notes.problems] == ["aborted"]


def test_a_disk_that_refuses_the_note_hides_no_cause() -> None:
    result = run(PLAN, Scripted([None, None, STOP]), lambda: nullcontext(Notes(refuses=True)))
    assert result.outcome.abort == STOP


def test_what_cannot_be_recorded_is_told_before_anything_moves() -> None:
    driver = Scripted([])

    def open_recorder() -> AbstractContextManager[Recorder]:
        raise JobError("the recording cannot be started")

    with pytest.raises(JobError, match="cannot be started"):
        run(PLAN, driver, open_recorder)
    assert not driver.seen


def test_a_stop_before_the_second_sample_is_a_stop(tmp_path: Path) -> None:
    names = [f"joint {k}" for k in range(6)]
    result = run(
        PLAN,
        Scripted([None, None, STOP]),
        lambda: RecordWriter(tmp_path / "run.parquet", names, ("q",)),
    )
    assert result.outcome.abort == STOP
    assert result.stopped_in == "run"


def test_a_recording_that_cannot_be_ended_stops_nothing_but_is_said(tmp_path: Path) -> None:
    class Gone(RecordWriter):
        def close(self) -> None:
            super().close()
            raise InputError("the file cannot be written", where="run.parquet")

    names = [f"joint {k}" for k in range(6)]
    writer = Gone(tmp_path / "run.parquet", names, ("q",))
    for k in range(3):
        writer.append(float(k), {"q": np.zeros(6)})
    result = run(PLAN, Scripted([None, None, None]), lambda: writer)
    assert result.outcome.abort is not None
    assert result.outcome.abort.code == "recording"
    assert "cannot be written" in result.outcome.abort.message
