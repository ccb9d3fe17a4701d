"""What is refused before any work is done, and what the first page of help says."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from cli_runs import Outcome, Recordings, Run

import dynid
from dynid.cli.estimate_commands import print_identification, print_metrics
from dynid.cli.show import console, number
from dynid.core import provenance
from dynid.export import write_model


def refused(outcome: Outcome, *parts: str) -> None:
    assert outcome.code == 2, outcome
    assert outcome.out == ""
    assert len(outcome.err.splitlines()) == 1
    for part in parts:
        assert part in outcome.err


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    limits = dynid.load_robot("ur5").limits
    path = tmp_path / "motion.json"
    made = provenance(seed=0)
    drawn = dynid.random_excitation(limits, seed=0)
    dynid.write_trajectory(drawn, str(path), robot="ur5", limits=limits, provenance=made)
    return path


def test_summaries_of_commands_are_not_cut(run: Run) -> None:
    for words in ((), ("bench",)):
        listed = run(*words, "--help").out.split("Commands:")[1].split("Example:")[0]
        assert "..." not in listed


def test_a_motion_does_not_replace_the_file_of_its_robot(run: Run, tmp_path: Path) -> None:
    robot = tmp_path / "arm.urdf"
    robot.write_text("<robot/>")
    words = ("design", robot, "-o", tmp_path / "d.json", "--csv", robot, "--force")
    refused(run(*words), "--csv", "would overwrite an input")


def test_designs_and_estimates_are_not_asked_for_their_robot(
    run: Run, recordings: Recordings, motion: Path
) -> None:
    estimate = recordings.estimate
    for wrong, kind in ((motion, "this is a design"), (estimate, "this is an estimate")):
        for words in (
            ("identify", wrong),
            ("identify", wrong, "--robot", "ur5"),
            ("gains", wrong),
            ("payload", recordings.validation, wrong),
            ("validate", estimate, wrong),
            ("identify", recordings.validation, "--preset", "paper", "--validate", wrong),
        ):
            refused(run(*words), str(wrong), kind, "not a recording")


def test_a_recording_as_json_is_still_read(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    path.write_text('{"format": "mine", "kind": "log", "t": [0, 1]}')
    refused(run("identify", path), "does not say which robot")


@pytest.mark.parametrize(
    ("noise", "part"),
    [("1,2", "needs a number a joint"), ("0,0,0,0,0,0", "1e-06 to 1e+06"), ("1,b", "--noise")],
)
def test_noise_is_looked_at_before_the_search(
    run: Run, tmp_path: Path, noise: str, part: str
) -> None:
    target = tmp_path / "d.json"
    refused(run("design", "ur5", "-o", target, "--noise", noise), "--noise", part)


@pytest.mark.parametrize(("to", "name"), [("c", "a.urdf"), ("urdf", "a.h"), ("python", "a.xml")])
def test_a_name_of_another_format_is_refused(
    run: Run, recordings: Recordings, tmp_path: Path, to: str, name: str
) -> None:
    target = tmp_path / name
    words = ("export", recordings.estimate, "--to", to, "-o", target)
    refused(run(*words), "-o", name, f"another format than {to}")
    assert not target.exists()


def test_a_folder_that_takes_no_files_is_found_before_the_work(run: Run) -> None:
    # Root may write everywhere that takes files at all: /proc takes none.
    refused(run("design", "ur5", "-o", "/proc/d.json"), "-o", "cannot be written to", "/proc")


@pytest.mark.parametrize("name", ["-", "pipe"])
def test_devices_and_dashes_are_no_outputs(
    run: Run, recordings: Recordings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    # A pipe stands for /dev/null and its kind: whatever goes wrong here, the machine keeps those.
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    refused(run("export", recordings.estimate, "--to", "c", "-o", name), "-o", "can be kept")
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["pipe"]


def test_a_link_stays_a_link_and_a_pipe_a_pipe(recordings: Recordings, tmp_path: Path) -> None:
    estimate = dynid.read_estimate(recordings.estimate)
    record = dynid.read_record(recordings.validation)
    writers: dict[str, Callable[[Path], object]] = {
        "e.json": lambda path: dynid.write_estimate(estimate, path),
        "r.parquet": lambda path: dynid.write_record(record, path),
        "m.py": lambda path: write_model(estimate, path, "python"),
    }
    for name, write in writers.items():
        (tmp_path / "real").mkdir(exist_ok=True)
        link = tmp_path / name
        link.symlink_to(tmp_path / "real" / name)
        write(link)
        assert link.is_symlink()
        assert (tmp_path / "real" / name).stat().st_size > 1000
        pipe = tmp_path / f"pipe-{name}"
        os.mkfifo(pipe)
        with pytest.raises(dynid.InputError, match="no ordinary file"):
            write(pipe)
        assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_units_are_those_of_the_joints(
    run: Run, recordings: Recordings, capsys: pytest.CaptureFixture[str]
) -> None:
    text = run("validate", recordings.estimate, recordings.validation).out
    assert "RMS errors in N·m\n" in text
    estimate = dynid.read_estimate(recordings.estimate)
    result = dynid.validate(estimate, dynid.read_record(recordings.validation))
    print_metrics(console(), "Prediction", result, (False, True, *(False,) * 4))
    told = capsys.readouterr().out
    assert "RMS errors in N·m, N where sliding" in told
    # Newtons and newton metres do not add.
    assert "all joints" not in told
    second = result.metrics.relative_error_percent[1]
    assert re.search(rf"sliding joints: {second:.3g} % of the torque.*e_N \S+ N with N", told)
    assert re.search(r"turning joints: \S+ % of the torque.*e_N \S+ N·m with N", told)


def test_errors_of_its_own_recording_are_those_of_each_kind(
    recordings: Recordings, capsys: pytest.CaptureFixture[str]
) -> None:
    one, other = map(dynid.read_record, (recordings.identification, recordings.validation))
    settings = dynid.IdentifySettings(preset="paper")
    result = dynid.identify([one], "ur5", validation=other, settings=settings)
    model = result.estimate.model
    robot = replace(model.robot, joint_types=("prismatic", *model.robot.joint_types[1:]))
    estimate = replace(result.estimate, model=replace(model, robot=robot))
    print_identification(console(), replace(result, estimate=estimate), everything=False)
    first = float(result.training.metrics.relative_error_percent[0])
    told = capsys.readouterr().out
    assert f"its own recording, sliding joints: {number(first, 3)} % of the torque" in told
    assert "its own recording, turning joints: " in told
