from __future__ import annotations

from pathlib import Path

import pytest
from cli_runs import Outcome, Recordings, Run, write_rtde_csv

import dynid
from dynid.cli.app import main


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*words: str | Path) -> Outcome:
        capsys.readouterr()
        code = main([str(word) for word in words])
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return call


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Recordings:
    """Two motions of the simulated UR5, one of them also as a CSV of ur_rtde's kind."""
    folder = tmp_path_factory.mktemp("recordings")
    robot = dynid.load_robot("ur5")
    paths: list[Path] = []
    for name, seed in (("identification", 1), ("validation", 2)):
        motion = dynid.random_excitation(robot.limits, seed=seed)
        record = dynid.simulate_recording(robot, motion, seed=seed)
        paths.append(folder / f"{name}.parquet")
        dynid.write_record(record, paths[-1])
        if name == "validation":
            write_rtde_csv(record, folder / "validation.csv")
    estimate = folder / "estimate.json"
    words = ["identify", paths[0], "-o", estimate, "--preset", "paper", "--validate", paths[1]]
    assert main([str(word) for word in words]) == 0
    return Recordings(paths[0], paths[1], folder / "validation.csv", estimate)
