"""A fleet with known changes: which joint, from when, and what is only temperature or gain."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pyarrow.parquet as parquet
import pytest

import dynid
from dynid.bench import Plant, motion, plant
from dynid.cli.app import main
from dynid.identification import (
    IdentificationProblem,
    JointState,
    friction_names,
    holm,
    judge,
    record_statistics,
    repeated_motions,
    shared_names,
    solve_robot,
    trend,
)
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.signals import process
from dynid.workflow import identify_files, report

START = datetime(2026, 1, 5, tzinfo=UTC)
RATE_HZ, LENGTH_S, DAYS = 100.0, 4.0, 12
WORN, RISE = 1, 1.4
"""The joint of arm b whose friction rises from the day `CHANGED` on."""
CHANGED = 7
DAY_S = 86400.0


def write(
    folder: Path,
    name: str,
    real: Plant,
    day: int,
    *,
    factor: float,
    gain: float,
    mount: str = "file",
    worn: int = WORN,
    program: int | None = None,
    still: tuple[int, ...] = (),
) -> None:
    draw = np.random.default_rng([day, len(name)])
    chosen = day % 2 if program is None else program
    moved = motion(real.robot, "fourier", chosen, RATE_HZ, LENGTH_S)
    stays = np.isin(np.arange(real.robot.joints), still)
    moved = replace(
        moved,
        q=np.where(stays, moved.q[0], moved.q),
        dq=np.where(stays, 0.0, moved.dq),
        ddq=np.where(stays, 0.0, moved.ddq),
    )
    rigid = real.torque(moved.q, moved.dq, moved.ddq)
    warm = 25.0 + 8.0 * draw.random(real.robot.joints)
    friction = real.friction(moved.dq, rigid, 1 / RATE_HZ) * np.exp(-0.02 * (warm - 29.0))
    friction[:, worn] *= factor
    torque = rigid + friction + draw.normal(0, real.torque_noise, rigid.shape)
    torque[:, worn] *= gain
    record = dynid.ExperimentRecord(
        t=moved.t,
        signals={"q": moved.q, "effort": torque, "temperature": warm + 0 * rigid},
        metadata=dynid.RecordMetadata(robot="ur5", extra={"mount": mount}),
    )
    place = folder / name / f"{(START + timedelta(days=day)).date()}"
    place.mkdir(parents=True)
    dynid.write_record(record, place / "excitation.parquet")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fleet")
    for name, seed in (("arm a", 1), ("arm b", 2)):
        real = plant(dynid.load_robot("ur5"), seed)
        for day in range(DAYS):
            late = day >= CHANGED
            write(
                folder / "recordings",
                name,
                real,
                day,
                factor=RISE if late and name == "arm b" else 1.0,
                gain=1.3 if late and name == "arm a" else 1.0,
            )
    return folder


@pytest.fixture(scope="module")
def found(data: Path) -> dynid.Fleet:
    return dynid.fleet(data / "recordings", data / "out")


def test_friction_that_rose_is_told_from_a_gain_that_drifted(found: dynid.Fleet) -> None:
    alarms = {(joint.robot, joint.joint): joint for joint in found.alarms}
    assert {place: joint.alarm for place, joint in alarms.items()} == {
        ("arm a", WORN): "torque_scale",
        ("arm b", WORN): "friction_drift",
    }
    # The friction of a joint goes with its gain.
    assert alarms["arm a", WORN].change_percent[0] == pytest.approx(30, abs=5)
    _, low, high = alarms["arm b", WORN].change_percent
    assert low < 100 * (RISE - 1) < high
    assert high - low < 30
    series = alarms["arm b", WORN].friction
    assert series is not None
    assert series.step_at == CHANGED
    assert series.per_kelvin / series.before == pytest.approx(-0.02, abs=0.01)


def test_an_alarm_does_not_hide_what_the_gain_did(tmp_path: Path) -> None:
    real = plant(dynid.load_robot("ur5"), 1)
    for day in range(DAYS):
        factor, gain = (1.7, 1.1) if day >= CHANGED else (1.0, 1.0)
        write(tmp_path / "all", "a", real, day, factor=factor, gain=gain, worn=0)
    result = dynid.fleet(tmp_path / "all", tmp_path / "out")
    (alarm,) = result.alarms
    assert (alarm.alarm, alarm.joint) == ("friction_drift", 0)
    assert alarm.control_p <= result.settings.false_alarms
    assert alarm.control is not None
    change = f"the torque of the inertias by {100 * alarm.control.change:+.1f} %"
    assert [change in finding.message for finding in result.findings] == [True]


def test_table_holds_shared_inertias_and_a_friction_state_a_day(found: dynid.Fleet) -> None:
    table = parquet.read_table(found.output / "estimates.parquet").to_pylist()
    shared = [row for row in table if row["recording"] is None]
    assert {row["robot"] for row in shared} == {"arm a", "arm b"}
    assert len(shared) == 2 * (52 - 12)
    days = [row for row in table if row["robot"] == "arm b" and row["name"] == "Fc2"]
    assert [row["time"].date() for row in days] == [
        (START + timedelta(days=day)).date() for day in range(DAYS)
    ]


def held(found: dynid.Fleet, real: Plant, robot: str) -> np.ndarray:
    """(6) errors of gravity in a pose, of the shared inertias of a robot [N.m]."""
    table = parquet.read_table(found.output / "estimates.parquet").to_pylist()
    still = np.zeros((1, 6))
    q = np.array([[0.3, -0.5, 0.8, 0.2, 0.4, 0.1]])
    base = dynid.reduce_model(dynid.InverseDynamicModel(robot=real.robot))
    value = {row["name"]: row["value"] for row in table if row["robot"] == robot}
    torque = -real.torque(q, still, still)[0]
    for k, name in enumerate(base.names):
        if not name.startswith(("Fc", "Fv")):
            column = base.model.stack(q, still, still)[base.independent[k]]
            torque += value[name] * np.asarray(column).reshape(6)
    return torque


def test_inertias_are_those_of_the_arm(found: dynid.Fleet) -> None:
    # What both arms share with their published model, gravity of the big links, within 15 %.
    assert held(found, plant(dynid.load_robot("ur5"), 2), "arm b") == pytest.approx(0, abs=1.0)


def test_an_arm_on_the_ceiling_is_identified_as_it_was_mounted(tmp_path: Path) -> None:
    real = plant(dynid.load_robot("ur5", mount="ceiling"), 2)
    for day in range(2):
        write(tmp_path / "all", "c", real, day, factor=1.0, gain=1.0, mount="ceiling")
    found = dynid.fleet(tmp_path / "all", tmp_path / "out")
    assert held(found, real, "c") == pytest.approx(0, abs=1.5)
    # Two days are no trend, and that is said.
    assert found.tests == 0
    assert [(one.kind, one.value) for one in found.findings] == [("not_diagnosed", 1.0)]
    # One that says something else is left out; where none are most, nobody knows which.
    write(tmp_path / "all", "c", real, 2, factor=1.0, gain=1.0)
    again = dynid.fleet(tmp_path / "all", tmp_path / "out")
    assert len(again.recordings) == 2
    ((path, why),) = again.skipped
    assert "ceiling" in why
    assert path in again.to_json()["skipped"][0]
    write(tmp_path / "all", "c", real, 3, factor=1.0, gain=1.0)
    with pytest.raises(dynid.InputError, match="mountings"):
        dynid.fleet(tmp_path / "all", tmp_path / "out")


@pytest.mark.parametrize("days", [2, 5])
def test_a_recording_of_another_sign_is_left_out(tmp_path: Path, days: int) -> None:
    """One of two may be either."""
    real = plant(dynid.load_robot("ur5"), 1)
    for day in range(days):
        write(tmp_path / "all", "a", real, day, factor=1.0, gain=1.0)
    wrong = sorted((tmp_path / "all").rglob("*.parquet"))[days // 2]
    record = dynid.read_record(wrong)
    turned = {**record.signals, "effort": -record.signals["effort"]}
    dynid.write_record(replace(record, signals=turned), wrong, force=True)
    found = dynid.fleet(tmp_path / "all", tmp_path / "out")
    expected = [str(wrong.relative_to(tmp_path / "all"))] if days > 2 else []
    assert [name for name, _ in found.skipped] == expected
    assert len(found.recordings) == days - len(expected)


def test_a_reference_beyond_the_recordings_is_told(data: Path, found: dynid.Fleet) -> None:
    del found
    for degrees, told in ((29.0, False), (90.0, True)):
        settings = dynid.FleetSettings(reference_degC=degrees)
        again = dynid.fleet(data / "recordings", data / "out", settings=settings)
        assert ("extrapolated" in {one.kind for one in again.findings}) == told


def test_second_run_computes_new_recordings_only(data: Path, found: dynid.Fleet) -> None:
    assert found.computed == 2 * DAYS
    write(
        data / "recordings",
        "arm b",
        plant(dynid.load_robot("ur5"), 2),
        DAYS,
        factor=RISE,
        gain=1.0,
    )
    again = dynid.fleet(data / "recordings", data / "out")
    assert (again.computed, len(again.recordings)) == (1, 2 * DAYS + 1)
    damaged = next((data / "out" / "statistics").glob("*.npz"))
    damaged.write_bytes(damaged.read_bytes()[:1000])
    assert dynid.fleet(data / "recordings", data / "out").computed == 1


def test_a_copy_with_other_stamps_is_left_out(tmp_path: Path) -> None:
    real = plant(dynid.load_robot("ur5"), 1)
    for day in range(2):
        write(tmp_path, "arm", real, day, factor=1.0, gain=1.0)
    source = next(tmp_path.glob("arm/2026-01-05/*"))
    record = dynid.read_record(source)
    t = (record.t + 1.7e9) - 1.7e9
    assert (t != record.t).any()
    copy = tmp_path / "arm/2026-03-01/excitation.parquet"
    copy.parent.mkdir()
    dynid.write_record(replace(record, t=t), copy)
    for _ in range(2):
        found = dynid.fleet(tmp_path, tmp_path / "out")
        assert len(found.recordings) == 2
        said = "the same recording as arm/2026-01-05/excitation.parquet"
        assert found.skipped == (("arm/2026-03-01/excitation.parquet", said),)


def test_state_for_dashboards_and_page(found: dynid.Fleet) -> None:
    metrics = (found.output / "state.prom").read_text().splitlines()
    assert 'dynid_alarm{robot="arm b",joint="2"} 1' in metrics
    assert sum(line.startswith("dynid_friction{") for line in metrics) == 12
    assert len((found.output / "state.csv").read_text().splitlines()) == 13
    page = (found.output / "report.html").read_text()
    assert page.count("days since 2026-01-05") >= 2
    assert "Shoulder lift: friction [N·m], step +" in page
    assert "about 2026-01-12 00:00 UTC, p 0.0" in page
    assert page.count('<span class="no">1 alarm') == 2
    assert not re.search(r"(src|href)=", page)


@pytest.mark.parametrize(
    ("name", "minute"),
    [
        ("2026-01-31", "00:00:00"),
        ("2026-01-31_0830", "08:30:00"),
        ("2026-01-31_08-30-15", "08:30:15"),
        ("2026-01-31T08-30", "08:30:00"),
        ("2026-01-31T08-30-15", "08:30:15"),
        ("2026-01-31 08-30 run 2", "08:30:00"),
        ("arm/2026-01-31/2026-01-31_0830", "08:30:00"),
    ],
)
def test_the_name_of_a_file_tells_its_time(
    data: Path, tmp_path: Path, name: str, minute: str
) -> None:
    folder = tmp_path / "recordings"
    file = folder / f"{name}.parquet"
    file.parent.mkdir(parents=True)
    one = next((data / "recordings" / "arm a").rglob("*.parquet"))
    file.write_bytes(one.read_bytes())
    told = dynid.fleet(folder, tmp_path / "out").to_json()
    assert told["robots"][0]["first"] == f"2026-01-31T{minute}+00:00"


def test_what_recordings_do_not_say_is_told_and_a_manifest_says_it(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "flat"
    folder.mkdir()
    for k, path in enumerate(sorted((data / "recordings" / "arm a").rglob("*.parquet"))[:2]):
        (folder / f"{k}.parquet").write_bytes(path.read_bytes())
    (folder / "notes.csv").write_text("no recording\n")
    nameless = dynid.fleet(folder, tmp_path / "out")
    kinds = {finding.kind for finding in nameless.findings}
    assert kinds == {"another_robot", "clock_mismatch", "not_diagnosed"}
    assert [name for name, _ in nameless.skipped] == ["notes.csv"]
    for k in range(60):
        (folder / f"notes{k}.csv").write_text("no recording\n")
    assert main(["fleet", str(folder), "-o", str(tmp_path / "out")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("0 alarms in 0 trends")
    assert lines[1] == "2 recordings of 1 robot: 0 computed, 2 from the cache, 61 left out"
    assert len(lines) <= 40
    assert "ur5 without a name" in " ".join(lines)
    assert lines[-1].startswith("Next: open ")
    assert main(["fleet", str(folder), "-o", str(tmp_path / "out"), "--all"]) == 0
    assert sum("left out notes" in line for line in capsys.readouterr().out.splitlines()) == 61
    (folder / "manifest.csv").write_text(
        "file,robot,time\n0.parquet,r7,2026-02-01\n1.parquet,r7,2026-02-02T08:00:00+01:00\n"
    )
    assert main(["fleet", str(folder), "-o", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["computed"], told["cached"]) == (0, 2)
    assert [finding["kind"] for finding in told["findings"]] == ["not_diagnosed"]
    assert told["robots"][0]["robot"] == "r7"
    assert told["robots"][0]["last"] == "2026-02-02T07:00:00+00:00"
    (folder / "manifest.csv").write_text(
        "file,robot,time\n0.parquet,r7,2026-02-01\n1.parquet,r7,\n"
    )
    assert main(["fleet", str(folder), "-o", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert str(told["robots"][0]["last"]).startswith("2026-02-01")


@pytest.mark.usefixtures("undiagnosed_once")
def test_recordings_in_an_object_store(
    data: Path, found: dynid.Fleet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store, days = fsspec.filesystem("memory"), ["2026-01-05", "2026-01-06"]
    store.rm("/", recursive=True)

    def put(day: str) -> None:
        path = f"arm a/{day}/excitation.parquet"
        store.pipe_file(f"/lab/{path}", (data / "recordings" / path).read_bytes())

    for day in days:
        put(day)
    store.pipe_file("/lab/.hidden/x.parquet", b"no recording")
    store.pipe_file(
        "/lab/manifest.csv", f"file,robot\narm a/{days[0]}/excitation.parquet,r7".encode()
    )
    first = dynid.fleet("memory://lab", tmp_path / "out")
    assert [(one.path[:16], one.robot) for one in first.recordings] == [
        (f"arm a/{days[1]}", "arm a"),
        (f"arm a/{days[0]}", "r7"),
    ]
    put("2026-01-07")
    store.pipe_file("/lab/bad.parquet", b"no recording")
    again = dynid.fleet("memory://lab", tmp_path / "out")
    assert (again.computed, len(again.recordings)) == (1, 3)
    assert [name for name, _ in again.skipped] == ["bad.parquet"]
    same = {one.path: one.statistics.factors for one in found.recordings}
    for one in again.recordings:
        np.testing.assert_array_equal(one.statistics.factors, same[one.path])
    words = ["identify", "--json", "--preset", "paper", "--validate"]
    records = [f"memory://lab/arm a/{day}/excitation.parquet" for day in days]
    local = [str(data / "recordings" / url.removeprefix("memory://lab/")) for url in records]
    assert main([*words, *records]) == 0
    told = json.loads(capsys.readouterr().out)
    assert main([*words, *local]) == 0
    assert told["parameters"] == json.loads(capsys.readouterr().out)["parameters"]


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("memory://nowhere", "there is nothing below this folder"),
        ("nostore://lab", "the object store cannot be opened"),
        ("simplecache::memory://lab", "there is no such folder"),
        ("memory://lab::file:///etc", "chained URLs are not taken"),
    ],
)
def test_an_object_store_that_holds_nothing(place: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(dynid.InputError, match=words):
        dynid.fleet(place, tmp_path / "out")
    with pytest.raises(dynid.InputError):
        identify_files([f"{place}/run.parquet"])


def test_a_file_is_no_fleet_and_no_folder_of_a_report(tmp_path: Path) -> None:
    file = tmp_path / "my arm" / "estimate.json"
    file.parent.mkdir()
    file.write_text("{}")
    with pytest.raises(dynid.InputError, match="this is a file, and a fleet is"):
        dynid.fleet(file, tmp_path / "out")
    with pytest.raises(dynid.InputError, match=f"Run: dynid report '{file.parent}'"):
        report(file, tmp_path / "report.html")


@pytest.mark.parametrize("least", [0.5, 0.02])
def test_false_alarms_come_at_the_stated_rate(least: float) -> None:
    draw, count = np.random.default_rng(5), 400
    p_values = []
    for _ in range(count):
        time_s = DAY_S * np.arange(20.0)
        std = np.exp(draw.uniform(np.log(least), np.log(2.0), 20))
        warm = 25 + 5 * draw.random(20)
        # What differs between recordings is not in their deviations.
        true = np.hypot(std, 0.2)
        values = 10.0 - 0.3 * (warm - 27) + true * draw.normal(size=20)
        found = trend(time_s, values, std, warm, 27.0)
        assert found is not None
        p_values.append(found.p_value)
    for rate in (0.05, 0.2, 0.5):
        band = 3 * np.sqrt(rate * (1 - rate) / count)
        assert np.mean(np.array(p_values) <= rate) == pytest.approx(rate, abs=band)
    assert holm([0.01, 0.04, 0.03]).tolist() == pytest.approx([0.03, 0.06, 0.06])


def test_intervals_of_few_recordings_hold_what_they_say() -> None:
    draw, held = np.random.default_rng(0), []
    time_s, none, late = DAY_S * np.arange(8.0), np.full(8, np.nan), np.arange(8) >= 4
    for _ in range(400):
        values = 10.0 + 3.0 * late + draw.normal(0.0, 0.3, 8)
        found = trend(time_s, values, np.full(8, 0.1), none, 27.0, permutations=1)
        assert found is not None
        held.append(abs(found.change - 3.0) < 1.96 * found.change_std)
    assert np.mean(held) == pytest.approx(0.95, abs=0.03)


@pytest.mark.parametrize("step", [0.0, 3.0])
def test_the_level_now_is_as_far_off_as_stated(step: float) -> None:
    draw, away = np.random.default_rng(6), []
    time_s, late = DAY_S * np.arange(20.0), np.arange(20) >= 12
    for _ in range(200):
        std, warm = draw.uniform(0.1, 0.6, 20), draw.normal(25.0, 3.0, 20)
        program = draw.integers(0, 3, 20)
        true = 10.0 + 2.0 * program.mean() + step
        values = 10.0 - 0.3 * (warm - 27) + 2.0 * program + step * late + std * draw.normal(size=20)
        state = JointState(
            robot="a", joint=0, name="j", unit="N.m", reference_speed=1.0, control=None,
            friction=trend(time_s, values, std, warm, 27.0, motion=program, permutations=1),
            alarm="friction_drift" if step else "",
        )  # fmt: skip
        away.append(abs(state.now - true) / state.now_std)
    assert np.mean(np.array(away) < 1.96) == pytest.approx(0.95, abs=0.06)


def test_a_trace_of_the_control_does_not_make_friction_a_gain() -> None:
    draw = np.random.default_rng(4)
    time_s, none, std = DAY_S * np.arange(24.0), np.full(24, np.nan), np.full(24, 0.001)

    def state(robot: str, friction: float, control: float, day: int = 15) -> JointState:
        series = [
            trend(
                time_s,
                1 + share * (time_s >= day * DAY_S) + draw.normal(0, 0.001, 24),
                std,
                none,
                27.0,
            )
            for share in (friction, control)
        ]
        return JointState(
            robot=robot, joint=0, name="j", unit="N.m", reference_speed=1.0,
            friction=series[0], control=series[1],
        )  # fmt: skip

    drift, scale = "friction_drift", "torque_scale"
    changes: dict[tuple[Any, ...], str] = {
        ("a", 0.26, -0.006): drift, ("b", 0.3, 0.3): scale, ("c", 0.3, 0.2): scale,
        # A load moves the controls of other joints, and looks like friction, too.
        ("d", 0.6, 0.0): scale, ("d", 0.0, 0.1): scale, ("e", 0.6, 0.0): drift,
        ("f", 0.6, 0.0): drift, ("f", 0.0, 0.1, 8): scale,
    }  # fmt: skip
    states, tests = judge([state(*change) for change in changes], 0.05)
    assert tests == 2 * len(changes)
    assert [one.alarm for one in states] == list(changes.values())


def test_that_no_alarm_is_possible_is_told(data: Path, found: dynid.Fleet) -> None:
    assert not [item for item in found.findings if item.kind == "not_diagnosed"]
    strict = dynid.FleetSettings(false_alarms=1e-4)
    (told,) = (
        item
        for item in dynid.fleet(data / "recordings", data / "strict", strict).findings
        if item.kind == "not_diagnosed"
    )
    assert "arm a, arm b" in told.text


def test_another_program_is_not_another_friction() -> None:
    draw = np.random.default_rng(3)
    time_s, none = DAY_S * np.arange(24.0), np.full(24, np.nan)
    program = np.repeat([0, 1, 0, 1], [4, 4, 6, 10])
    values = 10.0 + 2.0 * program + 0.1 * draw.normal(size=24)
    alone = trend(time_s, values, np.full(24, 0.1), none, 27.0)
    told = trend(time_s, values, np.full(24, 0.1), none, 27.0, motion=program)
    assert alone is not None
    assert told is not None
    assert alone.p_value < 0.01
    assert told.p_value > 0.05
    speeds = np.array([[1.0, 0.5], [1.005, 0.5], [2.0, 0.1], [0.995, 0.503], [3.0, 0.1]])
    assert repeated_motions(speeds).tolist() == [0, 0, -1, 0, -1]
    # Of a joint at rest the encoder's noise is recorded.
    at_rest = np.array([[2e-4], [3e-4], [1e-4], [2e-4], [2e-4]])
    assert repeated_motions(np.hstack([speeds, at_rest])).tolist() == [0, 0, -1, 0, -1]


def test_a_joint_that_stands_still_has_not_lost_its_friction(tmp_path: Path) -> None:
    real = plant(dynid.load_robot("ur5"), 1)
    for day in range(20):
        still = (4, 5) if day >= 15 else ()
        write(tmp_path / "in", "arm", real, day, factor=1.0, gain=1.0, program=day, still=still)
    found = dynid.fleet(tmp_path / "in", tmp_path / "out")
    assert not found.alarms
    last = found.joints[5]
    assert last.friction is not None
    assert len(last.friction.time_s) == 15
    assert last.reference_speed > 0.1


def test_a_motor_that_drives_two_joints_has_its_friction_in_both() -> None:
    robot, draw = dynid.load_robot("ur5"), np.random.default_rng(2)
    coupling = np.diag([101.0, 101.0, 101.0, 80.0, 80.0, 50.0])
    coupling[5, 4] = -50.0
    robot = replace(robot, drives=replace(robot.drives, coupling=coupling))
    model = InverseDynamicModel(robot=robot)
    base = reduce_model(model)
    links = np.nan_to_num(robot.inertias, nan=0.01).ravel()
    truth = np.concatenate([links, draw.uniform(0.5, 2.0, len(model.columns) - len(links))])
    told = []
    for seed in range(3):
        moved = motion(robot, "fourier", seed, RATE_HZ, 10.0)
        torque = model.inverse_dynamics(moved.q, moved.dq, moved.ddq, truth)
        signals = {"q": moved.q, "qd": moved.dq, "effort": draw.normal(torque, 0.1)}
        samples = process(dynid.ExperimentRecord(t=moved.t, signals=signals), robot)
        told.append(record_statistics(IdentificationProblem(base=base, samples=samples)))
    states = solve_robot(told)
    known = dict(zip(base.names, base.from_standard(truth), strict=True))
    assert {"Fcm6", "Fvm6"} <= set(friction_names(base)[5])
    for j, names in enumerate(friction_names(base)):
        for f, name in enumerate(names):
            assert states.friction[:, j, f] == pytest.approx(known[name], abs=0.03)
    shared = [known[name] for name in shared_names(base)]
    assert states.shared == pytest.approx(shared, abs=0.03)
    assert states.noise == pytest.approx(0.1, rel=0.1)
    assert not states.strange.any()
    # What hardly shows inertias is of any arm.
    off = np.array([[-1.0], [0.2], [0.2]]) + 0 * states.scale
    doubted = replace(states, scale=off, scale_std=np.array([[0.1], [0.05], [0.2]]) + 0 * off)
    assert doubted.strange.tolist() == [True, True, False]


PENDULUM = """
[[joint]]
name = "swing"
rpy = [1.5707963267948966, 0.0, 0.0]

