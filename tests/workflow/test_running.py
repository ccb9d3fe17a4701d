"""`dynid run --on sim` and its Python twin: records, passes, stops, refusals."""

from __future__ import annotations

import errno
import json
import os
import signal
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dynid.bench import urdf
from dynid.cli.app import main
from dynid.core import InputError, JobError, provenance
from dynid.drivers import Abort, Outcome, SimulatedDriver
from dynid.recording import read_record
from dynid.robot import load_robot
from dynid.settings import IdentifySettings, options_of, parse_thermal
from dynid.signals import measured_torque
from dynid.trajectory import write_trajectory
from dynid.workflow import (
    RunSettings,
    identify_files,
    open_records,
    run_design,
    simulate_recording,
)
from rest_motions import rest_series

UR5 = load_robot("ur5")
PERIOD, CYCLES = 2.0, 250
MIDDLE = np.array([0.1, -1.4, 0.3, -2.1, 0.2, 0.1])


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("design") / "design.json"
    free = 0.05 * np.random.default_rng(0).normal(size=(6, 4))
    series = rest_series(PERIOD, MIDDLE, free)
    made = provenance(seed=0)
    write_trajectory(series, path, robot="ur5", limits=UR5.limits, provenance=made)
    return path


def test_a_run_makes_a_record_that_says_where_it_comes_from(design: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    run = run_design(design, path, settings=RunSettings(repeat=2, seed=5))
    data = run.to_json()
    assert {name: data[name] for name in ("samples", "periods", "gaps", "aborted", "record")} == {
        "samples": 2 * CYCLES,
        "periods": 2,
        "gaps": 0,
        "aborted": False,
        "record": str(path),
    }
    record = read_record(path)
    assert record.metadata.robot == "ur5"
    assert record.metadata.joint_names == UR5.joint_names
    extra = record.metadata.extra
    assert (extra["seed"], extra["periods"], float(extra["period_s"])) == ("5", "2", PERIOD)
    assert len(extra["design_sha256"]) == 64
    assert record.problems == ()
    np.testing.assert_allclose(record.t, np.arange(2 * CYCLES) / 125.0, rtol=0, atol=1e-12)


def test_a_record_tells_the_gains_that_its_robot_does_not(tmp_path: Path) -> None:
    """Without them nothing can be identified from the currents of a simulated URDF arm."""
    robot, design = tmp_path / "arm.urdf", tmp_path / "design.json"
    robot.write_text(urdf("sliding"))
    arm = load_robot(robot)
    series = rest_series(PERIOD, np.array([0.0, 0.0, 0.1, 0.0]), np.zeros((4, 4)))
    write_trajectory(
        series, design, robot=str(robot), limits=arm.limits, provenance=provenance(seed=0)
    )
    run_design(design, tmp_path / "run.parquet")
    for record in (read_record(tmp_path / "run.parquet"), simulate_recording(arm, series)):
        assert np.isfinite(measured_torque(record, arm)).all()


@pytest.mark.usefixtures("undiagnosed_once")
def test_identification_takes_the_mounting_of_the_run(design: Path, tmp_path: Path) -> None:
    """Also where the robot is named, unless `--mount` or its file says another."""
    path = tmp_path / "run.parquet"
    run_design(design, path, settings=RunSettings(mount="wall"))
    for robot in (None, "ur5"):
        found = identify_files([path], robot=robot, settings=IdentifySettings(preset="paper"))
        assert found.estimate.model.robot.mount == "wall"
        assert open_records([path], robot)[1].mount == "wall"
    ceiling = IdentifySettings(preset="paper", mount="ceiling")
    found = identify_files([path], robot="ur5", settings=ceiling)
    np.testing.assert_allclose(found.estimate.model.robot.gravity, -UR5.gravity)


def test_the_truth_stands_beside_the_record_and_not_in_it(design: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    run_design(design, path, settings=RunSettings(repeat=1))
    truth = json.loads((tmp_path / "run_truth.json").read_text())
    assert np.shape(truth["links"]) == (6, 13)
    assert len(truth["mean_degC"]) == 6
    record = read_record(path)
    text = str(record.metadata) + str(record.channels.keys())
    assert "truth" not in text
    assert "friction" not in text


def test_thermal_states_show_in_the_record(design: Path, tmp_path: Path) -> None:
    means: dict[str, float] = {}
    for name, thermal in (("cold", "cold"), ("warm", "warm"), ("given", 30.0)):
        path = tmp_path / f"{name}.parquet"
        run_design(design, path, settings=RunSettings(repeat=1, thermal=thermal))
        means[name] = float(read_record(path).signals["temperature"].mean())
    assert means["cold"] == pytest.approx(24.0, abs=0.5)
    assert means["given"] == pytest.approx(30.0, abs=0.5)
    assert means["warm"] > 30.0
    path = tmp_path / "after.parquet"
    run_design(design, path, settings=RunSettings(repeat=1, warm_up_s=1800.0))
    assert means["cold"] + 0.1 < read_record(path).signals["temperature"].mean()


def test_the_simulated_arm_carries_its_payload(design: Path, tmp_path: Path) -> None:
    links: list[np.ndarray] = []
    for name, payload in (("empty", None), ("loaded", (2.5, 0.0, 0.0, 0.1))):
        path = tmp_path / f"{name}.parquet"
        run_design(design, path, settings=RunSettings(repeat=1, payload=payload))
        links.append(np.array(json.loads((tmp_path / f"{name}_truth.json").read_text())["links"]))
        carried = read_record(path).metadata.extra["payload_kg"]
        assert float(carried) == (0.0 if payload is None else 2.5)
    assert links[1][-1, 0] - links[0][-1, 0] == pytest.approx(2.5)
    np.testing.assert_array_equal(links[0][:5, 0], links[1][:5, 0])


def test_slow_and_settling_passes_are_not_recorded(design: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    told: list[str] = []
    run = run_design(
        design,
        path,
        settings=RunSettings(repeat=2, settle=True, slow=0.5),
        progress=lambda what, share: told.append(what),
    )
    assert run.result.outcome.samples == 2 * CYCLES
    targets = read_record(path).signals["target_q"].reshape(2, CYCLES, 6)
    np.testing.assert_allclose(targets[0], targets[1], rtol=0, atol=1e-12)
    assert told


def test_the_command_prints_its_keys(
    design: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", design, "-o", tmp_path / "run.parquet", "--repeat", 1, "--json"]
    assert main([str(word) for word in words]) == 0
    captured = capsys.readouterr()
    data = json.loads(captured.out)
    assert {"samples", "periods", "gaps", "aborted", "record"} <= set(data)
    assert captured.err == ""


def test_rows_of_an_interrupted_run_are_kept_and_told(
    design: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before, kept = (tmp_path / f"run.parquet.partial{end}" for end in ("", ".1"))
    before.write_bytes(b"rows")
    path = tmp_path / "run.parquet"
    assert main(["run", str(design), "-o", str(path), "--repeat", "1", "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["left"] == str(kept)
    assert str(kept) in captured.err
    assert kept.read_bytes() == b"rows"


def test_ctrl_c_keeps_the_record(
    design: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.parquet"
    partial = tmp_path / "run.parquet.partial"
    ended = threading.Event()

    def interrupt() -> None:
        # Rows reach the file in blocks: once it grows, the arm moves.
        while not ended.is_set() and not (partial.exists() and partial.stat().st_size > 50_000):
            ended.wait(0.001)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    code = main(["run", str(design), "-o", str(path), "--repeat", "100", "--json"])
    ended.set()
    thread.join()
    captured = capsys.readouterr()
    assert code == 1
    assert "it was interrupted" in captured.err
    data = json.loads(captured.out)
    assert (data["aborted"], data["cause"]["code"]) == (True, "interrupted")
    record = read_record(path)
    assert record.samples == data["samples"]
    assert 10 < record.samples < 100 * CYCLES
    (found,) = record.problems
    assert found.kind == "aborted"
    assert "it was interrupted" in found.text


def test_a_stop_after_the_last_sample_leaves_its_periods_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    execute = SimulatedDriver.execute

    def stopped(self: SimulatedDriver, *args: Any, **more: Any) -> Outcome:
        outcome = execute(self, *args, **more)
        return replace(outcome, abort=Abort("safety", "somebody pressed the emergency stop"))

    monkeypatch.setattr(SimulatedDriver, "execute", stopped)
    cycles = 2007
    series = rest_series(16.056, MIDDLE, np.zeros((6, 4)))
    assert series.duration * 125.0 > cycles, "the product is rounded up"
    asked = RunSettings(robot="ur5", repeat=1)
    outcome = run_design(series, tmp_path / "run.parquet", settings=asked).result.outcome
    assert (outcome.samples, outcome.periods) == (cycles, 1)


def test_a_run_that_is_stopped_at_once_leaves_nothing(design: Path, tmp_path: Path) -> None:
    cancel = threading.Event()
    cancel.set()
    run = run_design(design, tmp_path / "run.parquet", cancel=cancel)
    with pytest.raises(JobError, match="nothing is kept"):
        run.raise_if_aborted()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("room", [3_000, 150_000])
def test_a_full_disk_keeps_what_fitted(
    design: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    room: int,
) -> None:
    path = tmp_path / "run.parquet"
    write, written = os.write, [0]

    def refuse(file: int, data: bytes) -> int:
        if "run.parquet" in os.readlink(f"/proc/self/fd/{file}"):
            written[0] += len(data)
            if written[0] > room:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(file, data)

    monkeypatch.setattr(os, "write", refuse)
    code = main(["run", str(design), "-o", str(path), "--repeat", "5"])
    monkeypatch.undo()
    assert code == 1
    message = capsys.readouterr().err
    assert "No space left on device" in message
    assert len(message.strip().splitlines()) == 1
    # The recording is there, its draft is not; or nothing is.
    assert ".partial -o" not in message
    if room < 150_000:
        assert message.endswith("nothing is kept\n")
        assert list(tmp_path.iterdir()) == []
        return
    record = read_record(path)
    assert 100 < record.samples <= room / (8 * 50)
    assert f"{record.samples} samples are kept in {path}" in message


def test_no_rows_are_said_to_be_kept_where_there_are_none(
    design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.parquet"

    def refuse(*_: object, **__: object) -> None:
        (tmp_path / "run.parquet.partial").unlink()
        raise JobError("the recording cannot be written")

    monkeypatch.setattr("dynid.recording.store.write_record", refuse)
    run = run_design(design, path, settings=RunSettings(repeat=1))
    assert run.record is None
    assert run.to_json()["samples"] == 0
    with pytest.raises(JobError, match="nothing is kept"):
        run.raise_if_aborted()


def test_a_disk_that_refuses_the_end_loses_no_rows(
    design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.parquet"

    def refuse(*_: object, **__: object) -> None:
        raise JobError("the recording cannot be written", value="No space left on device")

    monkeypatch.setattr("dynid.recording.store.write_record", refuse)
    run = run_design(design, path, settings=RunSettings(repeat=1))
    monkeypatch.undo()
    assert run.abort is not None
    assert run.abort.code == "recording"
    with pytest.raises(JobError, match=r"No space left.*250 samples are kept"):
        run.raise_if_aborted()
    assert read_record(path).samples == CYCLES


def test_nothing_is_replaced_unasked(design: Path, tmp_path: Path) -> None:
    path, cancel = tmp_path / "run.parquet", threading.Event()
    run_design(design, path, settings=RunSettings(repeat=1))
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"exists.*force=True"):
        run_design(design, path, settings=RunSettings(repeat=1, seed=1))
    assert path.read_bytes() == before
    forced = RunSettings(repeat=1, seed=1, force=True)
    assert run_design(design, path, settings=forced).record == path
    after = path.read_bytes()
    assert after != before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run.parquet", "run_truth.json"]

    def stop(what: str, share: float) -> None:
        if what and share > 0.3:
            cancel.set()

    long = RunSettings(repeat=20, force=True)
    run = run_design(design, path, settings=long, cancel=cancel, progress=stop)
    assert run.record == tmp_path / "run.aborted-1.parquet"
    assert path.read_bytes() == after
    record = read_record(run.record)
    assert record.samples == run.result.outcome.samples > 10
    assert [finding.kind for finding in record.problems] == ["aborted"]
    # The truth alone is a file too.
    path.unlink()
    with pytest.raises(InputError, match="run_truth"):
        run_design(design, path)


def test_a_disk_without_room_is_seen_before_anything_moves(
    design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=1_200_000))
    with pytest.raises(JobError, match="no room"):
        run_design(design, tmp_path / "run.parquet", settings=RunSettings(repeat=5))
    assert list(tmp_path.iterdir()) == []


def test_an_ipv6_address_may_stand_in_brackets(
    design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hosts = list[str]()

    def nobody(host: str) -> None:
        hosts.append(host)
        raise JobError("nobody is there")

    monkeypatch.setattr("dynid.drivers.inspect", nobody)
    for on in ("ur://[::1]", "ur://::1"):
        with pytest.raises(JobError, match="nobody"):
            run_design(design, tmp_path / "run.parquet", on=on)
    assert hosts == ["::1", "::1"]


def test_bad_settings_are_refused(design: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    for settings in (
        RunSettings(mount="moon"),
        RunSettings(robot="ur99"),
    ):
        with pytest.raises(InputError):
            run_design(design, path, settings=settings)
    for on in ("ur5", "ur://", "http://127.0.0.1", "ur://a/b", "ur://10.0.0.1:30004", "ur://a:1"):
        with pytest.raises(InputError, match=r"sim, ur://HOST.*no port"):
            run_design(design, path, on=on)
    with pytest.raises(InputError, match="warm_up_s"):
        RunSettings(warm_up_s=-1.0)
    with pytest.raises(InputError, match="method"):
        RunSettings(method="magic")
    with pytest.raises(InputError, match="method: the simulated arm"):
        run_design(design, path, settings=RunSettings(method="servoj"))
    for share in (0.0, 2.0, float("nan")):
        with pytest.raises(InputError, match="slow"):
            RunSettings(slow=share)
    with pytest.raises(InputError, match="repeat"):
        RunSettings(repeat=0)
    for word in ("hot", "nan", "500", "-300"):
        with pytest.raises(InputError, match="thermal"):
            parse_thermal(word)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words",
    [
        ("run", "DESIGN"),
        ("run", "DESIGN", "-o", "OUT.csv"),
        ("run", "DESIGN", "-o", "OUT", "--thermal", "tepid"),
        ("run", "DESIGN", "-o", "OUT", "--payload", "heavy"),
        ("run", "DESIGN", "-o", "OUT", "--repeat", "0"),
        ("run", "missing.json", "-o", "OUT"),
    ],
)
def test_bad_usage_is_one_line_and_exit_2(
    design: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
) -> None:
    places = {"DESIGN": str(design), "OUT": str(tmp_path / "run.parquet")}
    places["OUT.csv"] = str(tmp_path / "run.csv")
    assert main([places.get(word, word) for word in words]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_words_of_the_command_line() -> None:
    assert parse_thermal("cold") == "cold"
    assert parse_thermal("31.5") == 31.5
    options = options_of(RunSettings)
    for option, text, value in (
        ("payload", "1.5,0,0.01,0.05", (1.5, 0.0, 0.01, 0.05)),
        ("payload", "2", (2.0, 0.0, 0.0, 0.0)),
        ("floor", "none", "none"),
        ("floor", "-0.8", -0.8),
        ("tool", "0,0,0.3", (0.0, 0.0, 0.3)),
    ):
        assert options[option].read(text) == value
    for text in ("0,0", "a,b,c", "0,0,inf"):
        with pytest.raises(InputError, match="tool"):
            options["tool"].read(text)
    with pytest.raises(InputError, match="floor"):
        options["floor"].read("low")
    with pytest.raises(InputError, match="accept_unjudged"):
        RunSettings(accept_unjudged=("everything",))
    for one in ("self-collision", ("self-collision",)):
        assert RunSettings(accept_unjudged=one).accept_unjudged == ("self_collision",)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="hot"):
        RunSettings(thermal="hot")
    for text in ("-1", "1,2", "1,2,3,nan", "inf", ""):
        with pytest.raises(InputError, match="payload"):
            options["payload"].read(text)
