"""`dynid gains` and `dynid payload`: what they print and what they refuse."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import dynid
from dynid.cli.app import build
from dynid.core import Finding, InputError
from dynid.simulation import cylinder, simulate, simulated_arm, with_payload
from dynid.workflow.running import record_of

ROBOT = dynid.load_robot("ur5")
MOTION = dynid.random_excitation(ROBOT.limits, seed=7, margin=0.6, acceleration=8.0)


def call(*words: object) -> str:
    done = CliRunner().invoke(build(), [str(word) for word in words], catch_exceptions=False)
    assert done.exit_code == 0
    return done.stdout


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("payload")
    empty = simulated_arm(ROBOT)
    carrying = with_payload(empty, 2.0, [0.01, 0.0, 0.05], cylinder(2.0, 0.04, 0.1, 2))
    paths = (folder / "empty.parquet", folder / "loaded.parquet")
    for k, (arm, path) in enumerate(zip((empty, carrying), paths, strict=True)):
        dynid.write_record(record_of(simulate(arm, MOTION, seed=k)), path)
    return paths


def test_gains(files: tuple[Path, Path]) -> None:
    data = json.loads(call("gains", files[0], "--json"))
    assert set(data) == {"robot", "samples", "gains", "warnings", "findings"}
    truth = simulated_arm(dynid.load_robot("ur5")).truth.gain
    np.testing.assert_allclose([row["gain"] for row in data["gains"]], truth, rtol=0.01)
    text = call("gains", files[0])
    (line,) = [line for line in text.splitlines() if line.startswith("--gains ")]
    np.testing.assert_allclose([float(x) for x in line[8:].split(",")], truth, rtol=0.01)


def test_payload(files: tuple[Path, Path], tmp_path: Path) -> None:
    data = json.loads(call("payload", *files, "--json"))
    assert data["mass"] == pytest.approx(2.0, rel=0.02)
    np.testing.assert_allclose(data["centre"], [0.01, 0.0, 0.05], atol=0.005)
    text = call("payload", *files)
    assert "Payload: " in text
    assert max(map(len, text.splitlines())) <= 80
    # The other way round, it is a payload taken away: no body has a negative mass.
    back = json.loads(call("payload", files[1], files[0], "--json"))
    assert [notice["code"] for notice in back["warnings"]] == ["not_physical"]
    assert "swapped" in back["warnings"][0]["message"]
    assert back["mass"] >= 0
    most = back["mass_interval"][1]
    # The answer first, the findings after it.
    said = call("payload", files[1], files[0])
    assert said.startswith(f"No significant payload: below {most:.2g} kg")
    assert "not_physical" in said
    assert most > 0
    # Nothing was carried: neither a centre of nothing nor recordings that were swapped.
    other = tmp_path / "other.parquet"
    dynid.write_record(record_of(simulate(simulated_arm(ROBOT), MOTION, seed=5)), other)
    for pair in ((files[0], other), (other, files[0])):
        none = json.loads(call("payload", *pair, "--json"))
        assert [notice["code"] for notice in none["warnings"]] == ["low_excitation"]
        assert none["mass_interval"][1] < 0.1
        assert none["centre"] == none["centre_std"] == [None] * 3


def test_what_recordings_tell_of_themselves_is_passed_on(
    files: tuple[Path, Path], tmp_path: Path
) -> None:
    stopped = Finding("aborted", "aborted after 900 samples: someone pressed stop")
    cut = tmp_path / "cut.parquet"
    dynid.write_record(replace(dynid.read_record(files[1]), problems=(stopped,)), cut)
    for words in (("gains", cut), ("payload", files[0], cut)):
        found = json.loads(call(*words, "--json"))["findings"]
        assert [one["code"] for one in found] == ["aborted"]
        assert "pressed stop" in call(*words)


def test_an_empty_file_is_called_so(files: tuple[Path, Path], tmp_path: Path) -> None:
    (tmp_path / "e.csv").touch()
    with pytest.raises(InputError, match="the file is empty"):
        call("payload", files[0], tmp_path / "e.csv")


def test_robots_are_not_mixed(files: tuple[Path, Path]) -> None:
    with pytest.raises(InputError):
        call("payload", files[0], files[0].parent / "nothing.parquet")
