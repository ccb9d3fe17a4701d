"""Errors, interrupts and broken pipes: one line, an exit code, no half-written file."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from cli_runs import COMMANDS, Recordings, Run
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dynid.cli.app import main
from dynid.core import JobError, MissingExtraError
from dynid.drivers import Outcome

HEAVY = ("numpy", "scipy", "pyarrow", "numba", "pinocchio", "mujoco", "rich")


def fail_with(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    def robots() -> None:
        raise error

    monkeypatch.setattr("dynid.robot.robots", robots)


@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (ValueError("no\nluck"), 1, "internal error, a bug in dynid: ValueError: no luck"),
        (JobError("it failed", value=3), 1, "it failed; got 3"),
        (MissingExtraError("needs x", next_step="Run: pip install 'dynid[sim]'"), 2, "dynid[sim]"),
        (MemoryError(), 1, "not enough memory"),
        (RecursionError("deep"), 1, "internal error"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_any_error_is_one_line(
    run: Run, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, says: str
) -> None:
    fail_with(monkeypatch, error)
    outcome = run("robots", "--json")
    assert (outcome.code, outcome.out) == (code, "")
    assert says in outcome.err
    assert len(outcome.err.splitlines()) == 1


def test_the_traceback_is_there_on_request(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    fail_with(monkeypatch, ValueError("no luck"))
    assert "DYNID_TRACEBACK=1" in run("robots").err
    monkeypatch.setenv("DYNID_TRACEBACK", "1")
    assert "Traceback" in run("robots").err


@pytest.mark.parametrize(("periods", "told"), [(0, True), (3, False)])
def test_periods_that_are_not_whole_are_told(
    run: Run, monkeypatch: pytest.MonkeyPatch, periods: int, told: bool
) -> None:
    """A stream of set points repeats and skips some where the network is slow."""
    made = SimpleNamespace(
        abort=None,
        left=None,
        record="r.parquet",
        design=SimpleNamespace(describe_digest=lambda: None),
        result=SimpleNamespace(outcome=Outcome(samples=9, periods=periods, gaps=0)),
        raise_if_aborted=lambda: None,
    )
    monkeypatch.setattr("dynid.workflow.run_design", lambda *_a, **_k: made)
    outcome = run("run", "d.json", "-o", "r.parquet")
    assert outcome.code == 0
    assert ("--method program" in outcome.err) is told


@pytest.mark.usefixtures("undiagnosed_once")
def test_an_interrupt_while_writing_leaves_the_old_file(
    run: Run, recordings: Recordings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "estimate.json"
    target.write_text("old")

    def half(path: Path, text: str, **_: Any) -> None:
        path.write_bytes(text[:1].encode())
        raise KeyboardInterrupt

    monkeypatch.setattr("dynid.core.files.Path.write_text", half)
    outcome = run(
        "identify", recordings.identification, "--preset", "paper", "-o", target, "--force"
    )
    assert outcome.code == 130
    assert [path.name for path in tmp_path.iterdir()] == ["estimate.json"]
    assert target.read_text() == "old"


@pytest.mark.usefixtures("undiagnosed_once")
@pytest.mark.parametrize(
    "command", ["import", "design", "identify", "validate", "export", "report"]
)
def test_no_result_is_replaced_unasked(
    run: Run, recordings: Recordings, tmp_path: Path, command: str
) -> None:
    endings = {"import": "parquet", "export": "py", "report": "html"}
    target = tmp_path / f"old.{endings.get(command, 'json')}"
    target.write_text("old")
    words: dict[str, list[str | Path]] = {
        "import": [recordings.csv, "--robot", "ur5"],
        "design": ["ur5", "--starts", "1"],
        "identify": [recordings.identification, "--preset", "paper"],
        "validate": [recordings.estimate, recordings.validation, "--refit", "friction"],
        "export": [recordings.estimate, "--to", "python"],
        "report": [recordings.estimate.parent],
    }
    outcome = run(command, *words[command], "-o", target)
    assert outcome.code == 2
    assert "--force" in outcome.err
    assert target.read_text() == "old"
    if command != "design":
        assert run(command, *words[command], "-o", target, "--force").code == 0
        assert target.read_bytes() != b"old"


def test_a_demo_and_figures_replace_nothing_unasked(
    run: Run, recordings: Recordings, tmp_path: Path
) -> None:
    (tmp_path / "warm_validation.parquet").write_text("old")
    outcome = run("demo", "-o", tmp_path, "--quick")
    assert outcome.code == 2
    assert "--force" in outcome.err
    words = ("report", recordings.estimate.parent, "--figures", tmp_path / "figures", "-o")
    assert run(*words, tmp_path / "a.html").code == 0
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    outcome = run(*words, tmp_path / "b.html")
    assert outcome.code == 2
    assert "--force" in outcome.err
    assert before.items() <= {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}.items()


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.long)],
)
def test_signals_stop_a_running_demo(tmp_path: Path, number: signal.Signals, code: int) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "dynid", "demo", "--quick", "-o", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while not (tmp_path / "design.json").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (code, ""), err
    assert "Traceback" not in err
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_name_that_no_disk_takes_is_bad_input(run: Run) -> None:
    outcome = run("fleet", "x" * 300)
    assert outcome.code == 2
    assert len(outcome.err.splitlines()) == 1


def test_a_reader_that_leaves_early_is_no_error() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "dynid", "robots", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    assert process.wait(timeout=60) == 1
    assert err == b""


def test_a_full_disk_behind_stdout_is_said() -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "dynid", "robots"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert "No space left" in done.stderr
    assert "Traceback" not in done.stderr


def test_streams_that_are_closed_fail_no_job() -> None:
    done = subprocess.run(
        ["sh", "-c", '"$0" -m dynid analyze ur5 <&- >&- 2>&-', sys.executable], check=False
    )
    assert done.returncode == 0


def test_a_stderr_that_nobody_reads_changes_no_exit_code() -> None:
    there, here = os.pipe()
    os.close(there)
    done = subprocess.run(
        [sys.executable, "-m", "dynid", "check", "none.json"], stderr=here, check=False
    )
    os.close(here)
    assert done.returncode == 2


def test_a_terminal_that_closes_fails_no_job(monkeypatch: pytest.MonkeyPatch) -> None:
    """A whole recording had exit code 1, where the terminal closed and SIGHUP was ignored."""
    there, here = os.openpty()

    def close() -> tuple[str, ...]:
        os.close(there)
        return ()

    monkeypatch.setattr("dynid.robot.robots", close)
    with open(here, "w") as terminal:
        monkeypatch.setattr(sys, "stdout", terminal)
        monkeypatch.setattr(sys, "stderr", terminal)
        code = main(["robots", "--json"])
        monkeypatch.undo()
    assert code == 0


def test_help_loads_nothing_heavy() -> None:
    asked = [["--help"], ["--version"], *([c, "--help"] for c in COMMANDS)]
    code = (
        "import json, sys; from dynid.cli.app import main\n"
        f"for words in {asked!r}:\n"
        f"    found = [main(words), sorted(set({HEAVY!r}) & set(sys.modules))]\n"
        "    print(json.dumps([words, *found]), file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ
    )
    said = [json.loads(line) for line in done.stderr.splitlines()]
    assert said == [[words, 0, []] for words in asked]


BRIEF = tuple(
    name
    for name in COMMANDS
    if name not in {"design", "controller", "run", "report", "studio", "demo"}
)
"""Commands that neither search, serve nor move."""
WORDS = st.sampled_from(
    [
        *("ur5", "ur5e", "tilt:45", "tilt:nan", "wall", "dh", "fc,fv,im", "fc:1", "fo:0", "", " "),
        *("-1", "0", "1e99", "nan", "inf", "3", "\x00"[:0], "ä\udcff", "-o", "--json", "--seed"),
        *("--samples", "--mount", "--frames", "--terms", "--help", "--", "/", ".", "/dev/null"),
        *(
            "--columns",
            "--gains",
            "--rate",
            "--delimiter",
            "t=0,q=1:7",
            "1,2",
            "--robot",
            "x" * 300,
        ),
        *("x" * 300, "x" * 5000, "a\nb", "\t", "--json=1", "-h", "--version"),
        *("--preset", "paper", "best", "--from", "--to", "--validate", "--cutoff", "--estimator"),
    ]
)


LINES = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.mark.usefixtures("undiagnosed_once")
@settings(LINES, max_examples=40)
@given(command=st.sampled_from(BRIEF), data=st.data())
def test_no_command_line_makes_a_traceback(
    run: Run, recordings: Recordings, command: str, data: st.DataObject
) -> None:
    random_line(run, recordings, command, data)


@pytest.mark.long
@settings(LINES, max_examples=150)
@given(command=st.sampled_from(BRIEF), data=st.data())
def test_none_of_many_command_lines_makes_a_traceback(
    run: Run, recordings: Recordings, command: str, data: st.DataObject
) -> None:
    random_line(run, recordings, command, data)


def random_line(run: Run, recordings: Recordings, command: str, data: st.DataObject) -> None:
    files = st.sampled_from([str(recordings.csv), str(recordings.estimate), str(Path(__file__))])
    words = data.draw(st.lists(WORDS | files, max_size=5))
    # Random words must not become files.
    words = [word for word in words if word not in ("-o", "--output")]
    words += data.draw(st.sampled_from([[], ["-o", "/nowhere/x"], ["-o", "x" * 300]]))
    outcome = run(command, *words)
    assert outcome.code in (0, 2), outcome
    assert "Traceback" not in outcome.err
    assert "internal error" not in outcome.err
    if outcome.code == 2:
        assert len(outcome.err.splitlines()) == 1
        assert outcome.out == ""
