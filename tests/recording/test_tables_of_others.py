"""Compressed files, Parquet and Arrow tables of others, and named arrays laid out in other ways."""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
import tempfile
import zipfile
from datetime import datetime, timedelta
from decimal import Decimal
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import scipy.io
from pyarrow import feather, parquet
from recorded_motions import Motion, write_db3, write_mat, write_rtde_csv

from dynid.core import RecordError
from dynid.recording import content_kind, read_recording
from dynid.robot import load_robot
from dynid.workflow import open_records

MOTION = Motion(samples=400)
EXACT = 1e-12


def check(record, *, atol: float = EXACT) -> None:
    assert record.problems == ()
    assert record.samples == MOTION.samples
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.t[0], atol=1e-6)
    np.testing.assert_allclose(record.signals["q"], MOTION.position(MOTION.t), atol=atol)
    name = "effort" if "effort" in record.signals else "current"
    np.testing.assert_allclose(record.signals[name], MOTION.current(MOTION.t), atol=atol)


def zipped(data: bytes, path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("folder/run.csv", data)


PACKERS = {
    ".gz": lambda data, path: path.write_bytes(gzip.compress(data)),
    ".bz2": lambda data, path: path.write_bytes(bz2.compress(data)),
    ".xz": lambda data, path: path.write_bytes(lzma.compress(data)),
    ".zip": zipped,
}


@pytest.mark.parametrize("suffix", PACKERS)
def test_compressed_files(tmp_path: Path, suffix: str) -> None:
    plain = write_rtde_csv(MOTION, tmp_path / "run.csv")
    path = tmp_path / f"run.csv{suffix}"
    PACKERS[suffix](plain.read_bytes(), path)
    record = read_recording(path)
    check(record, atol=1e-6)
    assert record.metadata.origin == str(path)
    assert record.metadata.input_hash != read_recording(plain).metadata.input_hash
    # Commands that take recordings as they are take these too.
    records, robot = open_records([path], "ur5")
    assert (records[0].samples, robot.name) == (MOTION.samples, "ur5")


def test_zstd_and_binary_formats(tmp_path: Path) -> None:
    zstd = pytest.importorskip("backports.zstd")
    for plain in (write_mat(MOTION, tmp_path / "x.mat"), write_db3(MOTION, tmp_path / "x.db3")):
        path = plain.with_name(plain.name + ".zst")
        path.write_bytes(zstd.compress(plain.read_bytes()))
        check(read_recording(path))


@pytest.mark.parametrize("suffix", PACKERS)
def test_damaged_packing_is_one_error(tmp_path: Path, suffix: str) -> None:
    plain = write_rtde_csv(MOTION, tmp_path / "run.csv")
    path = tmp_path / f"run.csv{suffix}"
    PACKERS[suffix](plain.read_bytes(), path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(RecordError, match=r"damaged|none of the formats"):
        read_recording(path)


def test_an_archive_of_several_files_says_what_to_do(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "x.zip", "w") as archive:
        archive.writestr("a.csv", "1")
        archive.writestr("b.csv", "2")
    with pytest.raises(RecordError, match=r"several files.*a\.csv.*unzip x\.zip"):
        read_recording(tmp_path / "x.zip")


def test_archives_of_macos_and_with_a_password(tmp_path: Path) -> None:
    path = tmp_path / "x.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(write_rtde_csv(MOTION, tmp_path / "run.csv"), "run.csv")
        archive.writestr("__MACOSX/._run.csv", "notes")
    assert read_recording(path).samples == MOTION.samples
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.csv", "1")
    data = bytearray(path.read_bytes())
    # The flags, in the member's own header and in the directory.
    for start, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(start) + at] |= 1
    path.write_bytes(data)
    with pytest.raises(RecordError, match=r"has a password.*unzip x\.zip"):
        read_recording(path)


def test_nothing_is_left_of_what_was_unpacked(tmp_path: Path, monkeypatch) -> None:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    path = write_rtde_csv(Motion(samples=50), tmp_path / "x.csv")
    (tmp_path / "x.gz").write_bytes(gzip.compress(path.read_bytes()))
    assert read_recording(tmp_path / "x.gz").samples == 50
    assert list(folder.iterdir()) == []


def columns(lists: bool) -> dict[str, object]:
    t = MOTION.t
    parts = {"q": MOTION.position(t), "dq": MOTION.velocity(t), "tau": MOTION.current(t)}
    if lists:
        return {"timestamp": t, **{f"observation.{k}": list(v) for k, v in parts.items()}}
    return {"time": t, **{f"{k}_{j}": v[:, j] for k, v in parts.items() for j in range(6)}}


@pytest.mark.parametrize("lists", [False, True])
@pytest.mark.parametrize("write", [parquet.write_table, feather.write_feather])
def test_typed_tables(tmp_path: Path, lists: bool, write) -> None:
    path = tmp_path / "x.bin"
    write(pa.table({"run": ["a"] * MOTION.samples, **columns(lists)}), path)
    assert content_kind(path) == "arrow"
    check(read_recording(path, robot=load_robot("ur5")))
    check(read_recording(path, format="parquet"))
    if not lists:
        check(read_recording(path, columns="t=0,q=1:7,effort=13:19"))


def test_decimals_of_databases(tmp_path: Path) -> None:
    decimals = {
        name: pa.array([Decimal(f"{x:.12f}") for x in values])
        for name, values in columns(lists=False).items()
    }
    parquet.write_table(pa.table(decimals), tmp_path / "x.parquet")
    check(read_recording(tmp_path / "x.parquet"))


@pytest.mark.parametrize(
    "kind", ["datetime64[ms]", "datetime64[us]", "datetime64[ns]", "timedelta64[ns]"]
)
@pytest.mark.parametrize("suffix", [".parquet", ".npz"])
def test_times_of_typed_tables(tmp_path: Path, kind: str, suffix: str) -> None:
    ticks = np.round(MOTION.t * 1e3).astype("timedelta64[ms]")
    if kind.startswith("datetime"):
        ticks = ticks + np.datetime64("2024-03-01")
    path = tmp_path / f"x{suffix}"
    table = {**columns(False), "time": ticks.astype(kind)}
    if suffix == ".npz":
        np.savez(path, allow_pickle=False, **table)
    else:
        parquet.write_table(pa.table(table), path)
    record = read_recording(path)
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.t[0], atol=1.1e-3)
    assert record.rate_hz == pytest.approx(125, rel=1e-3)


