"""What every command promises: help, JSON, exit codes, one clear message."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib import resources
from pathlib import Path

import pytest
from cli_runs import COMMANDS, LISTED, Outcome, Recordings, Run

import dynid
from dynid.core import provenance

ANALYZE_KEYS = {
    "standard_parameters",
    "base_parameters",
    "identifiable_alone",
    "identifiable_combined",
    "unidentifiable",
    "singular_values",
    "cumulative_energy",
    "names",
    "expressions",
    "frames",
    "mount",
    "tolerance",
}
IMPORT_KEYS = {"samples", "rate_hz", "duration_s", "dropped_rows", "problems"}
IDENTIFY_KEYS = {
    "base_parameters",
    "condition_number",
    "samples",
    "estimator",
    "parameters",
    "training",
    "validation",
    "warnings",
}
METRICS = {
    "samples",
    "normalized_error",
    "rmse",
    "nrmse",
    "relative_error_percent",
    "relative_error_overall_percent",
    "r2",
}


def assert_bad_usage(outcome: Outcome, *parts: str) -> None:
    assert outcome.code == 2, outcome
    assert outcome.out == ""
    assert outcome.err.startswith("dynid: ")
    assert len(outcome.err.splitlines()) == 1, outcome.err
    for part in parts:
        assert part in outcome.err


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_an_example_and_json(run: Run, command: str) -> None:
    outcome = run(command, "--help")
    assert outcome.code == 0
    assert f"dynid {command}" in outcome.out.split("Example:")[1]
    assert "--json" in outcome.out
    assert "Settings" not in outcome.out, "words for users, not names of classes"
    assert all(len(line) <= 100 for line in outcome.out.splitlines())


def test_help_lists_exactly_the_commands_that_exist(run: Run) -> None:
    listed = run("--help").out.split("Commands:")[1].split("Example:")[0]
    assert tuple(line.split()[0] for line in listed.splitlines() if line.strip()) == LISTED
    assert run().out == run("--help").out


def test_version(run: Run) -> None:
    assert run("--version").out == f"dynid {dynid.__version__}\n"


def test_robots(run: Run) -> None:
    robots = run("robots", "--json").json()["robots"]
    assert [set(robot) for robot in robots] == [{"name", "joints", "source"}] * len(robots)
    names = {robot["name"] for robot in robots}
    assert {"ur3", "ur5", "ur10", "ur3e", "ur5e", "ur10e", "ur16e"} <= names
    assert "UR5" in run("robots").out


def test_analyze(run: Run) -> None:
    data = run("analyze", "ur5", "--json").json()
    assert data.keys() >= ANALYZE_KEYS
    counts = [data[key] for key in ("standard_parameters", "base_parameters")]
    assert counts == [78, 52]
    assert [data["identifiable_alone"], data["identifiable_combined"]] == [36, 33]
    assert data["unidentifiable"] == 9
    assert len(data["names"]) == len(data["expressions"]) == 52
    text = run("analyze", "ur5").out
    assert "78 standard parameters, 52 base parameters" in text
    assert max(map(len, text.splitlines())) <= 80


def test_a_rank_without_a_clear_gap_is_not_called_clear(run: Run) -> None:
    said = run("analyze", "ur5", "--terms", "fc,fv,im,fs,fr,fo,fca,fva").out
    assert "has no clear gap" in said
    assert "rank is clear" not in said


def test_analyze_options_reach_the_analysis(run: Run) -> None:
    wall = run("analyze", "ur5", "--mount", "wall", "--json").json()
    assert (wall["base_parameters"], wall["mount"]) == (54, "wall")
    offsets = run("analyze", "ur5", "--terms", "fc,fv,im,fo", "--json").json()
    assert offsets["base_parameters"] == 58
    urdf = run("analyze", "ur5", "--frames", "urdf", "--samples", "40", "--seed", "3", "--json")
    data = urdf.json()
    assert [data["identifiable_alone"], data["identifiable_combined"]] == [34, 35]
    assert (data["frames"], data["samples"], data["seed"]) == ("urdf", 40, 3)


def test_import(run: Run, recordings: Recordings, tmp_path: Path) -> None:
    target = tmp_path / "out.parquet"
    data = run("import", recordings.csv, "--robot", "ur5", "-o", target, "--json").json()
    assert data.keys() >= IMPORT_KEYS
    assert (data["samples"], data["joints"], data["robot"]) == (1250, 6, "ur5")
    assert data["rate_hz"] == pytest.approx(125.0, rel=1e-6)
    assert data["record"] == str(target)
    assert target.exists()
    assert "1250 samples" in run("import", recordings.csv, "-o", tmp_path / "b.parquet").out


def test_import_without_a_header(run: Run, recordings: Recordings, tmp_path: Path) -> None:
    lines = recordings.csv.read_text().splitlines()[1:]
    bare = tmp_path / "bare.csv"
    bare.write_text("\n".join(line.replace(",", ";") for line in lines) + "\n")
    words = ["--columns", "t=0,q=1:7,qd=7:13,current=13:19", "--no-header", "--delimiter", ";"]
    gains = ["--gains", "13.6,13.7,13.7,9.7,8.7,9.0"]
    target = tmp_path / "bare.parquet"
    data = run("import", bare, "-o", target, "--robot", "ur5", *words, *gains, "--json").json()
    assert data["samples"] == 1250
    assert data["drive_gains"] == [13.6, 13.7, 13.7, 9.7, 8.7, 9.0]
    assert set(data["signals"]) == {"q", "qd", "current"}


def test_identify_and_validate(run: Run, recordings: Recordings, tmp_path: Path) -> None:
    target = tmp_path / "estimate.json"
    told = run(
        "identify",
        recordings.identification,
        "-o",
        target,
        "--preset",
        "paper",
        "--weighting",
        "size",
        "--for",
        "this-motion",
        "--validate",
        recordings.validation,
        "--json",
    )
    assert "--weighting is not used by --estimator ols" in told.err
    assert "--for is not used by --preset paper" in told.err
    data = told.json()
    assert data.keys() >= IDENTIFY_KEYS
    assert data["base_parameters"] == len(data["parameters"]) == 52
    assert data["estimator"] == "ols"
    keys = {"name", "value", "unit", "std", "relative_std_percent"}
    assert all(row.keys() >= keys for row in data["parameters"])
    for part in (data["training"], data["validation"]):
        for metrics in (part, part["moving"], part["at_rest"]):
            assert metrics.keys() >= METRICS
            assert len(metrics["rmse"]) == 6
    assert all(set(notice) == {"code", "message"} for notice in data["warnings"])
    assert data["verdict"]["level"] == "usable"
    again = run("validate", target, recordings.validation, "--json").json()
    assert again["normalized_error"] == pytest.approx(data["validation"]["normalized_error"])
    window = run("validate", target, recordings.validation, "--from", "2", "--to", "6", "--json")
    assert 400 < window.json()["samples"] < 501
    text = run("validate", target, recordings.validation).out
    assert "e_N" in text
    assert max(map(len, text.splitlines())) <= 80


def test_identify_tells_first_whether_to_trust_it(run: Run, recordings: Recordings) -> None:
    outcome = run("identify", recordings.identification, "--preset", "paper", "--estimator", "irls")
    assert outcome.out.startswith("This result can be used: it is expected to predict")
    assert "Nothing was written" in outcome.out
    assert max(map(len, outcome.out.splitlines())) <= 80


def test_a_short_one_way_motion_is_called_unusable(run: Run, recordings: Recordings) -> None:
    words = ["--preset", "paper", "--to", "0.9"]
    outcome = run("identify", recordings.identification, *words)
    assert outcome.code == 0
    assert outcome.out.startswith("This result must not be used")
    data = run("identify", recordings.identification, *words, "--json").json()
    assert {"ill_conditioned", "low_excitation"} <= {w["code"] for w in data["warnings"]}
    assert data["verdict"]["level"] == "do_not_use"


@pytest.mark.usefixtures("undiagnosed_once")
def test_halves_of_one_recording(run: Run, recordings: Recordings) -> None:
    data = run(
        *("identify", recordings.identification, "--preset", "paper", "--to", "6"),
        *("--validate-from", "6", "--json"),
    ).json()
    assert data["validation"]["samples"] == pytest.approx(500, abs=40)
    assert data["estimate"] is None


@pytest.mark.usefixtures("undiagnosed_once")
def test_foreign_files_are_read_directly(run: Run, recordings: Recordings) -> None:
    words = ["identify", recordings.csv, "--preset", "paper", "--json"]
    assert run(*words, "--robot", "ur5").json()["base_parameters"] == 52
    assert_bad_usage(run(*words), "does not say which robot", "--robot")
    again = run("validate", recordings.estimate, recordings.csv, "--json").json()
    assert again["relative_error_overall_percent"] < 10


@pytest.mark.usefixtures("undiagnosed_once")
def test_a_robot_file_is_remembered(run: Run, recordings: Recordings, tmp_path: Path) -> None:
    robot = tmp_path / "mine.toml"
    robot.write_bytes((resources.files("dynid.robot.library") / "ur5.toml").read_bytes())
    record = tmp_path / "mine.parquet"
    data = run("import", recordings.csv, "--robot", robot, "-o", record, "--json").json()
    assert data["robot"] == str(robot)
    assert run("identify", record, "--preset", "paper").code == 0
    robot.unlink()
    assert_bad_usage(
        run("identify", record, "--preset", "paper"), "does not exist any more", "--robot"
    )


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["analyz"], ["'analyz'", "Did you mean 'analyze'"]),
        (["designs", "ur5"], ["No such command 'designs'"]),
        (["analyze"], ["Missing argument 'ROBOT'", "dynid analyze --help"]),
        (["analyze", "ur5", "--sample", "3"], ["--sample", "--samples"]),
        (["analyze", "ur5", "--samples", "many"], ["--samples"]),
        (["analyze", "ur5", "--samples", "0"], ["--samples"]),
        (["analyze", "ur5", "--seed", "-1"], ["--seed"]),
        (["analyze", "ur55"], ["ur55", "ur10", "Did you mean ur5"]),
        (["analyze", ""], ["robot"]),
        (["analyze", "ur5", "--frames", "euler"], ["--frames", "euler", "dh"]),
        (["analyze", "ur5", "--mount", "tilt:steep"], ["steep"]),
        (["analyze", "ur5", "--terms", "fc,xx"], ["--terms", "xx", "fv"]),
        (["analyze", "ur5", "--terms", "fo:9"], ["--terms", "9"]),
        (["import", "none.csv", "-o", "x.parquet"], ["none.csv"]),
        (["import", "none.csv"], ["-o"]),
        (["import", "none.csv", "-o", "x.csv"], ["-o", "x.csv", ".parquet"]),
        (["import", "none.csv", "-o", "nowhere/x.parquet"], ["nowhere", "mkdir -p nowhere"]),
        (["import", "none.csv", "-o", "x.parquet", "--gains", "1,b"], ["--gains", "1,b"]),
        (["identify", "none.parquet"], ["none.parquet"]),
        (
            ["identify", "none.parquet", "--estimator", "kalman"],
            ["--estimator", "kalman", "ols, wls"],
        ),
        (["identify", "none.parquet", "--preset", "good"], ["--preset", "good", "paper, best"]),
        (["identify", "none.parquet", "--weighting", "no"], ["--weighting", "joint, size"]),
        (["identify", "none.parquet", "-o", "."], ["-o"]),
        (["validate", "none.json", "none.parquet"], ["none.json"]),
        (["validate", "none.json"], ["RECORD"]),
        (["analyze", "ur5", "--samples", "0"], ["--samples", "got 0"]),
        (["controller", "--thermal", "tepid"], ["--thermal", "tepid", "cold, warm"]),
        (["controller", "--report", "nowhere/x.json"], ["--report", "mkdir -p nowhere"]),
        (["report", "none"], ["none", "no such directory"]),
        (["report", ".", "-o", "page.txt"], ["-o", "page.txt", ".html"]),
        (["report", ".", "-o", "nowhere/page.html"], ["-o", "mkdir -p nowhere"]),
        (["report", ".", "-o", "no where/page.html"], ["-o", "mkdir -p 'no where'"]),
        (["bench", "estimators", "--only", "ols,magic"], ["--only", "magic", "didim"]),
        (["bench", "estimators", "--seeds", "0"], ["--seeds", "got 0"]),
        (["demo", "-o", ""], ["-o", "no name"]),
        (["check", "none.json"], ["none.json", "cannot be read", "Looked in"]),
    ],
)
def test_bad_usage_is_one_clear_line(
    run: Run,
    words: list[str],
    parts: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_bad_usage(run(*words), *parts)
    assert_bad_usage(run(*words, "--json"), *parts)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"", "the file is empty"),
        (b"  \n", "the file is empty"),
        (b'{"kind": "dynid.traj', "cut short"),
        (b'{"kind": "dynid.trajectory", ', "cut short"),
        (b"\x93NUMPY\xff\x00", "no text"),
        (b"kind: design", "not JSON: expecting value in line 1, column 1"),
        (b'{"format": "dynid-estimate"}', "got dynid-estimate. Make one: dynid design"),
        (b"{}", "Make one: dynid design"),
        (b'{"a": NaN}', "NaN is not a JSON number"),
    ],
)
def test_what_is_no_design_is_said_in_words(
    run: Run, tmp_path: Path, content: bytes, part: str
) -> None:
    path = tmp_path / "design.json"
    path.write_bytes(content)
    outcome = run("check", path)
    assert_bad_usage(outcome, str(path))
    assert part in outcome.err
    assert "(char" not in outcome.err


def test_only_what_is_unjudged_is_called_not_judged(run: Run, tmp_path: Path) -> None:
    path, limits = tmp_path / "slow.json", dynid.load_robot("ur5").limits
    motion = dynid.random_excitation(limits, seed=3, margin=0.3)
    dynid.write_trajectory(motion, path, robot="ur5", limits=limits, provenance=provenance(seed=3))
    text = run("check", path, "--limits", "paper").out
    assert "certified, feasible" in text
    assert "not judged" not in text
    assert "not asked for: torque, tcp speed" in text


def test_a_robot_that_is_not_there_is_suggested(run: Run, tmp_path: Path) -> None:
    robot = dynid.load_robot("ur5")
    path = tmp_path / "design.json"
    motion = dynid.random_excitation(robot.limits, seed=0)
    made = provenance(seed=0)
    dynid.write_trajectory(motion, str(path), robot="ur55", limits=robot.limits, provenance=made)
    assert dynid.read_trajectory(str(path)).robot == "ur55"
    assert_bad_usage(run("check", path), "ur55", "ur10e", "Did you mean ur5?", "--robot")


def test_one_recording_shows_no_payload(run: Run, recordings: Recordings) -> None:
    one = recordings.identification
    assert_bad_usage(run("payload", one, one), "with the payload is one without")


@pytest.mark.usefixtures("undiagnosed_once")
def test_gains_and_log_of_an_estimate_are_found_again(
    run: Run, recordings: Recordings, tmp_path: Path
) -> None:
    log, estimate, other = tmp_path / "log.csv", tmp_path / "arm.json", tmp_path / "other.csv"
    log.write_bytes(recordings.csv.read_bytes())
    other.write_bytes(recordings.csv.read_bytes())
    robot, known = tmp_path / "arm.toml", resources.files("dynid.robot.library") / "ur5.toml"
    robot.write_text(re.sub(r"(?m)^gain = .*$", "", known.read_text()))
    gains = ("--gains", "13.6,13.7,13.7,9.7,8.7,9.0")
    words = ("--robot", robot, "--preset", "paper", "-o", estimate)
    assert run("identify", log, *words, *gains).code == 0
    assert run("validate", estimate, other).code == 0
    assert (
        "recording is not in the folder"
        not in run("report", tmp_path, "-o", tmp_path / "r.html").out
    )


def test_a_payload_is_weighed_as_the_arm_is_mounted(run: Run, recordings: Recordings) -> None:
    pair = (recordings.identification, recordings.validation)
    wall = run("payload", *pair, "--mount", "wall", "--json").json()
    expected = dynid.identify_payload(*pair, dynid.load_robot("ur5", mount="wall"))
    assert wall["mass"] == pytest.approx(expected.mass)


@pytest.mark.usefixtures("undiagnosed_once")
def test_bad_windows_and_settings(run: Run, recordings: Recordings) -> None:
    record = recordings.identification
    paper = ["identify", record, "--preset", "paper"]
    assert_bad_usage(run(*paper, "--from", "5", "--to", "3"), "--to")
    assert_bad_usage(run(*paper, "--from", "-1"), "--from")
    assert_bad_usage(run(*paper, "--from", "nan"), "--from")
    assert_bad_usage(run(*paper, "--from", "1000"), "1000")
    assert_bad_usage(run(*paper, "--cutoff", "0"), "--cutoff")
    for window in (("1000", "2000"), ("-1", "5"), ("5", "3")):
        asked = ("--validate-from", window[0], "--validate-to", window[1])
        assert_bad_usage(run(*paper, *asked), "--validate-from, --validate-to: ")
    assert_bad_usage(
        run(*paper, recordings.validation, "--validate-from", "5"), "--validate RECORD"
    )
    assert_bad_usage(run("validate", recordings.estimate, record, "--to", "0"), "--to")
    assert_bad_usage(run("validate", record, record), record.name)
    assert_bad_usage(run(*paper, "-o", record.with_suffix(".txt")), ".json")
    assert_bad_usage(run("import", record, "-o", record), "overwrite")


def test_a_directory_that_cannot_be_made(run: Run, tmp_path: Path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("")
    assert_bad_usage(run("demo", "-o", blocker / "demo", "--quick"), str(blocker))


def test_nothing_but_json_on_stdout(recordings: Recordings, tmp_path: Path) -> None:
    """In a process of its own, where C libraries could write to stdout as well."""
    record = recordings.identification
    words = ["identify", record, "--to", "5", "--validate-from", "5", "-o", tmp_path / "e.json"]
    words += ["--preset", "paper"]
    done = subprocess.run(
        [sys.executable, "-m", "dynid", *map(str, words), "--json"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONWARNINGS": "error::RuntimeWarning"},
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert Outcome(0, done.stdout, "").json()["preset"] == "paper"
    assert len(done.stdout.splitlines()) == 1


def test_a_design_without_masses_says_so_in_words(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "bare.toml"
    path.write_text(
        """name = "bare"
[dh]
convention = "standard"
a = [0.3, 0.3]
d = [0.0, 0.0]
alpha = [1.5707963267948966, 0.0]
[limits]
lower = [-2.0, -2.0]
upper = [2.0, 2.0]
velocity = [2.0, 2.0]
torque = [50.0, 20.0]
"""
    )
    out = run(
        "design", str(path), "-o", str(tmp_path / "d.json"), "--starts", "1", "--no-collision"
    )
    assert "expected torque error unknown without masses of its links" in out.out, out
    assert "- %" not in out.out
