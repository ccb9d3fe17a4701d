from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from hostile_files import MAT, element, matrix
from recorded_motions import MAT_COLUMNS, Motion, write_mat, write_npz

from dynid.core import InputError, RecordError
from dynid.recording import read_recording
from dynid.robot import load_robot


def codes(record) -> list[str]:
    return [problem.code for problem in record.problems]


@pytest.mark.parametrize("compress", [False, True])
def test_struct_by_paths(tmp_path: Path, compress: bool) -> None:
    motion = Motion()
    path = write_mat(motion, tmp_path / "run.mat", compress=compress)
    record = read_recording(path, columns=MAT_COLUMNS)
    assert record.metadata.format == "mat"
    assert record.problems == ()
    assert record.metadata.extra["t0"] == str(motion.start)
    np.testing.assert_array_equal(record.signals["q"], motion.position(motion.t))


def test_names_are_enough_where_they_are_plain(tmp_path: Path) -> None:
    motion = Motion()
    t = motion.t
    path = tmp_path / "run.mat"
    scipy.io.savemat(
        path,
        {
            "t": t,
            "q": motion.position(t),
            "dq": motion.velocity(t),
            "tau": motion.current(t),
            "note": "x",
        },
    )
    record = read_recording(path)
    assert set(record.signals) == {"q", "qd", "effort"}


@pytest.mark.parametrize("shape", ["rows", "columns", "flat"])
@pytest.mark.parametrize("known", ["time", "robot", "nothing"])
@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_every_orientation(tmp_path: Path, shape: str, known: str, suffix: str) -> None:
    motion = Motion()
    t = motion.t
    turn = {"rows": lambda x: x, "columns": np.transpose, "flat": np.ravel}[shape]
    arrays = {"q": turn(motion.position(t)), "current": turn(motion.current(t))}
    if known == "time":
        arrays["t"] = t
    path = tmp_path / f"x{suffix}"
    np.savez(path, **arrays) if suffix == ".npz" else scipy.io.savemat(path, arrays)
    columns = ",".join(f"{name}={name}" for name in arrays)
    robot = load_robot("ur5") if known == "robot" else None
    rate = None if known == "time" else motion.rate
    if shape == "flat" and known == "nothing":
        # Six joints cannot be told from one.
        with pytest.raises(RecordError, match="give the robot"):
            read_recording(path, columns=columns, rate_hz=rate)
        return
    record = read_recording(path, columns=columns, robot=robot, rate_hz=rate)
    np.testing.assert_array_equal(record.signals["q"], motion.position(t))


def test_columns_of_one_matrix(tmp_path: Path) -> None:
    motion = Motion()
    scipy.io.savemat(tmp_path / "x.mat", {"data": motion.table(), "name": "n"})
    np.save(tmp_path / "x.npy", motion.table())
    for path, columns in (
        (tmp_path / "x.mat", "t=0,q=1:7,current=13:19"),
        (tmp_path / "x.mat", "t=data[0],q=data[1:7],current=data[:,13:19]"),
        (tmp_path / "x.npy", "t=0,q=1:7,current=13:19"),
    ):
        record = read_recording(path, columns=columns)
        np.testing.assert_array_equal(record.signals["q"], motion.table()[:, 1:7])


def test_missing_variable_is_named_with_what_there_is(tmp_path: Path) -> None:
    path = write_mat(Motion(), tmp_path / "run.mat")
    with pytest.raises(RecordError, match=r"q=rec\.pos.*rec\.act_pos \(6, 500\)"):
        read_recording(path, columns="q=rec.pos,t=rec.time")
    assert read_recording(path).metadata.joint_names == ()
    scipy.io.savemat(path, {"rec": {"a": np.zeros((500, 6)), "b": np.zeros((500, 6))}})
    with pytest.raises(RecordError, match=r"rec\.a \(500, 6\).*columns"):
        read_recording(path)