@pytest.mark.parametrize("form", ["%Y-%m-%dT%H:%M:%S.%fZ", "%H:%M:%S.%f"])
@pytest.mark.parametrize("suffix", [".parquet", ".json", ".npz"])
def test_times_in_words(tmp_path: Path, form: str, suffix: str) -> None:
    """From before midnight on, with one that is missing."""
    start = datetime(2024, 3, 1, 23, 59, 58)
    words = [(start + timedelta(seconds=x)).strftime(form) for x in (MOTION.t - MOTION.t[0])]
    words[7] = ""
    table = {**columns(lists=False), "time": words, "run": ["a"] * MOTION.samples}
    path = tmp_path / f"x{suffix}"
    if suffix == ".npz":
        np.savez(path, allow_pickle=False, **table)
    elif suffix == ".json":
        path.write_text(json.dumps({k: np.asarray(v).tolist() for k, v in table.items()}))
    else:
        parquet.write_table(pa.table(table), path)
    record = read_recording(path)
    np.testing.assert_allclose(record.t, np.delete(MOTION.t, 7) - MOTION.t[0], atol=1e-6)


def test_a_time_of_day_in_a_typed_table(tmp_path: Path) -> None:
    ticks = pa.array(np.round(MOTION.t * 1e6).astype(np.int64), type=pa.time64("us"))
    parquet.write_table(pa.table({**columns(False), "time": ticks}), tmp_path / "x.parquet")
    check(read_recording(tmp_path / "x.parquet"))


def test_a_typed_table_without_positions_names_its_columns(tmp_path: Path) -> None:
    parquet.write_table(pa.table({"a": [1.0, 2.0], "b": ["x", "y"]}), tmp_path / "x.parquet")
    with pytest.raises(RecordError, match=r"got a\..*columns"):
        read_recording(tmp_path / "x.parquet")