[drives]
gain = [{gain}]
"""


def test_other_gains_in_the_robot_s_file_are_other_torques(tmp_path: Path) -> None:
    robot, t = tmp_path / "pendulum.toml", np.arange(1000) / 100.0
    q = np.sin(2 * np.pi * 0.5 * t) + 0.3 * np.sin(2 * np.pi * 1.3 * t)
    dq = np.gradient(q, t)
    draw, current = np.random.default_rng(0), 2.0 * np.sign(dq) + dq + np.sin(q)
    for day in range(2):
        noisy = current + 0.01 * draw.normal(size=len(t))
        record = dynid.ExperimentRecord(t=t, signals={"q": q[:, None], "current": noisy[:, None]})
        place = tmp_path / "all" / "p" / f"2026-01-0{day + 1}"
        place.mkdir(parents=True)
        dynid.write_record(record, place / "swing.parquet")
    settings = dynid.FleetSettings(robot=str(robot))
    found: list[dict[str, float]] = []
    for gain in (10.0, 20.0):
        robot.write_text(PENDULUM.format(gain=gain))
        result = dynid.fleet(tmp_path / "all", tmp_path / "out", settings)
        assert result.computed == 2
        table = parquet.read_table(tmp_path / "out" / "estimates.parquet").to_pylist()
        found.append({row["name"]: row["value"] for row in table})
    assert found[1]["Fc1"] == pytest.approx(2 * found[0]["Fc1"], rel=1e-6)
