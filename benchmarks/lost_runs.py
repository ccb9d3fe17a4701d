"""End `dynid run` at random times, and fill its disk: what was recorded must be readable.

    python benchmarks/lost_runs.py [--kills 60] [--full 20] [--side 4]

Half of the kills (SIGKILL) hit runs on the simulated arm, half runs through urtwin in real time;
the full disks are limits of the size of files. A pipe tells what was appended and when. Afterwards
every row that was a second old must be read back, bit by bit; files that stood there before must be
untouched (every other run finds one in its recording's place); and the count in the message must
be that of the rows which can be read. Exits 1 if anything of that fails.
"""

import os
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from shared.measuring import ROOT, run

from dynid.core import DynidError, file_hash
from dynid.recording import ExperimentRecord, read_record
from dynid.workflow import DesignSettings, design
from urtwin import controller_process

FILES = ROOT / "tests" / "frozen" / "files"
ROW = struct.Struct("<8d")
PERIODS = {"sim": 16, "controller": 2}
LATE_S = {"sim": 4.0, "controller": 15.0}
"""The latest kill after the first row."""
ROOM = (20_000, 2_500_000)
"""Sizes of full disks [bytes]; a whole recording of the simulated arm takes 6 MB."""
OLD_S = 1.0
CHILD = """
import os, resource, struct, sys, time
pipe, room = int(sys.argv[1]), int(sys.argv[2])
from dynid.cli.app import main
from dynid.recording import RecordWriter
append = RecordWriter.append
def told(self, t, signals, channels=None):
    append(self, t, signals, channels)
    os.write(pipe, struct.pack("<8d", time.monotonic(), t, *signals["q"]))
RecordWriter.append = told
if room:
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
sys.exit(main(sys.argv[3:]))
"""


@dataclass(frozen=True)
class Case:
    """One run to spoil."""

    number: int
    where: str
    """`sim` or `controller`."""
    kill_s: float | None
    """After the first row; None for a full disk."""
    room: int = 0


def rows_until_end(stream: int, seen: list[tuple[float, ...]]) -> None:
    """Collect what a child appends until it has gone."""
    rest = b""
    while block := os.read(stream, 1 << 16):
        rest += block
        whole = len(rest) // ROW.size * ROW.size
        seen += ROW.iter_unpack(rest[:whole])
        rest = rest[whole:]


def found_in(folder: Path, old: dict[Path, str]) -> tuple[ExperimentRecord | None, str]:
    """What is left of a run: its partial file, a recording beside an older one, or itself."""
    places = [folder / "run.parquet.partial", *folder.glob("run.aborted-*.parquet")]
    places += [path for path in folder.glob("run.parquet") if old.get(path) != file_hash(path)]
    for place in places:
        if place.is_file():
            try:
                return read_record(place), place.name
            except DynidError as error:
                return None, f"{place.name}: {error}"
    return None, "nothing there"


