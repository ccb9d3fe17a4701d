from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from dynid.core import Finding, InputError, JobError, RecordError
from dynid.recording import (
    RecordMetadata,
    RecordWriter,
    partial_path,
    read_record,
    read_recording,
    write_record,
)
from dynid.recording.store import MARK, pack

NAMES = ("a", "b")
PATIENCE_S = 5.0
"""Longest wait for what must come [s]."""


def fill(writer: RecordWriter, rows: int, start: int = 0) -> None:
    for k in range(start, start + rows):
        writer.append(k / 100, {"q": [k, -k], "current": [0.5 * k, 1]}, {"speed": k % 7})


def open_writer(path: Path) -> RecordWriter:
    metadata = RecordMetadata(robot="ur5", drive_gains=(10.0, 11.0), extra={"thermal": "cold"})
    return RecordWriter(path, NAMES, ("q", "current"), metadata, channels=("speed",))


def test_closing_makes_a_parquet_file(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    with open_writer(path) as writer:
        fill(writer, 300)
        writer.report(Finding("clock_jitter", "one gap"))
        assert writer.samples == 300
    record = read_record(path)
    assert os.listdir(tmp_path) == ["run.parquet"]
    assert record.samples == 300
    assert record.metadata.joint_names == NAMES
    assert record.metadata.drive_gains == (10.0, 11.0)
    assert record.problems == (Finding("clock_jitter", "one gap"),)
    np.testing.assert_array_equal(record.signals["q"][:, 1], -np.arange(300.0))
    np.testing.assert_array_equal(record.channels["speed"], np.arange(300) % 7)


def test_a_recording_that_appeared_meanwhile_stays(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    with open_writer(path) as writer:
        fill(writer, 300)
        path.write_text("of another process")
    assert path.read_text() == "of another process"
    assert writer.record_path == tmp_path / "run.new-1.parquet"
    assert read_record(writer.record_path).samples == 300


KILLED = """
import sys, time
from dynid.recording import RecordWriter
writer = RecordWriter(sys.argv[1], ("a", "b"), ("q", "effort"))
start = time.monotonic()
k = 0
while True:
    t = time.monotonic() - start
    writer.append(t, {"q": [t, k], "effort": [1.0, 2.0]})
    k += 1
    if k % 25 == 0:
        print(t, flush=True)
    time.sleep(0.004)
"""


def test_killed_writer_loses_at_most_a_second(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    last = 0.0
    while last < 1.6:
        last = float(process.stdout.readline())
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    assert not path.exists()
    record = read_record(path)
    assert record.t[-1] > last - 1.0
    np.testing.assert_array_equal(record.signals["q"][:, 0], record.t)
    np.testing.assert_array_equal(record.signals["q"][:, 1], np.arange(record.samples))
    assert [problem.code for problem in record.problems] == ["truncated_file"]


@pytest.mark.parametrize("rows", [0, 200])
def test_next_writer_keeps_what_a_killed_one_left(tmp_path: Path, rows: int) -> None:
    path = tmp_path / "run.parquet"
    first = open_writer(path)
    fill(first, rows)
    first.flush()
    first._disk.shutdown(wait=True)
    os.close(first._file)  # what a crash does
    first._file = None
    with open_writer(path) as writer:
        fill(writer, 50)
    assert read_record(path).samples == 50
    left = tmp_path / "run.parquet.partial.1"
    assert left.exists() == (rows > 0)
    if rows:
        assert read_record(left).samples == rows


def test_two_writers_on_one_file_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    with open_writer(path) as writer:
        with pytest.raises(RecordError, match="another program"):
            open_writer(path)
        fill(writer, 10)
    assert read_record(path).samples == 10


@pytest.mark.parametrize("cut", [1, 5, 9, 100, 1000])
def test_every_cut_of_a_partial_file_is_readable_or_one_error(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "run.parquet"
    writer = open_writer(path)
    for k in range(6):
        fill(writer, 40, 40 * k)
        writer.flush()
    data = partial_path(path).read_bytes()
    writer.close()
    cut_path = tmp_path / "cut.parquet"
    partial_path(cut_path).write_bytes(data[:-cut])
    record = read_record(cut_path)
    assert record.samples in (200, 160, 120, 80)
    np.testing.assert_array_equal(record.signals["q"][:, 0], np.arange(float(record.samples)))


def test_damage_in_a_partial_file_ends_the_recording_there(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    writer = open_writer(path)
    for k in range(6):
        fill(writer, 40, 40 * k)
        writer.flush()
    data = partial_path(path).read_bytes()
    writer.close()
    rng = np.random.default_rng(0)
    for _ in range(300):
        damaged = bytearray(data)
        damaged[int(rng.integers(len(MARK), len(data)))] ^= 1 << int(rng.integers(8))
        file = tmp_path / "damaged.partial"
        file.write_bytes(damaged)
        try:
            record = read_record(file)
        except RecordError:
            continue
        expected = np.arange(float(record.samples))
        np.testing.assert_array_equal(record.signals["q"][:, 0], expected)
        assert record.samples % 40 == 0
        assert record.samples < 240


@pytest.mark.parametrize("removed", ["file", "folder"])
def test_rows_whose_file_or_folder_was_removed_are_kept(tmp_path: Path, removed: str) -> None:
    path = tmp_path / "runs" / "run.parquet"
    path.parent.mkdir()
    with open_writer(path) as writer:
        fill(writer, 100)
        shutil.rmtree(path.parent)
        if removed == "file":
            path.parent.mkdir()
        fill(writer, 100, start=100)
    assert read_record(path).samples == 200
    assert os.listdir(path.parent) == ["run.parquet"]


def test_too_short_a_run_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    with pytest.raises(RecordError, match="two samples"), open_writer(path) as writer:
        fill(writer, 1)
    assert not list(tmp_path.iterdir())


def test_an_error_in_the_run_is_not_hidden_and_rows_are_saved(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"

    def run() -> None:
        with open_writer(path) as writer:
            fill(writer, 20)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run()
    assert read_record(path).samples == 20


@pytest.mark.parametrize(
    ("t", "signals"),
    [
        (0.0, {"q": [1, 2], "current": [1, 2]}),
        (np.nan, {"q": [1, 2], "current": [1, 2]}),
        (1.0, {"q": [1, 2]}),
        (1.0, {"q": [1, 2], "current": [1, np.nan]}),
        (1.0, {"q": [1, 2, 3], "current": [1, 2]}),
        (1.0, {"q": ["x", 2], "current": [1, 2]}),
    ],
)
def test_bad_samples_are_refused_and_not_appended(tmp_path: Path, t, signals) -> None:
    path = tmp_path / "run.parquet"
    with RecordWriter(path, NAMES, ("q", "current")) as writer:
        writer.append(0.0, {"q": [0, 0], "current": [0, 0]})
        with pytest.raises(RecordError):
            writer.append(t, signals)
        writer.append(2.0, {"q": [0, 0], "current": [0, 0]})
    assert read_record(path).samples == 2


def test_closed_writer_takes_nothing(tmp_path: Path) -> None:
    with open_writer(tmp_path / "run.parquet") as writer:
        fill(writer, 3)
    with pytest.raises(RecordError, match="closed"):
        fill(writer, 1, 3)
    writer.close()


def test_bad_places_and_quantities_are_refused(tmp_path: Path) -> None:
    with pytest.raises(JobError):
        RecordWriter(tmp_path / "no" / "run.parquet", NAMES, ("q",))
    with pytest.raises(RecordError):
        RecordWriter(tmp_path / "run.parquet", NAMES, ("current",))
    with pytest.raises(RecordError):
        RecordWriter(tmp_path / "run.parquet", (), ("q",))


def test_appending_does_not_wait_for_the_disk(tmp_path: Path, monkeypatch) -> None:
    real, busy, go_on = os.fsync, threading.Event(), threading.Event()
    waited: list[bool] = []

    def slow(file: int) -> None:
        busy.set()
        waited.append(go_on.wait(PATIENCE_S if all(waited) else 0.0))
        real(file)

    monkeypatch.setattr(os, "fsync", slow)
    with open_writer(tmp_path / "run.parquet") as writer:
        fill(writer, 60)
        assert busy.wait(PATIENCE_S)
        fill(writer, 100, 60)
        go_on.set()
    # Had a row waited for the disk, the disk would have waited in vain for what follows it.
    assert waited
    assert all(waited)
    assert read_record(tmp_path / "run.parquet").samples == 160


def test_partial_without_description_is_one_error(tmp_path: Path) -> None:
    path = tmp_path / "x.partial"
    for data in (
        MARK,
        MARK + pack(b"R", b"\0" * 16),
        MARK + pack(b"H", b"[]"),
        MARK + pack(b"H", b"{}"),
        MARK + pack(b"H", b"{"),
    ):
        path.write_bytes(data)
        with pytest.raises(RecordError):
            read_record(path)


def test_nothing_takes_the_place_of_a_recording_unasked(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    with open_writer(path) as writer:
        fill(writer, 30)
    good = path.read_bytes()
    with pytest.raises(InputError, match="force=True"):
        open_writer(path)
    with pytest.raises(InputError, match="force=True"):
        write_record(read_record(path), path, force=False)
    assert path.read_bytes() == good
    with RecordWriter(path, NAMES, ("q",), force=True) as writer:
        for k in range(40):
            writer.append(float(k), {"q": [k, -k]})
    assert writer.record_path == path
    assert read_record(path).samples == 40
    assert os.listdir(tmp_path) == ["run.parquet"]


@pytest.mark.parametrize("reported", [True, False])
def test_a_run_that_stops_is_written_beside_what_exists(tmp_path: Path, reported: bool) -> None:
    path = tmp_path / "run.parquet"
    with open_writer(path) as writer:
        fill(writer, 300)
    good = path.read_bytes()
    for number in (1, 2):
        writer = RecordWriter(path, NAMES, ("q", "current"), channels=("speed",), force=True)
        with suppress(ZeroDivisionError), writer:
            fill(writer, 20)
            if reported:
                writer.report(Finding("aborted", "the robot was stopped"))
            else:
                raise ZeroDivisionError("division by zero")
        assert path.read_bytes() == good
        assert writer.record_path == tmp_path / f"run.aborted-{number}.parquet"
        stopped = read_record(writer.record_path)
        assert stopped.samples == writer.saved_samples == 20
        assert [problem.kind for problem in stopped.problems] == ["aborted"]


def test_a_full_disk_is_told_before_the_robot_moves(tmp_path: Path, monkeypatch) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=100 << 20))
    with RecordWriter(tmp_path / "a.parquet", NAMES, ("q",), expected_samples=1_000_000) as writer:
        for k in range(2):
            writer.append(float(k), {"q": [k, k]})
    with pytest.raises(JobError, match=r"no room.*100 MB free"):
        RecordWriter(tmp_path / "b.parquet", NAMES, ("q",), expected_samples=3_000_000)
    assert not partial_path(tmp_path / "b.parquet").exists()


def test_a_disk_that_fills_up_costs_what_it_refused_only(tmp_path: Path, monkeypatch) -> None:
    """A limit on the size of files stands for a full disk; half a segment is taken back."""
    path = tmp_path / "run.parquet"
    writer = open_writer(path)
    fill(writer, 50)
    writer.flush()
    real = os.write

    def half(file: int, data) -> int:
        if len(data) < 1000:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(file, bytes(data[: len(data) // 2]))

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", half)
        with pytest.raises(JobError, match=r"50 samples are on the disk.*dynid import .*partial"):
            fill(writer, 100, 50)
    assert writer.saved_samples == 50
    writer.append(1000.0, {"q": [1, 2], "current": [1, 2]}, {"speed": 0.0})
    writer.close()
    kept = read_record(path)
    assert kept.samples == writer.saved_samples == 51
    assert [problem.kind for problem in kept.problems] == ["aborted"]


def test_a_disk_that_takes_no_row_keeps_nothing(tmp_path: Path, monkeypatch) -> None:
    """An empty file and its lock were left, and a command to read what is there."""
    path = tmp_path / "run.parquet"

    def full(file: int, data) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", full)
        with pytest.raises(JobError, match="0 samples are on the disk") as caught:
            open_writer(path)
    assert caught.value.next_step is None
    assert list(tmp_path.iterdir()) == []
    with open_writer(path) as writer:
        fill(writer, 30)


def test_rows_that_wait_beside_a_recording_are_named(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    with open_writer(path) as writer:
        fill(writer, 30)
    killed = open_writer(tmp_path / "other.parquet")
    fill(killed, 12)
    killed.flush()
    waiting = partial_path(path)
    waiting.write_bytes(partial_path(tmp_path / "other.parquet").read_bytes())
    killed.close()
    (found,) = read_record(path).problems
    assert found.severity == "info"
    assert found.next_step.endswith(f"dynid import {waiting} -o RECORD.parquet")
    assert read_recording(waiting).samples == 12


def test_rows_that_were_refused_take_no_recordings_place(tmp_path: Path, monkeypatch) -> None:
    """Who appends may keep the error to himself: the rows are missing all the same."""
    path = tmp_path / "run.parquet"
    with open_writer(path) as writer:
        fill(writer, 30)
    good = path.read_bytes()

    def full(file: int, data) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    with RecordWriter(path, NAMES, ("q", "current"), channels=("speed",), force=True) as writer:
        fill(writer, 20)
        writer.flush()
        with monkeypatch.context() as patch, suppress(JobError):
            patch.setattr(os, "write", full)
            fill(writer, 300, 20)
    assert path.read_bytes() == good
    assert read_record(tmp_path / "run.aborted-1.parquet").samples >= 20
