"""Random damage to every kind of file: a reported record or one clear error, nothing else.

The motion is known at every time, so a record that was read from a damaged file can be held
against the truth: whatever samples survive must be true at their stamps.
"""

from __future__ import annotations

import random
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from recorded_motions import (
    MAT_COLUMNS,
    Motion,
    write_db3,
    write_mat,
    write_mcap,
    write_npz,
    write_plain_csv,
    write_rtde_csv,
    write_ur_csv,
)

from dynid.core import InputError
from dynid.recording import ExperimentRecord, read_recording, write_record

SECONDS = 5.0
"""CPU time for one file: more would be a bomb [s]."""
MOTION = Motion(samples=160, rate=125)
BY_NUMBER = {"columns": "t=0,q=1:7,qd=7:13,current=13:19"}
COUNTED = {"columns": "q=1:7,qd=7:13,current=13:19", "rate_hz": 125.0}


def _parquet(motion: Motion, path: Path) -> Path:
    write_record(read_recording(write_npz(motion, path.with_suffix(".npz"))), path)
    return path


FORMATS = {
    "ur-csv": (write_ur_csv, {}, True),
    "ur-rtde-csv": (write_rtde_csv, {}, True),
    "csv": (write_plain_csv, BY_NUMBER, True),
    "csv-counted": (write_plain_csv, COUNTED, True),
    "rosbag": (write_db3, {}, False),
    "mcap": (write_mcap, {}, False),
    "mcap-zstd": (lambda m, p: write_mcap(m, p, "zstd"), {}, False),
    "mat": (write_mat, {"columns": MAT_COLUMNS}, False),
    "mat-packed": (lambda m, p: write_mat(m, p, compress=True), {"columns": MAT_COLUMNS}, False),
    "npz": (write_npz, {}, False),
    "parquet": (_parquet, {}, False),
}


def damaged(data: bytes, rng: random.Random, text: bool) -> tuple[bytes, list[str]]:
    """The bytes after one to twenty random damages, and what those were."""
    out, done = bytearray(data), []
    for _ in range(rng.choice([1, 1, 1, 2, 5, 20])):
        if len(out) < 4:
            break
        kinds = ["flip", "flip", "byte", "cut", "delete", "double", "zeros", "noise", "insert"]
        if text:
            kinds += ["digit", "digit", "line", "word", "nan", "huge", "column", "twice", "swap"]
        kind = rng.choice(kinds)
        done.append(kind)
        at, size = rng.randrange(len(out)), rng.choice([1, 8, 64, 512])
        if kind == "flip":
            out[at] ^= 1 << rng.randrange(8)
        elif kind == "byte":
            out[at] = rng.randrange(256)
        elif kind == "cut":
            del out[at:]
        elif kind == "delete":
            del out[at : at + size]
        elif kind == "double":
            out[at:at] = out[at : at + size]
        elif kind == "zeros":
            out[at : at + size] = bytes(len(out[at : at + size]))
        elif kind == "noise":
            out[at : at + size] = rng.randbytes(len(out[at : at + size]))
        elif kind == "insert":
            out[at:at] = rng.randbytes(size)
        elif kind == "digit":
            digits = [k for k in range(at, min(at + 40, len(out))) if chr(out[k]).isdigit()]
            if digits:
                out[digits[0]] = ord(str(rng.randrange(10)))
        else:
            out = bytearray(_damaged_table(bytes(out), kind, rng))
    return bytes(out), done