def spoil(case: Case, host: str, folder: Path, motion: Path) -> tuple[bool, str]:
    """Run, spoil and look; whether all is as promised, and what there was."""
    shutil.copy(FILES / "warm.parquet", folder / "old.parquet")
    stands = case.number % 2 == 1
    if stands:
        shutil.copy(FILES / "cold.parquet", folder / "run.parquet")
    before = {path: file_hash(path) for path in folder.iterdir()}
    words = ["run", str(motion), "-o", str(folder / "run.parquet"), "--yes"]
    words += ["--on", "sim" if case.where == "sim" else f"ur://{host}"]
    words += ["--repeat", str(PERIODS[case.where]), *(["--force"] if stands else [])]
    reading, writing = os.pipe()
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(writing), str(case.room), *words],
        pass_fds=[writing],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    os.close(writing)
    seen: list[tuple[float, ...]] = []
    reader = threading.Thread(target=rows_until_end, args=(reading, seen))
    reader.start()
    if case.kill_s is not None:
        while not seen and child.poll() is None:
            time.sleep(0.01)
        wait_until = time.monotonic() + case.kill_s
        while child.poll() is None and time.monotonic() < wait_until:
            time.sleep(0.002)
        child.send_signal(signal.SIGKILL)
    ended = time.monotonic()
    said = (child.communicate()[0] or b"").decode(errors="replace").strip()
    ended = ended if case.kill_s is not None else time.monotonic()
    reader.join()
    os.close(reading)
    code = child.returncode
    record, place = found_in(folder, before)
    rows = np.array(seen).reshape(-1, 8)
    old_enough = int((rows[:, 0] <= ended - OLD_S).sum())
    if case.kill_s is None:
        # Nothing was cut off in the midst: all but the last write must be there.
        old_enough = int((rows[:, 1] <= rows[-1, 1] - OLD_S).sum()) if len(rows) else 0
    wrong: list[str] = []
    kept = 0 if record is None else record.samples
    if kept < old_enough and old_enough > 1:
        wrong.append(f"{old_enough} rows were a second old, {kept} can be read ({place})")
    if record is not None:
        # A row is told after it was appended: the last one need not have been.
        some = rows[:kept]
        if not (
            len(some) >= kept - 1
            and np.array_equal(record.t[: len(some)], some[:, 1])
            and np.array_equal(record.signals["q"][: len(some)], some[:, 2:])
        ):
            wrong.append(f"the {kept} rows of {place} are not those that were appended")
    for path, digest in before.items():
        replaced = path.name == "run.parquet" and code == 0
        if not replaced and file_hash(path) != digest:
            wrong.append(f"{path.name} was touched")
    if record is not None and code and code > 0:
        counts = [int(x) for x in re.findall(r"(\d+) samples are", said)]
        if counts != [kept] * len(counts) or not counts:
            wrong.append(f"the message counts {counts}")
        if place not in said:
            wrong.append("the message does not name the file")
    aborted = record is not None and any(item.kind == "aborted" for item in record.problems)
    if code < 0 and aborted:
        # The run had stopped by itself, and was killed while it told why.
        if kept < len(rows):
            wrong.append(f"{kept} rows of an aborted run")
    elif record is not None and code < 0:
        texts = [item.text for item in record.problems if item.kind == "truncated_file"]
        if not any(f" {kept} samples" in text for text in texts):
            wrong.append(f"the finding says {texts}")
    if "Traceback" in said or "a bug" in said:
        wrong.append(said[-200:])
    how = f"killed after {case.kill_s:.2f} s" if case.kill_s is not None else f"{case.room} bytes"
    end = f"{case.number:3d} {case.where:10s} {how:24s} code {code:3d}: {len(rows)} appended, "
    end += f"{old_enough} old enough, {kept} read of {place}"
    if case.kill_s is not None and not len(rows):
        end += f"; nothing was recorded: {said[-160:]}"
    return not wrong, end + "".join(f"; WRONG: {text}" for text in wrong)


def main(kills: int = 60, full: int = 20, side: int = 4, seed: int = 0) -> bool:
    """Print a line a run, so many side by side; true if a promise was broken."""
    chance = random.Random(seed)
    cases = [
        Case(k, where, chance.uniform(0.0, LATE_S[where]))
        for k, where in enumerate(["sim", "sim", "controller", "controller"] * kills)
    ][:kills]
    cases += [Case(k, "sim", None, chance.randrange(*ROOM)) for k in range(kills, kills + full)]
    good = recorded = 0
    lock = threading.Lock()

    def work(share: list[Case]) -> None:
        nonlocal good, recorded
        with controller_process("ur5", rate_hz=125.0) as controller:
            for case in share:
                with tempfile.TemporaryDirectory(prefix="lost-") as folder:
                    fine, words = spoil(case, controller.host, Path(folder), motion)
                with lock:
                    good += fine
                    recorded += ": 0 appended" not in words
                    print(("ok  " if fine else "BAD ") + words, flush=True)

    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(side) as pool:
        motion = Path(place) / "design.json"
        design("ur5", DesignSettings(starts=1), output=motion)
        list(pool.map(work, [cases[k::side] for k in range(side)]))
    print(f"{len(cases)} runs, {recorded} recorded something, {len(cases) - good} broke a promise")
    return good < len(cases)


if __name__ == "__main__":
    run(main)
