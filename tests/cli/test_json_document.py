"""docs/json.md lists exactly the keys that the commands print."""

from __future__ import annotations

import re
from pathlib import Path

from cli_runs import COMMANDS, Recordings, Run

import dynid

TEXT = (Path(__file__).parents[2] / "docs" / "json.md").read_text()
METRICS = set(re.findall(r"`(\w+)`", TEXT.split("**METRICS**:")[1].split("Lists")[0]))


def keys_of(command: str) -> set[str]:
    (cell,) = re.findall(rf"^\| `dynid {command}` \| (.*) \|$", TEXT, re.MULTILINE)
    return set(re.findall(r"`(\w+)`", re.sub(r"\([^()]*(\([^()]*\))?[^()]*\)", "", cell)))


def test_every_command_is_there() -> None:
    assert tuple(re.findall(r"^\| `dynid (\w+)`", TEXT, re.MULTILINE)) == COMMANDS


def test_robots_and_analyze(run: Run) -> None:
    assert set(run("robots", "--json").json()) == keys_of("robots")
    assert set(run("analyze", "ur3e", "--json").json()) == keys_of("analyze")


def test_import(run: Run, recordings: Recordings, tmp_path: Path) -> None:
    data = run("import", recordings.csv, "-o", tmp_path / "x.parquet", "--json").json()
    assert set(data) == keys_of("import")


def test_identify_and_validate(run: Run, recordings: Recordings) -> None:
    data = run("identify", recordings.identification, "--preset", "paper", "--json").json()
    assert set(data) == keys_of("identify")
    found = run("validate", recordings.estimate, recordings.validation, "--json").json()
    assert set(found) == keys_of("validate") | METRICS
    assert set(found["moving"]) == set(found["at_rest"]) == METRICS
    assert set(data["training"]) >= METRICS


def test_demo(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "demo"
    data = run("demo", "-o", folder, "--quick", "--json").json()
    assert set(data) == keys_of("demo")
    table = {row["quantity"]: row for row in data["table"]}
    rank = table["base parameters"]
    assert (rank["paper"], rank["preset_paper"], rank["preset_best"]) == (52, 52, 52)
    error = table["relative error, moving joints"]
    assert error["preset_best"] < error["preset_paper"] < 5
    assert table["e_N on the other motion"]["paper"] == 0.0550
    assert {Path(path).name for path in data["files"]} == {p.name for p in folder.iterdir()}
    record = dynid.read_record(folder / "identification.parquet")
    assert "current" in record.signals
    assert "effort" not in record.signals