def _damaged_table(data: bytes, kind: str, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    delimiter = b"," if b"," in lines[0] else b" "
    at = rng.randrange(len(lines))
    if kind == "line":
        del lines[at : at + rng.choice([1, 3, 30])]
    elif kind == "twice":
        lines.insert(at, lines[at])
    elif kind == "swap":
        other = rng.randrange(len(lines))
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == "column":
        gone = rng.randrange(19)
        lines = [
            delimiter.join(c for k, c in enumerate(line.split(delimiter)) if k != gone)
            for line in lines
        ]
    else:
        cells = lines[at].split(delimiter)
        cells[rng.randrange(len(cells))] = {"word": b"abc", "nan": b"nan", "huge": b"1e300"}[kind]
        lines[at] = delimiter.join(cells)
    return b"\n".join(lines)


def error_of(record: ExperimentRecord, motion: Motion) -> float:
    """The largest distance of a surviving position from the truth at its stamp [rad]."""
    t = record.t + float(record.metadata.extra["t0"])
    starts = np.zeros(1)
    if record.metadata.clock == "rate":
        # Without stamps, nobody knows how many rows are missing before the first.
        starts = motion.start + np.arange(32) / motion.rate
    q = record.signals["q"]
    return min(float(np.abs(q - motion.position(t + start)).max()) for start in starts)


@pytest.mark.parametrize("seeds", [range(30), pytest.param(range(30, 200), marks=pytest.mark.long)])
@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files(name: str, seeds: range, tmp_path: Path) -> None:
    write, options, text = FORMATS[name]
    data = write(MOTION, tmp_path / "whole").read_bytes()
    path = tmp_path / "damaged"
    seen: Counter[str] = Counter()
    for seed in seeds:
        rng = random.Random(f"{name} {seed}")
        content, done = damaged(data, rng, text)
        path.write_bytes(content)
        start = time.process_time()
        try:
            record = read_recording(path, **options)
        except InputError as error:
            message = str(error)
            assert "\n" not in message, (seed, done)
            assert 20 < len(message) < 1500, (seed, done, message)
            seen["error"] += 1
        else:
            heavy = len(done) > 2
            wrong = error_of(record, MOTION) if record.joints == 6 else 0.0
            if not record.problems:
                # Silence means truth.
                assert record.joints == 6, (seed, done)
                assert wrong < 0.02, (seed, done, wrong)
                seen["silent"] += 1
            else:
                # Where rows count the time, lost lines may only be reported.
                counted = "rate_hz" in options
                assert counted or heavy or wrong < 0.1, (seed, done, wrong, record.problems)
                seen["reported"] += 1
        assert time.process_time() - start < SECONDS, (seed, done)
    assert seen["error"] > 0
    assert sum(seen.values()) == len(seeds)


@pytest.mark.parametrize("name", FORMATS)
def test_undamaged_files_have_no_problems(name: str, tmp_path: Path) -> None:
    write, options, _ = FORMATS[name]
    record = read_recording(write(MOTION, tmp_path / "whole"), **options)
    assert record.problems == ()
    assert record.samples == MOTION.samples
    assert error_of(record, MOTION) < 1e-5


@pytest.mark.parametrize("suffix", [".csv", ".db3", ".mcap", ".mat", ".npz", ".npy", ".parquet"])
@pytest.mark.parametrize("kind", ["noise", "zeros", "text", "empty", "one line", "names"])
def test_nonsense_under_every_extension(suffix: str, kind: str, tmp_path: Path) -> None:
    rng = random.Random(f"{suffix} {kind}")
    content = {
        "noise": rng.randbytes(200_000),
        "zeros": bytes(200_000),
        "text": b"lorem ipsum dolor sit amet\n" * 5000,
        "empty": b"",
        "one line": b"1.25,3.5;" * 1_200_000,
        "names": b",".join(b"column_%d" % k for k in range(20_000)) + b"\n1,2,3\n",
    }[kind]
    path = tmp_path / f"x{suffix}"
    path.write_bytes(content)
    start = time.process_time()
    with pytest.raises(InputError) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)
    assert time.process_time() - start < SECONDS


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("suffix", [".csv", ".db3", ".mat", ".txt", ""])
def test_content_counts_more_than_the_extension(name: str, suffix: str, tmp_path: Path) -> None:
    write, options, _ = FORMATS[name]
    data = write(MOTION, tmp_path / "whole").read_bytes()
    path = tmp_path / f"renamed{suffix}"
    path.write_bytes(data)
    assert read_recording(path, **options).samples == MOTION.samples
