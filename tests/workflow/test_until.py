"""`dynid run --until`: rounds of design, run and identification, and when they end."""

from __future__ import annotations

import json
import math
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from designed_arm import written_arm

from dynid import DesignSettings, IdentifySettings, check, design, identify, read_record
from dynid.cli.app import main
from dynid.core import InputError, JobError
from dynid.experiment import stop_on_signals
from dynid.workflow import RunSettings, run_until

QUICK = {
    "settings": RunSettings(repeat=2),
    "identification": IdentifySettings(preset="paper", estimator="wls", cutoff_hz=10.0),
}


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("until")
    path = folder / "design.json"
    robot = written_arm(folder, whole=True)
    text = robot.read_text(encoding="utf-8")
    robot.write_text(text + "[drives]\ngain = [12.0, 12.0, 10.0]\n", encoding="utf-8")
    asked = DesignSettings(period_s=4.0, harmonics=3, starts=1, clearance=0.002, rate_hz=50.0)
    assert design(robot, asked, output=path).feasible
    return path


def test_what_one_run_reaches_ends_the_rounds(first: Path, tmp_path: Path) -> None:
    found = run_until(first, tmp_path / "run.parquet", 60.0, **QUICK)
    assert (found.ended_by, len(found.rounds)) == ("reached", 1)
    told = found.rounds[0].accuracy
    assert told is not None
    assert told.found_percent < told.bound_percent <= 60.0
    # Twice the period halves the variance that the design promises for one.
    promised = json.loads(first.read_text())["design"]["predicted_torque_error_percent"]
    assert told.expected_percent == pytest.approx(promised / math.sqrt(2), rel=1e-6)
    # Of a run that was stopped, the design promises what is left.
    record = read_record(tmp_path / "run.parquet")
    half = record.samples // 2
    signals = {name: values[:half] for name, values in record.signals.items()}
    stopped = replace(record, t=record.t[:half], signals=signals, channels={})
    one_period = identify([stopped], first.parent / "small.toml", QUICK["identification"]).accuracy
    assert one_period is not None
    assert one_period.expected_percent == pytest.approx(promised, rel=0.01)
    found.raise_if_missed()
    assert sorted(p.name for p in tmp_path.glob("*.parquet")) == ["run.parquet"]


def test_what_no_time_would_reach_is_said(first: Path, tmp_path: Path) -> None:
    found = run_until(first, tmp_path / "run.parquet", 0.01, **QUICK)
    told = found.rounds[-1].accuracy
    assert (found.ended_by, len(found.rounds)) == ("out_of_reach", 2)
    assert told is not None
    assert told.left_out == "recordings"
    # Noise falls with time, in squares; what is left of the error does not.
    squares = np.square([told.found_percent, told.noise_percent, told.after_longer_percent])
    own = max(squares[0] - squares[1], 0.0)
    assert squares[2] == pytest.approx(own + squares[1] / 10, rel=1e-9)
    assert told.after_longer_percent > 0.01
    second = json.loads((tmp_path / "run_2_design.json").read_text())
    assert second["provenance"]["settings"]["previous"] == [str(tmp_path / "run.parquet")]
    assert (tmp_path / "run_2.parquet").exists()
    with pytest.raises(JobError, match="the accuracy was not reached"):
        found.raise_if_missed()


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_between_the_runs_a_signal_ends_the_rounds_at_once(
    first: Path, tmp_path: Path, number: int
) -> None:
    told: list[str] = []

    def interrupt(what: str, share: float) -> None:
        if (tmp_path / "run.parquet").exists() and not what.startswith("run"):
            told.append(what)
            os.kill(os.getpid(), number)

    with stop_on_signals() as cancel, pytest.raises(KeyboardInterrupt):
        run_until(first, tmp_path / "run.parquet", 0.01, **QUICK, cancel=cancel, progress=interrupt)
    assert len(told) == 1
    assert not (tmp_path / "run_2.parquet").exists()


def test_further_motions_are_for_the_load_of_the_run(first: Path, tmp_path: Path) -> None:
    load = (0.05, 0.0, 0.0, 0.02)
    loaded = {**QUICK, "settings": RunSettings(repeat=2, payload=load)}
    run_until(first, tmp_path / "run.parquet", 0.01, **loaded)
    second = json.loads((tmp_path / "run_2_design.json").read_text())
    assert tuple(second["design"]["limits"]["payload"]) == load


def test_rounds_elsewhere_find_what_the_design_was_made_for(
    first: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(first.parent)
    Path("scene.json").write_text('{"shapes": []}', encoding="utf-8")
    Path("task.json").write_text('{"poses": [[0, 1, 0], [1, 1.2, -1]]}', encoding="utf-8")
    around = {"scene": "scene.json", "motions": ("task.json",), "mesh_dirs": (".",)}
    made = DesignSettings(period_s=4.0, harmonics=3, starts=1, rate_hz=50.0, **around)
    assert design("small.toml", made, output="elsewhere.json").feasible
    monkeypatch.chdir(tmp_path)
    again = check(first.parent / "elsewhere.json")
    assert again.feasible
    assert again.limits.mesh_dirs == (str(first.parent),)
    found = run_until(first.parent / "elsewhere.json", "run.parquet", 0.01, **QUICK)
    assert len(found.rounds) > 1


def test_a_recording_in_the_way_is_told_before_the_search(first: Path, tmp_path: Path) -> None:
    (tmp_path / "run_2.parquet").touch()
    with pytest.raises(InputError, match=r"run_2\.parquet: the file exists"):
        run_until(first, tmp_path / "run.parquet", 0.01, **QUICK)
    assert not (tmp_path / "run_2_design.json").exists()


def test_an_accuracy_that_is_no_share_moves_nothing(
    first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = tmp_path / "run.parquet"
    assert main(["run", str(first), "-o", str(record), "--until", "0"]) == 2
    assert "--until" in capsys.readouterr().err
    plain = json.loads(first.read_text())
    del plain["design"]
    path = tmp_path / "plain.json"
    path.write_text(json.dumps(plain))
    with pytest.raises(InputError, match="does not have"):
        run_until(path, record, 5.0)
    assert not record.exists()
