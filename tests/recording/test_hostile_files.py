"""Files that claim more than they hold end in one message, within a reader's memory and time."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hostile_files import DOCUMENTS, GOOD_ROWS, MAKERS, good_table

from dynid.core import InputError, RecordError, load_object
from dynid.recording import ExperimentRecord, read_record, read_recording, write_record
from dynid.recording.content import Budget, refused
from dynid.robot import load_robot

SAMPLE = [
    *("claims.npy", "claims.h5", "external.h5", "linked.h5", "virtual.h5", "loop.h5"),
    *("view.db3", "topics.db3", "computed.db3", "claims.mat", "twice.json", "corners.xlsx"),
    *("lies.mcap", "recursive.mcap", "claims.bag"),
]


def test_there_are_enough_of_them() -> None:
    assert len(MAKERS) >= 60


@pytest.mark.parametrize("name", SAMPLE)
def test_hostile_recordings_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    path = MAKERS[name](tmp_path)
    with pytest.raises(InputError) as caught:
        read_recording(path, rate_hz=125.0)
    assert "\n" not in str(caught.value)
    assert caught.value.next_step or caught.value.where


MOST_BYTES, MOST_MB, MOST_S = 20e6, 1500, 20.0
"""Of a file; of the memory and the CPU time of whoever reads it."""
MAKE = """
import pathlib, sys
sys.path.append(sys.argv[1])
import hostile_files
hostile_files.MAKERS[sys.argv[2]](pathlib.Path(sys.argv[3]))
"""
READ = """
import sys
from dynid.core import DynidError, load_object
from dynid.recording import read_recording
from dynid.robot import load_robot
path = sys.argv[1]
try:
    if path.endswith((".toml", ".urdf")):
        load_robot(path)
    elif path.endswith("_scene.json"):
        load_object(path)
    else:
        print("read", read_recording(path, rate_hz=125.0).samples)
except DynidError as error:
    print("refused:", error)
"""


def read_in_its_own_process(path: Path) -> str:
    """What a program that reads a file says; it takes no more than it may."""
    assert path.stat().st_size < MOST_BYTES
    words, pipe = [sys.executable, "-c", READ, str(path)], subprocess.PIPE
    with subprocess.Popen(words, stdout=pipe, stderr=subprocess.STDOUT, text=True) as one:
        assert one.stdout is not None
        said = one.stdout.read().strip()
        _, status, used = os.wait4(one.pid, 0)
        one.returncode = os.waitstatus_to_exitcode(status)
    assert one.returncode == 0
    assert used.ru_maxrss / 1024 <= MOST_MB
    assert used.ru_utime + used.ru_stime <= MOST_S
    return said


@pytest.mark.long
@pytest.mark.parametrize("name", [*MAKERS, *DOCUMENTS])
def test_no_hostile_file_takes_more_than_it_may(tmp_path: Path, name: str) -> None:
    if name in DOCUMENTS:
        (tmp_path / name).write_bytes(DOCUMENTS[name])
    else:
        # A process's peak counts from what its parent takes when it starts.
        words = ["-c", MAKE, str(Path(__file__).parent), name, str(tmp_path)]
        subprocess.run([sys.executable, *words], check=True)
    (path,) = tmp_path.iterdir()
    assert "\n" not in read_in_its_own_process(path)


def test_an_honest_file_of_their_size_is_read(tmp_path: Path) -> None:
    said = read_in_its_own_process(good_table(tmp_path / "good.csv"))
    assert said == f"read {GOOD_ROWS}"


def test_a_reader_that_ended_is_followed_by_another(tmp_path: Path) -> None:
    """A spreadsheet of two far corners ends the reading process itself."""
    for _ in range(2):
        with pytest.raises(InputError, match="memory"):
            read_recording(MAKERS["corners.xlsx"](tmp_path))
    text = tmp_path / "x.csv"
    text.write_text("t,q,tau\n" + "".join(f"{k / 125},{k % 9},{k % 7}\n" for k in range(99)))
    assert read_recording(text).samples > 90


def test_own_recordings_have_the_same_budget(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "own.parquet"
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    q = np.zeros((2, 1))
    write_record(ExperimentRecord(t=np.arange(2.0), signals={"q": q}), tmp_path / "true.parquet")
    zeros = arrow.table({"t": np.zeros(20_000_000)})
    true = parquet.read_schema(tmp_path / "true.parquet").metadata
    parquet.write_table(zeros.replace_schema_metadata(true), path, compression="zstd")
    assert path.stat().st_size < 1e6
    monkeypatch.setattr(Budget, "of", lambda files: Budget(memory_bytes=100 << 20))
    for read in (read_record, read_recording):
        with pytest.raises(RecordError, match=r"memory.*100 MB"):
            read(path)


def test_memory_that_is_used_up_within_arrow_is_no_damage() -> None:
    with pytest.raises(MemoryError), refused("damaged"):
        raise OSError("Couldn't deserialize thrift: std::bad_alloc")


@pytest.mark.parametrize("name", sorted(DOCUMENTS))
def test_hostile_documents_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(DOCUMENTS[name])
    with pytest.raises(InputError) as caught:
        load_object(path) if path.suffix == ".json" else load_robot(path)
    assert "\n" not in str(caught.value)


def test_a_document_without_an_end_is_read_up_to_the_limit() -> None:
    with pytest.raises(InputError, match="too large"):
        load_object("/dev/zero")


def test_limits_of_a_batch_system_stay(tmp_path: Path) -> None:
    text = tmp_path / "x.csv"
    text.write_text("t,q,tau\n" + "".join(f"{k / 125},{k % 9},{k % 7}\n" for k in range(99)))
    words = (
        "import resource, dynid\n"
        "resource.setrlimit(resource.RLIMIT_AS, (1 << 36, 1 << 36))\n"
        "resource.setrlimit(resource.RLIMIT_CPU, (36000, 36000))\n"
        f"print(dynid.read_recording({str(text)!r}).samples)"
    )
    ended = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True)
    assert (ended.stdout.strip(), ended.stderr) == ("99", "")