def arrays(layout: str) -> dict[str, object]:
    t = MOTION.t
    q, qd, tau = MOTION.position(t), MOTION.velocity(t), MOTION.current(t)
    if layout == "one vector a joint":
        out: dict[str, object] = {"t": t}
        for k in range(6):
            out |= {f"q{k + 1}": q[:, k], f"dq{k + 1}": qd[:, k], f"tau{k + 1}": tau[:, k]}
        return out
    if layout == "struct array":
        joint = np.zeros(6, dtype=[("pos", "O"), ("vel", "O"), ("tau", "O")])
        for k in range(6):
            joint[k] = (q[:, k], qd[:, k], tau[:, k])
        return {"joint": joint, "time": t}
    if layout == "signals with time":
        return {
            name: {"time": t[:, None], "signals": {"values": value, "dimensions": 6}}
            for name, value in (("q", q), ("dq", qd), ("tau", tau))
        }
    if layout == "beside parameters":
        para = {"q_back": np.ones(6), "tau_max": np.ones(6), "K_pos": np.ones(6)}
        return {"para": para, "data": {"Q": q.T, "Qp": qd.T, "Tau": tau.T, "t": t[None]}}
    return {
        "rec": {"q_deg": np.degrees(q), "dq_rpm": qd * 30 / np.pi, "tau_mNm": tau * 1e3, "t": t}
    }


@pytest.mark.parametrize(
    "layout",
    [
        "one vector a joint",
        "struct array",
        "signals with time",
        "beside parameters",
        "units in names",
    ],
)
def test_layouts_of_matlab_files(tmp_path: Path, layout: str) -> None:
    scipy.io.savemat(tmp_path / "x.mat", arrays(layout), long_field_names=True)
    record = read_recording(tmp_path / "x.mat", robot=load_robot("ur5"))
    check(record, atol=1e-9)
    np.testing.assert_allclose(record.signals["qd"], MOTION.velocity(MOTION.t), atol=1e-9)


def test_measured_data_of_other_identification_tools(tmp_path: Path) -> None:
    """FloBaRoID's measurements, where filtered and raw signals stand side by side."""
    t = MOTION.t
    q, qd, tau = MOTION.position(t), MOTION.velocity(t), MOTION.current(t)
    np.savez(
        tmp_path / "x.npz",
        positions=q,
        positions_raw=q + 1,
        target_positions=q + 2,
        velocities=qd,
        velocities_raw=qd + 1,
        accelerations=0 * q,
        torques=tau,
        torques_raw=tau + 1,
        times=t,
        frequency=125.0,
    )
    check(read_recording(tmp_path / "x.npz", robot=load_robot("ur5")))


@pytest.mark.parametrize("matlab", [False, True])
def test_hdf5(tmp_path: Path, matlab: bool) -> None:
    h5py = pytest.importorskip("h5py")
    t = MOTION.t
    parts = {"q": MOTION.position(t), "qd": MOTION.velocity(t), "tau": MOTION.current(t)}
    path = tmp_path / "x.mat"
    with h5py.File(path, "w", userblock_size=512 if matlab else 0) as file:
        group = file.create_group("rec")
        for name, value in {"t": t[:, None], **parts}.items():
            # MATLAB's arrays stand transposed in the file.
            group.create_dataset(name, data=value.T if matlab else value, compression="gzip")
        group.create_dataset("label", data="a run")
        file.create_dataset("table", data=np.zeros(3, dtype=[("a", "f8"), ("b", "i4")]))
    if matlab:
        head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
        path.write_bytes(head + path.read_bytes()[128:])
    record = read_recording(path, robot=load_robot("ur5"))
    assert record.metadata.format == "hdf5"
    check(record)
    check(read_recording(path, columns="q=rec.q,t=rec.t,current=rec.tau", format="hdf5"))
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(RecordError, match="-v7"):
        read_recording(path)


def test_struct_arrays_in_hdf5(tmp_path: Path) -> None:
    """A field of a MATLAB struct array is a dataset of references, one an element."""
    h5py = pytest.importorskip("h5py")
    t = MOTION.t
    parts = {"pos": MOTION.position(t), "vel": MOTION.velocity(t), "tau": MOTION.current(t)}
    with h5py.File(tmp_path / "x.mat", "w") as file:
        file["time"] = t[None]
        joint, store = file.create_group("joint"), file.create_group("#refs#")
        for name, value in parts.items():
            field = joint.create_dataset(name, (6, 1), dtype=h5py.ref_dtype)
            for k in range(6):
                store[f"{name}{k}"] = value[None, :, k]
                field[k, 0] = store[f"{name}{k}"].ref
    check(read_recording(tmp_path / "x.mat", robot=load_robot("ur5")))


