"""Recordings of physical robots, where they are at hand (`../shared/data`)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynid.core import RecordError
from dynid.recording import read_record, read_recording, write_record
from dynid.robot import Drives, load_robot

DATA = Path(__file__).parents[2].parent / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"the real recordings are not at {DATA}")
KUKA = (
    "t=rec.time_cont,q=rec.act_pos_mot_deg,qd=rec.act_vel_mot_deg_per_s,"
    "effort=rec.act_torque_abs_nm"
)
PANDA = [
    DATA / "panda_gaz" / f"exciting_traj_{part}.txt"
    for part in ("time", "positions", "velocity", "torques")
]
TX40 = [DATA / "tx40" / name for name in ("pos_read_data.csv", "curr_data.csv")]


def codes(record) -> list[str]:
    return [problem.code for problem in record.problems]


def test_ur10_bag(tmp_path: Path) -> None:
    path = DATA / "ur10_unisa" / "ur10_exciting_trajectory.db3"
    robot = load_robot(DATA / "ur10_unisa" / "ur10_robot.urdf")
    record = read_recording(path, robot=robot)
    assert record.samples == 3441
    assert record.joints == 6
    assert record.rate_hz == pytest.approx(125, rel=1e-6)
    assert record.duration_s == pytest.approx(27.52, abs=1e-6)
    assert record.metadata.joint_names == robot.joint_names
    assert codes(record) == []
    assert np.abs(record.signals["effort"]).max() > 50
    write_record(record, tmp_path / "x.parquet")
    np.testing.assert_array_equal(
        read_record(tmp_path / "x.parquet").signals["effort"], record.signals["effort"]
    )


@pytest.mark.parametrize("run", ["A", "B"])
def test_kuka_struct(run: str) -> None:
    path = DATA / "kr300_weigand" / run / "data.mat"
    record = read_recording(path, columns=KUKA)
    asked = read_recording(path, columns=KUKA, degrees=True)
    np.testing.assert_array_equal(asked.signals["q"], record.signals["q"])
    assert (record.samples, record.joints) == (2501, 6)
    assert record.rate_hz == pytest.approx(250)
    assert codes(record) == []
    assert 0.5 < np.abs(record.signals["q"]).max() < 1.4


def test_tx40_motor_side_with_a_coupled_wrist() -> None:
    ur5 = load_robot("ur5")
    coupling = np.diag([32.0, 32, 45, -48, 45, 32])
    coupling[5, 4] = 32
    drives = Drives(
        gain=np.full(6, np.nan),
        gear_ratio=np.full(6, np.nan),
        coupling=coupling,
        offset=np.array([0, -np.pi / 2, np.pi / 2, 0, 0, 0]),
        position_side="motor",
        torque_side="motor",
    )
    robot = replace(ur5, name="tx40", drives=drives)
    record = read_recording(TX40, robot=robot, columns="q=0:6,effort=6:12", rate_hz=5000)
    assert (record.samples, record.joints) == (45000, 6)
    assert record.duration_s == pytest.approx(9, abs=1e-3)
    assert np.abs(record.signals["q"]).max() < 2 * np.pi
    assert codes(record) == ["at_rest"]
    blind = read_recording(TX40, columns="q=0:6,effort=6:12", rate_hz=5000)
    assert codes(blind) == ["unit_suspect", "at_rest"]
    with pytest.raises(RecordError, match="rate_hz"):
        read_recording(TX40, columns="q=0:6,effort=6:12")
    named = read_recording(TX40[::-1], robot=robot, rate_hz=5000)
    assert set(named.signals) == {"q", "current"}
    assert "named by their files" in named.metadata.extra["notes"]
    np.testing.assert_array_equal(named.signals["q"], record.signals["q"])


def test_panda_one_number_a_line() -> None:
    record = read_recording(PANDA, columns="t=0,q=1:8,qd=8:15,effort=15:22")
    assert record.joints == 7
    assert 19_000 < record.samples <= 20_544
    assert record.samples + record.metadata.dropped_rows == 20_544
    assert record.rate_hz == pytest.approx(1000, rel=0.01)
    assert record.duration_s == pytest.approx(21, abs=0.01)
    assert "clock_jitter" in codes(record)
    assert "row by row as 7 columns" in record.metadata.extra["notes"]
    assert record.signals["q"][0].tolist()[:3] == [-0.9584, 0.5622, -1.4576]
    # The names of the files say it as well, in any order.
    robot = load_robot(Path(__file__).parents[2] / "examples" / "robots" / "panda.toml")
    named = read_recording(PANDA[::-1], robot=robot)
    for quantity in ("q", "qd", "effort"):
        np.testing.assert_array_equal(named.signals[quantity], record.signals[quantity])
    np.testing.assert_array_equal(named.t, record.t)
    clockless = [path for path in PANDA if "time" not in path.name]
    counted = read_recording(clockless, robot=robot, rate_hz=1000)
    assert counted.metadata.clock == "rate"
    assert counted.joints == 7


@pytest.mark.parametrize(
    # On 121 rows of the second, one torque sensor stands still while its joint moves.
    ("name", "rows"),
    [("RecordTrajectory_quadratic", 4945), ("RunTrajectory1", 1942 - 121)],
)
def test_kinova_header(name: str, rows: int) -> None:
    robot = load_robot(DATA / "kinova_gen3" / "gen3.urdf")
    record = read_recording(DATA / "kinova_gen3" / f"{name}.csv", robot=robot)
    assert record.joints == 7
    assert rows - 10 < record.samples <= rows
    assert record.rate_hz == pytest.approx(1000)
    assert set(record.signals) == {"q", "qd", "effort", "current", "temperature"}
    assert "unit_suspect" in codes(record)
    assert "torque_sm" in record.metadata.extra["notes"]


def test_documents_are_no_recordings() -> None:
    for path in (DATA / "README.md", DATA / "ur10_unisa" / "ur10_robot.urdf"):
        with pytest.raises(RecordError):
            read_recording(path)
    # Positions and currents of one run, by the names of the files.
    with pytest.raises(RecordError, match=r"no time.*rate_hz"):
        read_recording(DATA / "tx40")
    with pytest.raises(RecordError, match=r"2 files.*dynid import .*RunTrajectory1\.csv"):
        read_recording(DATA / "kinova_gen3")
    assert read_recording(DATA / "ur10_unisa").samples == 3441


@pytest.mark.parametrize("run", ["no5", "no6", "no7"])
def test_ur5_logs_of_one_run_by_their_own_times(run: str) -> None:
    """The files of a run differ by up to 50 rows and end in a cut line."""
    folder = DATA / "ur5_kufieta" / run
    record = read_recording(folder, robot=load_robot("ur5"))
    assert {"q", "qd", "current", "target_current", "target_moment"} <= set(record.signals)
    assert record.rate_hz == pytest.approx(125, rel=1e-6)
    # Currents and the motion at the same stamps, each as its own file has it.
    start = float(record.metadata.extra["t0"])
    for name, quantity in (
        ("q_actual", "q"),
        ("i_actual", "current"),
        ("m_target", "target_moment"),
    ):
        lines = (folder / f"log_{name}.csv").read_text().splitlines()
        cells = [line.split(",") for line in lines]
        table = np.array([row for row in cells if len(row) == 7], dtype=np.float64)
        rows = np.searchsorted(table[:, 0], record.t + start - 1e-6)
        np.testing.assert_array_equal(record.signals[quantity], table[rows, 1:])
    assert record.samples > 0.99 * 125 * record.duration_s


def test_cut_copies_of_a_real_bag_are_read(tmp_path: Path) -> None:
    """Whatever a cut leaves, its rows are those of the whole bag, each once."""
    source = DATA / "ur10_unisa" / "ur10_exciting_trajectory.db3"
    whole, data = read_recording(source), source.read_bytes()
    stamps = np.round(whole.t + float(whole.metadata.extra["t0"]), 6)
    rng = np.random.default_rng(3)
    for share in (*rng.uniform(0.05, 1.0, 9), 0.81):
        path = tmp_path / "cut.db3"
        path.write_bytes(data[: int(share * len(data))])
        record = read_recording(path)
        own = np.round(record.t + float(record.metadata.extra["t0"]), 6)
        rows = np.searchsorted(stamps, own)
        np.testing.assert_array_equal(record.signals["q"], whole.signals["q"][rows])
        assert record.samples > 0.9 * share * whole.samples - 60
        assert "truncated_file" in codes(record)
