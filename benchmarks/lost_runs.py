"""End `dynid run` at random times, and fill its disk: what was recorded must be readable.

    python benchmarks/lost_runs.py [--kills 60] [--full 20] [--side 4]

Half of the kills (SIGKILL) hit runs on the simulated arm, half runs through urtwin in real time;
the full disks are limits of the size of files. A file beside tells what was appended and when.
Afterwards every row that was a second old must be read back, bit by bit; files that stood there
before must be untouched (every other run finds one in its recording's place); and the count in the
message must be that of the rows which can be read. Exits 1 if anything of that fails.
"""

import random
import re
import shutil
import subprocess
import sys
import tempfile
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
PERIODS = {"sim": 16, "controller": 2}
LATE_S = {"sim": 4.0, "controller": 15.0}
"""The latest kill after the first row."""
ROOM = (20_000, 2_500_000)
"""Sizes of full disks [bytes]; a whole recording of the simulated arm takes 6 MB."""
OLD_S = 1.0
CHILD = """
import os, resource, struct, sys, time
told, room = os.open(sys.argv[1], os.O_WRONLY | os.O_CREAT), int(sys.argv[2])
from dynid.cli.app import main
from dynid.recording import RecordWriter
append = RecordWriter.append
def appended(self, t, signals, channels=None):
    append(self, t, signals, channels)
    os.write(told, struct.pack("<8d", time.monotonic(), t, *signals["q"]))
RecordWriter.append = appended
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

    @property
    def how(self) -> str:
        """In words."""
        return f"{self.room} bytes" if self.kill_s is None else f"killed after {self.kill_s:.2f} s"


def found_in(folder: Path, old: dict[Path, str]) -> tuple[ExperimentRecord | None, str]:
    """What is left of a run: its partial file, a recording beside an older one, or itself."""
    places = [folder / "run.parquet.partial", *folder.glob("run.aborted-*.parquet")]
    places += [path for path in folder.glob("run.parquet") if old.get(path) != file_hash(path)]
    for place in filter(Path.is_file, places):
        try:
            return read_record(place), place.name
        except DynidError as error:
            return None, f"{place.name}: {error}"
    return None, "nothing there"


def spoiled(case: Case, words: list[str], told: Path) -> tuple[int, str, float]:
    """Run and spoil; the exit code, what was said, and when it ended."""
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(told), str(case.room), *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )
    if case.kill_s is not None:
        while child.poll() is None and not (told.exists() and told.stat().st_size):
            time.sleep(0.01)
        try:
            child.wait(case.kill_s)
        except subprocess.TimeoutExpired:
            child.kill()
    ended = time.monotonic()
    said = child.communicate()[0].strip()
    return child.returncode, said, ended


def spoil(case: Case, host: str, folder: Path, motion: Path) -> tuple[bool, bool]:
    """Run, spoil and look; whether all is as promised, and whether anything was recorded."""
    told, folder = folder / "told", folder / "work"
    folder.mkdir()
    shutil.copy(FILES / "warm.parquet", folder / "old.parquet")
    stands = case.number % 2 == 1
    if stands:
        shutil.copy(FILES / "cold.parquet", folder / "run.parquet")
    before = {path: file_hash(path) for path in folder.iterdir()}
    words = ["run", str(motion), "-o", str(folder / "run.parquet"), "--yes"]
    words += ["--on", "sim" if case.where == "sim" else f"ur://{host}"]
    words += ["--repeat", str(PERIODS[case.where]), *(["--force"] if stands else [])]
    code, said, ended = spoiled(case, words, told)
    data = told.read_bytes() if told.exists() else b""
    rows = np.frombuffer(data[: len(data) // 64 * 64], "<f8").reshape(-1, 8)
    record, place = found_in(folder, before)
    kept = 0 if record is None else record.samples
    old_enough = int((rows[:, 0] <= ended - OLD_S).sum())
    if case.kill_s is None and len(rows):
        # Nothing was cut off in the midst: all but the last write must be there.
        old_enough = int((rows[:, 1] <= rows[-1, 1] - OLD_S).sum())
    touched = [
        path.name
        for path, digest in before.items()
        if file_hash(path) != digest and not (path.name == "run.parquet" and code == 0)
    ]
    wrongs = {
        f"{old_enough} rows were a second old": kept < old_enough and old_enough > 1,
        f"{touched} touched": bool(touched),
        said[-200:]: "Traceback" in said or "a bug" in said,
    }
    if record is not None:
        # A row is told after it was appended: the last one need not have been.
        some, kinds = rows[:kept], {item.kind: item.text for item in record.problems}
        same = np.array_equal(record.t[: len(some)], some[:, 1])
        same &= np.array_equal(record.signals["q"][: len(some)], some[:, 2:])
        wrongs["rows are not those that were appended"] = len(some) < kept - 1 or not same
        if code > 0:
            counts = {int(x) for x in re.findall(r"(\d+) samples are", said)}
            wrongs[f"the message counts {counts}"] = counts != {kept}
            wrongs["the message does not name the file"] = place not in said
        elif code < 0 and ("aborted" in kinds or place.endswith(".parquet")):
            # The run had ended by itself, and was killed while it told so.
            wrongs["rows of a run that had ended are missing"] = kept < len(rows)
        elif code < 0:
            text = kinds.get("truncated_file", "")
            wrongs[f"the finding says {text}"] = f" {kept} samples" not in text
    wrong = [text for text, is_so in wrongs.items() if is_so]
    print(
        f"{'BAD' if wrong else 'ok '} {case.number:3d} {case.where:10s} {case.how:24s} code "
        f"{code:3d}: {len(rows)} appended, {old_enough} old enough, {kept} read of {place}",
        *(f"WRONG: {text}" for text in wrong),
        *([] if len(rows) else [said[-160:]]),
        flush=True,
    )
    return not wrong, len(rows) > 0


def main(kills: int = 60, full: int = 20, side: int = 4, seed: int = 0) -> bool:
    """Print a line a run, so many side by side; true if a promise was broken."""
    chance = random.Random(seed)
    places = ["sim", "sim", "controller", "controller"] * kills
    cases = [Case(k, places[k], chance.uniform(0.0, LATE_S[places[k]])) for k in range(kills)]
    cases += [Case(k, "sim", None, chance.randrange(*ROOM)) for k in range(kills, kills + full)]

    def work(share: list[Case]) -> list[tuple[bool, bool]]:
        found = []
        with controller_process("ur5", rate_hz=125.0) as controller:
            for case in share:
                with tempfile.TemporaryDirectory(prefix="lost-") as folder:
                    found.append(spoil(case, controller.host, Path(folder), motion))
        return found

    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(side) as pool:
        motion = Path(place) / "design.json"
        design("ur5", DesignSettings(starts=1), output=motion)
        each = [
            one for share in pool.map(work, [cases[k::side] for k in range(side)]) for one in share
        ]
    bad, recorded = sum(not good for good, _ in each), sum(some for _, some in each)
    print(f"{len(cases)} runs, {recorded} recorded something, {bad} broke a promise")
    return bad > 0


if __name__ == "__main__":
    run(main)