def test_paths_of_struct_arrays_and_cells_in_hdf5(tmp_path: Path) -> None:
    """Two runs are no joints; a user names one, or the cells of a list."""
    h5py = pytest.importorskip("h5py")
    t = MOTION.t
    parts = {"t": t, "q": MOTION.position(t).T, "tau": MOTION.current(t).T}
    with h5py.File(tmp_path / "x.mat", "w") as file:
        run, store = file.create_group("run"), file.create_group("#refs#")
        for name, value in parts.items():
            store[f"{name}1"], store[f"{name}2"] = 0.5 * value, value
            cells = [[store[f"{name}{k}"].ref] for k in (1, 2)]
            run.create_dataset(name, data=cells, dtype=h5py.ref_dtype)
        cells = [[store[f"{name}2"].ref] for name in parts]
        file.create_dataset("log", data=cells, dtype=h5py.ref_dtype)
    with pytest.raises(RecordError, match=r"t=run\(1\).t,q=run\(1\).q,effort=run\(1\).tau"):
        read_recording(tmp_path / "x.mat")
    for columns in ("t=run(2).t,q=run(2).q,effort=run(2).tau", "t=log(1),q=log(2),effort=log(3)"):
        check(read_recording(tmp_path / "x.mat", columns=columns))


@pytest.mark.parametrize("layout", ["arrays", "objects", "lines"])
def test_json(tmp_path: Path, layout: str) -> None:
    t = MOTION.t
    parts = {"q": MOTION.position(t), "qd": MOTION.velocity(t), "tau": MOTION.current(t)}
    rows = [
        {"time": x, "state": {name: value[k].tolist() for name, value in parts.items()}, "n": "a"}
        for k, x in enumerate(t.tolist())
    ]
    path = tmp_path / "x.json"
    if layout == "arrays":
        arrays = {name: value.tolist() for name, value in parts.items()}
        path.write_text(json.dumps({"robot": "x", "time": t.tolist(), **arrays}))
    elif layout == "objects":
        path.write_text(json.dumps(rows, indent=1))
    else:
        path.write_text("\n".join(map(json.dumps, rows)) + "\n")
    check(read_recording(path, robot=load_robot("ur5")))
    path.write_text(path.read_text()[:-20])
    if layout == "lines":
        cut = read_recording(path)
        assert cut.samples == MOTION.samples - 1
        assert [problem.kind for problem in cut.problems] == ["truncated_file"]
        return
    with pytest.raises(RecordError, match="JSON file is damaged") as caught:
        read_recording(path)
    # Where it is damaged: the arrays stand in one line.
    assert ("line 1 " in str(caught.value)) == (layout == "arrays")


@pytest.mark.parametrize("fault", ["half a line", "no key", "null"])
def test_a_faulty_line_of_json_costs_its_row_alone(tmp_path: Path, fault: str) -> None:
    path = messages(tmp_path / "x.jsonl")
    lines = path.read_text().splitlines()
    faulty = {"half a line": lines[7][:90], "no key": '{"effort": null}', "null": "null"}
    path.write_text("\n".join([*lines[:7], faulty[fault], *lines[8:]]))
    record = read_recording(path, robot=load_robot("ur5"))
    assert [problem.kind for problem in record.problems] == ["corrupt_rows"]
    there = np.delete(np.arange(MOTION.samples), 7)
    q = MOTION.position(MOTION.t[there])
    np.testing.assert_allclose(record.signals["q"], q, atol=EXACT)


@pytest.mark.parametrize("layout", ["columns", "objects", "lines"])
def test_null_in_json_is_a_missing_value(tmp_path: Path, layout: str) -> None:
    """Pandas writes NaN so, and loggers a message that did not come."""
    path = tmp_path / "x.json"
    if layout == "columns":
        table = {k: list(np.asarray(v, dtype=object)) for k, v in columns(lists=False).items()}
        table["q_2"][5] = table["tau_3"][9] = None
        path.write_text(json.dumps(table))
    else:
        table = columns(lists=True)
        named = {name.rpartition(".")[2]: np.asarray(v).tolist() for name, v in table.items()}
        rows = [dict(zip(named, row, strict=True)) for row in zip(*named.values(), strict=True)]
        rows[5]["q"] = rows[9]["tau"][3] = None
        text = json.dumps(rows) if layout == "objects" else "\n".join(map(json.dumps, rows))
        path.write_text(text)
    record = read_recording(path, robot=load_robot("ur5"))
    assert record.samples == MOTION.samples - 2
    assert [problem.kind for problem in record.problems] == ["corrupt_rows"]
    assert set(record.signals) == {"q", "qd", "effort"}


