from __future__ import annotations

import io
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gentle import CYCLES, write_motion

from dynid.core import InputError
from dynid.recording import read_record
from dynid.studio.jobs import Job, JobState, ParentTalk, Supervisor, TailReader, _run, line
from dynid.workflow import check
from urtwin import controller_process, own_address

PATIENCE = 60.0
"""What nobody waits for unless something is broken [s]."""


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_motion(tmp_path_factory.mktemp("jobs") / "motion.json")


def until(job: Supervisor, reached: Callable[[JobState], bool]) -> JobState:
    """Wait for a state; an end is one too."""
    deadline = time.monotonic() + PATIENCE
    pause = threading.Event()
    while not reached(job.state) and not job.state.ended:
        assert time.monotonic() < deadline, job.state
        pause.wait(0.01)
    return job.state


def run_job(motion: Path, output: Path, target: str = "sim", **options: object) -> Job:
    return Job(kind="run", source=str(motion), output=str(output), options=options, target=target)


def test_a_run_in_its_own_process_records_every_sample(motion: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    job = Supervisor(run_job(motion, path, repeat=2))
    state = job.wait(PATIENCE)
    assert (state.ended, state.error, state.share) == (True, None, 1.0)
    assert state.result is not None
    assert (state.result["samples"], state.result["gaps"]) == (2 * CYCLES, 0)
    record = read_record(path)
    np.testing.assert_array_equal(record.channels["index"], np.arange(2 * CYCLES))


def test_stop_stops_the_robot_and_keeps_what_was_recorded(motion: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    job = Supervisor(run_job(motion, path, repeat=1000))
    reader = TailReader(path)
    assert TailReader(tmp_path / "none.parquet").read(0.0) is None
    until(job, lambda state: state.share > 0)
    # The live signals come from the file, while the other process writes it.
    deadline, tail = time.monotonic() + PATIENCE, None
    while tail is None and time.monotonic() < deadline:
        tail = reader.read(time.monotonic())
    assert tail is not None
    assert tail.signals["q"].shape == (tail.samples, 6)
    job.stop()
    state = job.wait(PATIENCE)
    assert state.result is not None
    assert state.result["cause"]["code"] == "interrupted"
    # What is aborted is not called done.
    assert "stopped: it was interrupted" in state.what
    assert state.share < 1.0
    record = read_record(path)
    assert tail.samples <= record.samples == state.result["samples"] < 1000 * CYCLES
    assert [problem.kind for problem in record.problems] == ["aborted"]


@pytest.mark.parametrize(
    ("does", "says"),
    [
        # Half a line, and one that no longer hears what it should do.
        ('os.write(1, b\'{"result": {"wor\')', "ended with code 0"),
        ("os.kill(os.getpid(), 9)", "ended with code -9"),
    ],
)
def test_the_end_of_a_process_ends_its_job(
    motion: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, does: str, says: str
) -> None:
    begin = subprocess.Popen

    def killed(_: object, **options: Any) -> subprocess.Popen[str]:
        return begin([sys.executable, "-c", f"import os; {does}"], **options)

    monkeypatch.setattr(subprocess, "Popen", killed)
    job = Supervisor(run_job(motion, tmp_path / "run.parquet"))
    state = job.wait(PATIENCE)
    assert (state.ended, state.result) == (True, None)
    assert says in str(state.error)
    job.close()
    assert job.state == state


def test_a_page_that_is_gone_is_a_stop(motion: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    job = Supervisor(run_job(motion, path, repeat=1000))
    until(job, lambda state: state.share > 0)
    stdin = job._process.stdin
    assert stdin is not None
    stdin.close()
    state = job.wait(PATIENCE)
    assert state.result is not None
    assert state.result["cause"]["code"] == "interrupted"
    assert read_record(path).samples == state.result["samples"]


def test_the_last_words_of_a_failure_arrive(motion: Path, tmp_path: Path) -> None:
    unknown = Supervisor(run_job(motion, tmp_path / "b.parquet", teapot=1))
    assert "teapot" in str(unknown.wait(PATIENCE).error)


def test_a_search_shows_its_criterion_and_keeps_its_best(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    options = {"budget_s": 600.0, "period_s": 5.0, "harmonics": 3}
    job = Supervisor(Job(kind="design", source="ur5", output=str(path), options=options))
    until(job, lambda state: bool(state.history))
    job.stop()
    state = job.wait(PATIENCE)
    assert state.error is None
    assert state.result is not None
    assert state.result["interrupted"] is True
    values = [value for _, value in state.history]
    found = json.loads(path.read_text())["design"]["history"]
    # The last ones may not have been told before the stop.
    assert values == [entry["value"] for entry in found][: len(values)]
    assert check(path).to_json()["feasible"] == state.result["feasible"]
    assert json.loads(path.read_text())["design"]["criterion"] == "prediction"


@pytest.fixture(scope="module")
def controller() -> object:
    with controller_process("ur5", host=own_address(), virtual_time=True) as running:
        yield running


@pytest.mark.parametrize("heard", [{"answer": "yes"}, {"stop": True}, None])
def test_a_real_robot_does_not_move_unless_its_word_was_typed(
    controller,
    motion: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    heard: dict[str, object] | None,
) -> None:
    """The job in this process: what it hears, and that the end of it is Ctrl-C."""
    ended = threading.Event()
    monkeypatch.setattr("dynid.studio.jobs.os.kill", lambda *_: ended.set())
    told = io.StringIO()
    talk = ParentTalk(told, io.StringIO("" if heard is None else line(heard)))
    talk.listen()
    path = tmp_path / "refused.parquet"
    refused = "answer" in (heard or {})
    with pytest.raises(InputError if refused else KeyboardInterrupt) as raised:
        _run(run_job(motion, path, f"ur://{controller.host}", repeat=1), talk)
    assert not refused or "not confirmed" in str(raised.value)
    assert ended.wait(PATIENCE)
    assert not path.exists()
    (asked,) = [m for m in map(json.loads, told.getvalue().splitlines()) if "ask" in m]
    assert asked["word"] == controller.host


def test_a_real_robot_moves_when_its_word_was_typed(
    controller, motion: Path, tmp_path: Path
) -> None:
    agreed = Supervisor(
        run_job(motion, tmp_path / "run.parquet", f"ur://{controller.host}", repeat=1)
    )
    asked = until(agreed, lambda state: state.ask is not None)
    assert asked.word == controller.host
    assert "mounted as" in str(asked.ask)
    agreed.answer(controller.host)
    state = agreed.wait(PATIENCE)
    assert state.error is None
    assert state.result is not None
    assert (state.result["samples"], state.result["gaps"]) == (CYCLES, 0)
