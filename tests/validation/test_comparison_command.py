"""`dynid compare`: its keys, its table, its refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from known_arm import estimate

from dynid.cli.app import main
from dynid.identification import write_estimate


@pytest.fixture
def pair(tmp_path: Path) -> tuple[str, str]:
    cold = estimate()
    values = cold.values.copy()
    for joint in range(1, 7):
        values[cold.names.index(f"Fv{joint}")] += 30.0
    paths = (tmp_path / "cold.json", tmp_path / "warm.json")
    for path, one in zip(paths, (cold, replace(cold, values=values)), strict=True):
        write_estimate(one, path)
    return str(paths[0]), str(paths[1])


def test_json_has_the_keys_of_the_contract(
    pair: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", *pair, "--json"]) == 0
    captured = capsys.readouterr()
    data = json.loads(captured.out)
    assert captured.err == ""
    assert len(data["parameters"]) == 52
    assert all({"name", "a", "b", "change_percent", "z"} <= set(row) for row in data["parameters"])
    moved = {name: group["moved"] for name, group in data["groups"].items()}
    assert moved == {"inertial": False, "coulomb": False, "viscous": True, "motor": False}


def test_the_table_says_which_groups_moved(
    pair: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", *pair]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.split()[:2] == ["viscous", "moved"] for line in lines)
    assert any(line.split()[:4] == ["inertial", "did", "not", "move"] for line in lines)
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 40
    assert lines[3].split()[0] == "inertial"
    assert main(["compare", *pair, "--all"]) == 0
    assert len(capsys.readouterr().out.splitlines()) > 52


def test_a_file_that_is_no_estimate_is_refused(
    pair: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.json"
    other.write_text("{}")
    for words in ((pair[0], str(other)), (pair[0], str(tmp_path / "missing.json"))):
        assert main(["compare", *words]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1