def test_json_that_is_no_recording(tmp_path: Path) -> None:
    for text in ('{"a": 1}', '{"a": [1, "x"]}', "[[1, 2], [3]]", "{" * 2000, '{"q": [NaN]}'):
        (tmp_path / "x.json").write_text(text)
        with pytest.raises(RecordError) as caught:
            read_recording(tmp_path / "x.json")
        assert "\n" not in str(caught.value)


def messages(path: Path) -> Path:
    """A file whose joints stand in another order, with a finger's among them, and their names."""
    robot, n = load_robot("ur5"), MOTION.samples
    order = [3, 0, 5, 1, 4, 2]
    names = [*(robot.joint_names[k] for k in order[:2]), "finger_joint"]
    names += [robot.joint_names[k] for k in order[2:]]
    q, tau = (
        np.insert(values[:, order], 2, 0.01, axis=1)
        for values in (MOTION.position(MOTION.t), MOTION.current(MOTION.t))
    )
    whole = np.floor(MOTION.t).astype(np.int64)
    part = np.round(1e9 * (MOTION.t - whole)).astype(np.int64)
    if path.suffix in (".npz", ".mat", ".h5"):
        arrays = {"time": MOTION.t, "position": q, "effort": tau}
        if path.suffix == ".npz":
            np.savez(path, joint_names=np.array(names), **arrays)
        elif path.suffix == ".mat":
            scipy.io.savemat(path, {"state": {"name": np.array(names, dtype=object), **arrays}})
        else:
            h5py = pytest.importorskip("h5py")
            with h5py.File(path, "w") as file:
                group, store = file.create_group("state"), file.create_group("#refs#")
                for name, values in {path.stem: names, **arrays}.items():
                    group[name] = values
                # MATLAB's letters are numbers: each word a column, of a cell or of a matrix.
                letters = [
                    np.array([[*map(ord, name.ljust(20))]], dtype=np.uint16).T for name in names
                ]
                if path.stem == "letters":
                    group["joint_names"] = np.hstack(letters)
                elif path.stem == "cells":
                    for k, word in enumerate(letters):
                        store[str(k)] = word
                    # A struct among them is no name.
                    cells = [[*(store[str(k)].ref for k in range(len(names))), store.ref]]
                    group.create_dataset("joint_names", data=cells, dtype=h5py.ref_dtype)
        return path
    columns = {"name": [names] * n, "position": q.tolist(), "effort": tau.tolist()}
    if path.suffix == ".parquet":
        stamps = {"header.stamp.sec": whole, "header.stamp.nanosec": part}
        parquet.write_table(pa.table({**stamps, **columns}), path)
        return path
    lines = [
        {"header": {"stamp": {"sec": int(whole[k]), "nanosec": int(part[k])}}}
        | {name: values[k] for name, values in columns.items()}
        for k in range(n)
    ]
    path.write_text("\n".join(map(json.dumps, lines)))
    return path


@pytest.mark.parametrize(
    "name",
    ["x.parquet", "x.json", "x.npz", "x.mat", "joint_names.h5", "letters.h5", "cells.h5"],
)
def test_joint_names_beside_the_numbers_give_the_order(tmp_path: Path, name: str) -> None:
    check(read_recording(messages(tmp_path / name), robot=load_robot("ur5")))


def test_joint_names_that_change_are_refused(tmp_path: Path) -> None:
    path = messages(tmp_path / "x.json")
    lines = path.read_text().splitlines()
    other = json.loads(lines[7])
    other["name"] = other["name"][::-1]
    path.write_text("\n".join([*lines[:7], json.dumps(other), *lines[8:]]))
    with pytest.raises(RecordError, match="names change from row to row"):
        read_recording(path, robot=load_robot("ur5"))