@pytest.mark.parametrize(
    ("arrays", "columns"),
    [
        ({"q": np.zeros((50, 6)), "tau": np.zeros((49, 6)), "t": np.arange(50)}, None),
        ({"q": np.zeros((50, 6)), "tau": np.zeros((50, 5)), "t": np.arange(50)}, None),
        ({"q": np.zeros((50, 6)), "tau": np.zeros((50, 6)), "t": np.zeros((50, 2))}, None),
        ({"q": np.zeros((5, 6, 7)), "t": np.arange(5)}, None),
        ({"q": np.zeros(0), "tau": np.zeros(0), "t": np.zeros(0)}, "q=q,effort=tau,t=t"),
        ({"q": 1.0, "tau": 2.0, "t": 3.0}, "q=q,effort=tau,t=t"),
        ({"a": np.zeros((3, 4)), "b": np.zeros((3, 4))}, "q=0:2,effort=2:4"),
        ({"q": np.zeros((50, 6)), "tau": np.zeros((50, 6)), "t": np.arange(50)}, "q=q[9]"),
        ({"q": np.array(["x", "y"]), "tau": np.zeros(2), "t": np.arange(2)}, None),
    ],
)
def test_arrays_that_do_not_fit_are_one_error(tmp_path: Path, arrays, columns) -> None:
    np.savez(tmp_path / "x.npz", **arrays)
    scipy.io.savemat(tmp_path / "x.mat", arrays)
    for path in (tmp_path / "x.npz", tmp_path / "x.mat"):
        with pytest.raises(RecordError) as caught:
            read_recording(path, columns=columns)
        assert "\n" not in str(caught.value)


def test_vectors_of_joints_in_different_units_are_refused(tmp_path: Path) -> None:
    motion = Motion()
    q, tau = motion.position(motion.t).T, motion.current(motion.t).T
    arrays = {f"q_{k}": q[k] for k in range(6)} | {f"tau_{k}": tau[k] for k in range(1, 6)}
    np.savez(tmp_path / "x.npz", t=motion.t, tau_0_mNm=1e3 * tau[0], **arrays)
    with pytest.raises(RecordError, match="variables of effort are of different lengths or units"):
        read_recording(tmp_path / "x.npz")


@pytest.mark.parametrize("run", ["run", "trial_"])
@pytest.mark.parametrize("robot", [None, "ur5"])
def test_two_runs_in_one_file_state_the_columns_of_the_first(
    tmp_path: Path, robot: str | None, run: str
) -> None:
    motion = Motion()
    t = motion.t
    arrays = {"t": t, "q": motion.position(t), "qd": motion.velocity(t), "tau": motion.current(t)}
    scipy.io.savemat(tmp_path / "x.mat", {f"{run}1": arrays, f"{run}2": arrays})
    arm = load_robot(robot) if robot else None
    with pytest.raises(
        RecordError, match=rf"2 sets of variables can be q; got {run}1\.q, {run}2\.q"
    ) as no:
        read_recording(tmp_path / "x.mat", robot=arm)
    columns = str(no.value).rpartition("columns ")[2]
    told = {
        f"{name}={run}1.{own}" for name, own in zip(("t", "q", "qd", "effort"), arrays, strict=True)
    }
    assert {*columns.split(",")} == told
    record = read_recording(tmp_path / "x.mat", columns=columns, robot=arm)
    np.testing.assert_allclose(record.signals["q"], motion.position(t))


def test_columns_of_one_run_of_hdf5_have_no_units_to_quote(tmp_path: Path) -> None:
    motion, path = Motion(), tmp_path / "x.h5"
    arrays = {"q": np.degrees(motion.position(motion.t)), "tau": motion.current(motion.t)}
    with pytest.importorskip("h5py").File(path, "w") as file:
        for run in ("run1", "run2"):
            for name, values in {"t": motion.t, **arrays}.items():
                file[f"{run}/{name}"] = values
                file[f"{run}/{name}"].attrs["unit"] = {"t": "s", "q": "deg", "tau": "N.m"}[name]
    with pytest.raises(RecordError, match="2 sets of variables can be q") as no:
        read_recording(path)
    columns = str(no.value).rpartition("columns ")[2]
    assert columns == "t=run1.t,q=run1.q,effort=run1.tau"
    record = read_recording(path, columns=columns)
    np.testing.assert_allclose(record.signals["q"], motion.position(motion.t))


