"""The demo that Ctrl-C meets while it records."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from dynid import read_record
from dynid.core import InputError, JobError
from dynid.workflow import run_demo


def test_an_interrupted_recording_is_closed_and_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Any motions: what is looked at is what becomes of the recording.
    monkeypatch.setattr("dynid.workflow.demo.HARMONICS", 2)
    monkeypatch.setattr("dynid.workflow.demo.PERIOD_S", 4.0)

    def interrupt() -> None:
        while not list(tmp_path.glob("*.partial")):
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    with pytest.raises(JobError, match="interrupted"):
        run_demo(tmp_path, quick=True)
    assert not list(tmp_path.glob("*.partial"))
    for path in tmp_path.glob("*.parquet"):
        assert any(problem.kind == "aborted" for problem in read_record(path).problems)


def test_a_demo_that_was_interrupted_starts_again_in_its_folder(tmp_path: Path) -> None:
    def stop(what: str, share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_demo(tmp_path / "a", quick=True, progress=stop)
    (tmp_path / "a" / "design.json").write_text("what the demo left")
    with pytest.raises(KeyboardInterrupt):
        run_demo(tmp_path / "a", quick=True, progress=stop)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "design.json").write_text("somebody's")
    with pytest.raises(InputError, match="unasked"):
        run_demo(tmp_path / "b", quick=True, progress=stop)
