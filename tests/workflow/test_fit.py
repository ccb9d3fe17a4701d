"""The whole job in one command: logs of a foreign make to a model, a report and a verdict."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.core import InputError, JobError
from dynid.recording import ExperimentRecord, open_record, read_record, write_record
from dynid.robot import load_robot
from dynid.workflow import IdentifySettings, fit
from dynid.workflow.recordings import known_gains

PAPER = IdentifySettings(preset="paper")


def simulated(name: str, seed: int) -> ExperimentRecord:
    robot = load_robot(name)
    motion = dynid.random_excitation(robot.limits, acceleration=8.0, seed=seed)
    return dynid.simulate_recording(robot, motion, seed=seed)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A lab's CSV of a UR5: a clock, angles in degrees, currents in A."""
    record = simulated("ur5", 1)
    path = tmp_path_factory.mktemp("lab") / "lab.csv"
    names = [f"q{j} [deg]" for j in range(1, 7)] + [f"current{j} [A]" for j in range(1, 7)]
    values = np.hstack(
        [record.t[:, None], np.rad2deg(record.signals["q"]), record.signals["current"]]
    )
    np.savetxt(path, values, delimiter=",", header=",".join(["t [s]", *names]), comments="")
    return path


def test_a_log_becomes_a_model_a_report_and_a_verdict(log: Path, tmp_path: Path) -> None:
    robot = load_robot("ur5")
    # The recording has none, and those given go before the robot's.
    assert known_gains(open_record(log, robot), robot)[1] == "robot"
    gains = robot.drives.gain.tolist()
    found = fit("ur5", log, tmp_path / "out", gains=gains, settings=PAPER)
    estimate = dynid.read_estimate(found.estimate)
    record = read_record(found.records[0])
    assert record.metadata.robot == "ur5"
    assert found.gains_from == ("given",)
    assert record.metadata.drive_gains == tuple(gains)
    error = dynid.validate(estimate, record).metrics.relative_error_overall_percent
    assert error < 100 * 0.1
    assert {export.to for export in found.models} | dict(found.not_exported).keys() == {
        "urdf",
        "mjcf",
        "c",
    }
    assert all(export.path.stat().st_size for export in found.models)
    page = found.report.read_text(encoding="utf-8")
    assert "<html" in page[:500]
    # The page goes on from the models that lie beside it.
    written = [export.path.name for export in found.models]
    assert found.verdict.level == "usable"
    assert f"for simulators; beside this page: {', '.join(written)}." in page
    assert "dynid export" not in page
    keys = found.to_json()
    assert {"base_parameters", "training", "verdict", "report", "models"} <= keys.keys()


@pytest.mark.parametrize("name", ["estimate.json", "log_lab.parquet"])
def test_a_folder_that_holds_results_is_left_alone(log: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("{}")
    with pytest.raises(InputError, match="nothing is replaced"):
        fit("ur5", log, tmp_path, settings=PAPER)
    assert (tmp_path / name).read_text() == "{}"


@pytest.mark.usefixtures("undiagnosed_once")
def test_what_did_not_end_is_replaced(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise JobError("the file cannot be written")

    monkeypatch.setattr("dynid.workflow.files.report", full)
    with pytest.raises(JobError):
        fit("ur5", log, tmp_path, settings=PAPER)
    monkeypatch.undo()
    assert fit("ur5", log, tmp_path, settings=PAPER).report.is_file()
    assert not (tmp_path / "unfinished.txt").exists()
    with pytest.raises(InputError, match="nothing is replaced"):
        fit("ur5", log, tmp_path, settings=PAPER)


@pytest.mark.usefixtures("undiagnosed_once")
def test_missing_gains_come_from_the_targets_of_the_controller(tmp_path: Path) -> None:
    record = simulated("ur3e", 2)
    record = replace(record, metadata=replace(record.metadata, drive_gains=None))
    write_record(record, tmp_path / "log.parquet")
    robot = load_robot("ur3e")
    unknown = replace(robot, drives=replace(robot.drives, gain=np.full(6, np.nan)))
    found = fit(unknown, tmp_path / "log.parquet", tmp_path / "out", settings=PAPER)
    assert found.gains_from == ("targets",)
    without = replace(
        record,
        signals={k: v for k, v in record.signals.items() if not k.startswith("target_")},
    )
    write_record(without, tmp_path / "bare.parquet")
    with pytest.raises(InputError, match="neither the robot nor the recording"):
        fit(unknown, tmp_path / "bare.parquet", tmp_path / "bare", settings=PAPER)
    given = open_record(tmp_path / "bare.parquet", unknown, [10.0] * 6)
    assert known_gains(given, unknown) == (given, "recording")