def test_pickled_arrays_are_never_loaded(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    np.savez(path, q=np.array([{"a": 1}], dtype=object))
    with pytest.raises(RecordError, match="never loaded"):
        read_recording(path)


def test_version_73_says_how_to_save(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n")
    # Damaged as it is, or without h5py: in both cases there is a way out.
    with pytest.raises(InputError, match="-v7"):
        read_recording(path)


def test_objects_that_only_matlab_can_read_are_named(tmp_path: Path) -> None:
    """A timeseries, as MATLAB writes references to its own classes."""
    reference = matrix(b"", 6, 1, np.array([0xDD000000, 2, 1, 1, 1, 1], "<u4").tobytes(), 6)
    names = element(1, b"q") + element(1, b"MCOS") + element(1, b"timeseries")
    found = element(14, element(6, struct.pack("<II", 17, 0)) + names + reference)
    path = tmp_path / "x.mat"
    for content in (found, found + matrix(b"rate", 40, 1, bytes(40))):
        path.write_bytes(MAT + content)
        with pytest.raises(RecordError, match=r"q = ts\.Data"):
            read_recording(path)


def test_cut_file_keeps_the_whole_variables(tmp_path: Path) -> None:
    motion = Motion()
    t = motion.t
    path = tmp_path / "x.mat"
    scipy.io.savemat(
        path,
        {"t": t, "q": motion.position(t), "tau": motion.current(t), "junk": np.zeros((100, 100))},
    )
    data = path.read_bytes()
    path.write_bytes(data[:-500])
    record = read_recording(path)
    assert codes(record) == ["truncated_file"]
    np.testing.assert_array_equal(record.signals["q"], motion.position(t))
    path.write_bytes(data[:2000])
    with pytest.raises(RecordError):
        read_recording(path)


def test_npz(tmp_path: Path) -> None:
    motion = Motion()
    record = read_recording(write_npz(motion, tmp_path / "x.npz"))
    assert record.problems == ()
    assert record.metadata.format == "npz"
    np.testing.assert_array_equal(record.signals["current"], motion.current(motion.t))


def test_paths_that_say_degrees_are_converted_once(tmp_path: Path) -> None:
    motion = Motion()
    t = motion.t
    path = tmp_path / "x.mat"
    rec = {"pos_deg": np.degrees(motion.position(t)), "tau": motion.current(t), "t": t}
    scipy.io.savemat(path, {"rec": rec})
    columns = "q=rec.pos_deg,effort=rec.tau,t=rec.t"
    for degrees in (False, True):
        record = read_recording(path, columns=columns, degrees=degrees)
        np.testing.assert_allclose(record.signals["q"], motion.position(t))


def test_a_struct_called_after_degrees_is_not_converted(tmp_path: Path) -> None:
    motion = Motion()
    t = motion.t
    rec = {"q": motion.position(t), "tau": motion.current(t), "t": t}
    scipy.io.savemat(tmp_path / "x.mat", {"tilted_30_deg": rec})
    record = read_recording(tmp_path / "x.mat")
    np.testing.assert_array_equal(record.signals["q"], motion.position(t))


@pytest.mark.parametrize("columns", [None, "t=log.t,q=log.pos,effort=log.tau[0:6]"])
@pytest.mark.parametrize(
    "written",
    [str, np.bytes_, lambda unit: np.array([unit], "S"), lambda unit: np.array(6 * [unit], "S")],
    ids=["text", "bytes", "array of one", "one a joint"],
)
def test_units_in_the_attributes_of_hdf5_arrays_are_converted(
    tmp_path: Path, columns: str | None, written: Callable[[str], Any]
) -> None:
    library = pytest.importorskip("h5py")
    motion = Motion()
    q, tau = motion.position(motion.t), motion.current(motion.t)
    arrays = {"t": (motion.t, "s"), "pos": (np.degrees(q), "deg"), "tau": (1e3 * tau, "mNm")}
    with library.File(tmp_path / "run.h5", "w") as file:
        for name, (values, unit) in arrays.items():
            file[f"log/{name}"] = values
            file[f"log/{name}"].attrs["units"] = written(unit)
    record = read_recording(tmp_path / "run.h5", columns=columns)
    assert record.problems == ()
    np.testing.assert_allclose(record.signals["q"], q, atol=1e-9)
    np.testing.assert_allclose(record.signals["effort"], tau, atol=1e-9)


def test_an_array_in_an_unknown_unit_is_refused_unless_the_user_names_it(tmp_path: Path) -> None:
    library = pytest.importorskip("h5py")
    motion = Motion()
    with library.File(tmp_path / "run.h5", "w") as file:
        file["t"], file["q"] = motion.t, motion.position(motion.t)
        file["tau"] = motion.current(motion.t)
        file["tau"].attrs["unit"] = "counts"
    with pytest.raises(RecordError, match="counts"):
        read_recording(tmp_path / "run.h5")
    record = read_recording(tmp_path / "run.h5", columns="t=t,q=q,current=tau")
    assert "counts" in record.problems[0].message
    np.testing.assert_array_equal(record.signals["current"], motion.current(motion.t))
