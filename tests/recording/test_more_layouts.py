"""Layouts of Simulink, pandas, Excel, KUKA and Franka; and what is never loaded."""

from __future__ import annotations

import gzip
import json
import lzma
import pickle
import zipfile
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import pytest
import scipy.io
from recorded_motions import Motion

from dynid.core import RecordError
from dynid.recording import read_recording
from dynid.robot import load_robot

MOTION = Motion(samples=400, start=10.0)
T = MOTION.t
Q, QD, CURRENT = MOTION.position(T), MOTION.velocity(T), MOTION.current(T)
TABLE = MOTION.table()
HEADER = MOTION.header()
UR5 = load_robot("ur5")


def assert_true(record: Any, torque: str = "effort", atol: float = 1e-9) -> None:
    np.testing.assert_allclose(record.t, T - T[0], atol=1e-6)
    np.testing.assert_allclose(record.signals["q"], Q, atol=atol)
    np.testing.assert_allclose(record.signals[torque], CURRENT, atol=atol)


def write_text(path: Path, names: list[str], table: np.ndarray, sign: str = ",") -> Path:
    rows = [sign.join(names), *(sign.join(repr(float(x)) for x in row) for row in table)]
    path.write_text("\n".join(rows) + "\n")
    return path


def write_workbook(path: Path, *sheets: list[list[object]]) -> Path:
    """A workbook as ECMA-376 says: texts shared, rows without values left out."""
    texts: list[str] = []

    def cell(place: str, value: object) -> str:
        if isinstance(value, datetime):
            days = (value - datetime(1899, 12, 30)) / timedelta(days=1)
            return f'<c r="{place}" s="1"><v>{days!r}</v></c>'
        if isinstance(value, str) and value == "#DIV/0!":
            return f'<c r="{place}" t="e"><v>{value}</v></c>'
        if isinstance(value, str):
            texts.append(value)
            return f'<c r="{place}" t="s"><v>{len(texts) - 1}</v></c>'
        return "" if value is None else f'<c r="{place}"><v>{value!r}</v></c>'

    def letters(k: int) -> str:
        return (chr(64 + k // 26) if k >= 26 else "") + chr(65 + k % 26)

    name_space = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
        listed = "".join(
            f'<sheet name="run {k}" sheetId="{k + 1}" r:id="r{k}"/>' for k in range(len(sheets))
        )
        book = f'<workbook {name_space} xmlns:r="{office}"><sheets>{listed}</sheets></workbook>'
        archive.writestr("xl/workbook.xml", book)
        parts = {f"r{k}": ("worksheet", f"worksheets/sheet{k + 1}.xml") for k in range(len(sheets))}
        parts["texts"] = ("sharedStrings", "sharedStrings.xml")
        parts["styles"] = ("styles", "styles.xml")
        # The second style is that of a date with its time.
        styles = '<cellXfs count="2"><xf numFmtId="0"/><xf numFmtId="22"/></cellXfs>'
        archive.writestr("xl/styles.xml", f"<styleSheet {name_space}>{styles}</styleSheet>")
        for place, targets in (
            ("_rels/.rels", {"book": ("officeDocument", "xl/workbook.xml")}),
            ("xl/_rels/workbook.xml.rels", parts),
        ):
            links = "".join(
                f'<Relationship Id="{name}" Type="{office}/{kind}" Target="{target}"/>'
                for name, (kind, target) in targets.items()
            )
            package = "http://schemas.openxmlformats.org/package/2006/relationships"
            archive.writestr(place, f'<Relationships xmlns="{package}">{links}</Relationships>')
        for k, rows in enumerate(sheets):
            lines = "".join(
                f'<row r="{n}">{"".join(cell(f"{letters(j)}{n}", x) for j, x in enumerate(row))}'
                "</row>"
                for n, row in enumerate(rows, 1)
                if row
            )
            data = f"<worksheet {name_space}><sheetData>{lines}</sheetData></worksheet>"
            archive.writestr(f"xl/worksheets/sheet{k + 1}.xml", data)
        shared = "".join(f"<si><t>{escape(text)}</t></si>" for text in texts)
        archive.writestr("xl/sharedStrings.xml", f"<sst {name_space}>{shared}</sst>")
    return path


def test_pipes_between_columns(tmp_path: Path) -> None:
    record = read_recording(write_text(tmp_path / "x.psv", HEADER, TABLE, "|"))
    assert record.problems == ()
    assert_true(record, "current")


@pytest.mark.parametrize("packed", [False, True])
def test_arrays_with_named_fields(tmp_path: Path, packed: bool) -> None:
    fields = [("t", "f8"), ("q", "f8", 6), ("tau", "f4", 6), ("label", "U3")]
    table = np.zeros(len(T), dtype=fields)
    table["t"], table["q"], table["tau"] = T, Q, CURRENT
    path = tmp_path / ("x.npz" if packed else "x.npy")
    if packed:
        np.savez(path, log=table)
    else:
        np.save(path, table)
    record = read_recording(path)
    assert record.problems == ()
    assert_true(record, atol=1e-6)


@pytest.mark.parametrize("rows_first", [True, False])
def test_the_time_beside_each_signal(tmp_path: Path, rows_first: bool) -> None:
    """To File puts the time into the first row, To Workspace into the first column."""
    found = {
        name: np.column_stack([T, value]) for name, value in (("q_log", Q), ("tau_log", CURRENT))
    }
    scipy.io.savemat(tmp_path / "x.mat", {k: v.T if rows_first else v for k, v in found.items()})
    for robot in (UR5, None):
        record = read_recording(tmp_path / "x.mat", robot=robot)
        assert record.joints == 6
        assert "the time" in record.metadata.extra["notes"]
        assert_true(record)
    named = read_recording(tmp_path / "x.mat", columns="q=q_log,effort=tau_log")
    assert_true(named)


def test_a_joint_that_only_turns_forwards_is_no_time(tmp_path: Path) -> None:
    q = Q.copy()
    q[:, 0] = T / 10
    np.savez(tmp_path / "x.npz", t=T, q=q, tau=CURRENT)
    for robot in (UR5, None):
        record = read_recording(tmp_path / "x.npz", robot=robot)
        np.testing.assert_array_equal(record.signals["q"], q)


def test_axes_of_length_one(tmp_path: Path) -> None:
    """Signals of a vector are written as (n, 1, N)."""

    def logged(value: np.ndarray) -> dict[str, Any]:
        return {"time": T[:, None], "signals": {"values": value.T[:, None, :]}}

    scipy.io.savemat(tmp_path / "x.mat", {"q": logged(Q), "tau": logged(CURRENT)})
    np.savez(tmp_path / "x.npz", t=T, q=Q[:, None, :], tau=CURRENT[:, :, None])
    for name in ("x.mat", "x.npz"):
        assert_true(read_recording(tmp_path / name, robot=UR5))


def test_cells_of_one_vector_a_joint(tmp_path: Path) -> None:
    cells = np.empty((1, 6), dtype=object)
    for joint in range(6):
        cells[0, joint] = Q[:, joint]
    scipy.io.savemat(tmp_path / "x.mat", {"t": T, "q": cells, "tau": CURRENT})
    assert_true(read_recording(tmp_path / "x.mat"))
    # MATLAB 7.3 writes cells as references.
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["t"], store = T[None], file.create_group("#refs#")
        for name, values in {"q": Q, "tau": CURRENT}.items():
            for joint in range(6):
                store[f"{name}{joint}"] = values[None, :, joint]
            cells = [[store[f"{name}{joint}"].ref] for joint in range(6)]
            file.create_dataset(name, data=cells, dtype=h5py.ref_dtype)
    assert_true(read_recording(tmp_path / "x.h5"))


def test_json_of_pandas(tmp_path: Path) -> None:
    rows = TABLE.tolist()
    content = {
        name: {str(i): row[k] for i, row in enumerate(rows)} for k, name in enumerate(HEADER)
    }
    (tmp_path / "x.json").write_text(json.dumps(content))
    record = read_recording(tmp_path / "x.json")
    assert record.problems == ()
    assert_true(record, "current")


def test_hdf5_of_pandas(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "x.h5", "w") as file:
        group = file.create_group("df")
        group["axis0"] = np.array(HEADER, dtype="S")
        group["axis1"] = np.arange(len(T))
        group["block0_items"] = np.array(HEADER, dtype="S")
        group["block0_values"] = TABLE
    record = read_recording(tmp_path / "x.h5")
    assert record.problems == ()
    assert_true(record, "current")


def test_kuka_data_recorder(tmp_path: Path) -> None:
    """Names carry the robot's, time is in two columns, external torques stand beside."""
    arm = Motion(samples=400, joints=7, rate=1000.0)
    q, tau = arm.position(arm.t), arm.current(arm.t)
    kinds = ("axisQMsr", "axisQCmd", "axisTauExtMsr", "axisTauMsr")
    names = ["ZeitInSec", "ZeitInNanoSec"]
    names += [f"{kind}_LBR_iiwa_7_R800_1[{k}]" for kind in kinds for k in range(7)]
    lines = [" ".join(names)]
    for k, stamp in enumerate(np.round(arm.t * 1e9).astype(int).tolist()):
        numbers = np.concatenate([q[k], q[k] + 0.1, 0.2 * tau[k], tau[k]])
        lines.append(
            f"{stamp // 10**9} {stamp % 10**9} " + " ".join(map(repr, map(float, numbers)))
        )
    (tmp_path / "x.log").write_text("\n".join(lines) + "\n")
    record = read_recording(tmp_path / "x.log")
    assert record.problems == ()
    np.testing.assert_allclose(record.t, arm.t - arm.t[0], atol=1e-6)
    np.testing.assert_array_equal(record.signals["q"], q)
    np.testing.assert_array_equal(record.signals["effort"], tau)
    np.testing.assert_array_equal(record.signals["target_q"], q + 0.1)


def test_kuka_sensor_interface(tmp_path: Path) -> None:
    names = ["IPOC", *(f"{kind}.A{k}" for kind in ("AIPos", "MACur") for k in range(1, 7))]
    table = np.column_stack([4_208_163_634 + 8 * np.arange(len(T)), np.degrees(Q), CURRENT])
    path = write_text(tmp_path / "x.csv", names, table, ";")
    record = read_recording(path, robot=UR5, degrees=True)
    assert [problem.code for problem in record.problems] == ["unit_suspect"]
    assert "in ms" in record.problems[0].message
    assert_true(record, "current")


def test_log_of_libfranka(tmp_path: Path) -> None:
    """Commanded and external torques stand beside the measured ones; time is in ms."""
    arm = Motion(samples=400, joints=7, rate=1000.0)
    q, qd, tau = arm.position(arm.t), arm.velocity(arm.t), arm.current(arm.t)
    parts = {
        **{"state.q": q, "state.q_d": q + 0.1, "state.dq": qd, "state.dq_d": qd + 0.1},
        **{"state.tau_J": tau, "state.tau_ext_hat_filtered": 0.2 * tau, "cmd.q_d": q},
        **{"cmd.dq_d": qd, "cmd.O_T_EE_d": np.zeros((400, 16)), "cmd.tau_J_d": 0.1 * tau},
    }
    names = ["time", " success_rate"]
    names += [f"{name}[{k}]" for name, value in parts.items() for k in range(value.shape[1])]
    head = np.column_stack([5000 + np.arange(400), np.ones(400)])
    path = write_text(tmp_path / "x.csv", names, np.hstack([head, *parts.values()]))
    record = read_recording(path)
    assert [problem.code for problem in record.problems] == ["unit_suspect"]
    assert record.rate_hz == pytest.approx(1000)
    np.testing.assert_array_equal(record.signals["q"], q)
    np.testing.assert_array_equal(record.signals["qd"], qd)
    np.testing.assert_array_equal(record.signals["effort"], tau)


def test_titles_with_numbers_above_the_header(tmp_path: Path) -> None:
    path = write_text(tmp_path / "x.csv", HEADER, TABLE)
    path.write_text("Sampling rate,125\nRobot,UR5\n\n" + path.read_text())
    record = read_recording(path)
    assert record.problems == ()
    assert_true(record, "current")


def test_workbooks(tmp_path: Path) -> None:
    rows: list[list[object]] = [["Run of", "2021"], [], list(HEADER), *TABLE.tolist()]
    notes: list[list[object]] = [["robot", "UR5"], ["samples", 400]]
    record = read_recording(write_workbook(tmp_path / "x.xlsx", rows, notes))
    assert record.problems == ()
    assert_true(record, "current")
    # An error is no value; a name may begin as one.
    rows[2] = [f"#{name}" for name in HEADER]
    assert read_recording(write_workbook(tmp_path / "x.xlsx", rows)).samples == 400
    rows[2] = list(HEADER)
    rows[103][3], rows[203][14] = None, "#DIV/0!"
    record = read_recording(write_workbook(tmp_path / "x.xlsx", rows))
    assert record.samples == 398
    assert "line 104" in record.problems[0].message
    with pytest.raises(RecordError, match=r"2 sheets of numbers.*run 0.*CSV"):
        read_recording(write_workbook(tmp_path / "x.xlsx", rows, rows))
    with pytest.raises(RecordError, match="no sheets of numbers"):
        read_recording(write_workbook(tmp_path / "x.xlsx", notes))


def test_a_workbook_whose_first_stamp_is_midnight_keeps_its_row(tmp_path: Path) -> None:
    midnight = datetime(2024, 3, 1)
    stamped = [
        [midnight + timedelta(milliseconds=8 * k), *row[1:]] for k, row in enumerate(TABLE.tolist())
    ]
    rows: list[list[object]] = [list(HEADER), *stamped]
    record = read_recording(write_workbook(tmp_path / "x.xlsx", rows))
    assert record.samples == len(TABLE)
    assert record.problems == ()


@pytest.mark.parametrize("suffix", [".xlsx", ".csv.gz", ".csv.xz", ".zip", ".csv.zst"])
def test_damaged_packing_is_one_error_wherever_it_shows(tmp_path: Path, suffix: str) -> None:
    plain = write_text(tmp_path / "x.csv", HEADER, TABLE)
    path = tmp_path / f"x{suffix}"
    if suffix == ".xlsx":
        write_workbook(path, [list(HEADER), *TABLE.tolist()])
    elif suffix == ".zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.write(plain, "x.csv")
    else:
        zstd = pytest.importorskip("backports.zstd") if suffix == ".csv.zst" else None
        pack = {".csv.gz": gzip.compress, ".csv.xz": lzma.compress}.get(suffix)
        path.write_bytes(pack(plain.read_bytes()) if pack else zstd.compress(plain.read_bytes()))
    data = path.read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(12):
        broken = bytearray(data)
        for place in rng.integers(10, len(data), 8).tolist():
            broken[place] ^= int(rng.integers(1, 256))
        path.write_bytes(bytes(broken))
        with pytest.raises(RecordError):
            read_recording(path)


@pytest.mark.parametrize("protocol", range(6))
def test_pickles_are_never_loaded(tmp_path: Path, protocol: int) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps({"t": T, "q": Q, "tau": CURRENT}, protocol=protocol))
    with pytest.raises(RecordError, match=r"Python pickle.*to_parquet"):
        read_recording(path)
    np.save(tmp_path / "x.npy", {"t": T}, allow_pickle=True)  # pyright: ignore[reportArgumentType]
    with pytest.raises(RecordError, match=r"pickled Python objects.*savez"):
        read_recording(tmp_path / "x.npy")


@pytest.mark.parametrize("name", ["{1}[{0}]{2}", "/joint_states/{0}/{1}{2}", "{0}_{1}{2}"])
@pytest.mark.parametrize("suffix", [".npy", ".json", ".jsonl", ".h5"])
def test_arrays_of_joints_by_name_are_put_in_order(tmp_path: Path, name: str, suffix: str) -> None:
    """As in text tables; they were taken in the order of the file, and `_mNm` for N.m."""
    order = [4, 1, 5, 0, 2, 3]
    columns = {"t": T}
    for word, unit, values in (
        ("position", "_deg", np.degrees(Q)),
        ("torque", "_mNm", 1e3 * CURRENT),
    ):
        columns |= {name.format(UR5.joint_names[k], word, unit): values[:, k] for k in order}
    cells = np.column_stack(list(columns.values())).tolist()
    rows = [dict(zip(columns, row, strict=True)) for row in cells]
    table = np.array([tuple(row.values()) for row in rows], dtype=[(key, float) for key in columns])
    path = tmp_path / f"a{suffix}"
    if suffix == ".h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            file["log"] = table
    elif suffix == ".npy":
        np.save(path, table)
    else:
        lines = [json.dumps(row) for row in rows]
        path.write_text("\n".join(lines) if suffix == ".jsonl" else f"[{','.join(lines)}]")
    record = read_recording(path, robot=UR5)
    assert record.metadata.joint_names == UR5.joint_names
    assert_true(record)
