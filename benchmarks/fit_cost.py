"""What one command costs: CPU of `dynid fit` beside release 0.1's `identify` and `report`.

    python benchmarks/fit_cost.py [OLD] [--runs 3]

OLD is the source folder (`src`) of a tree of v0.1.0, whose environment (`.venv`) lies beside it:
it needs libraries that this one does not. Two jobs: the UR5 logs of examples/data (one
identified, the other predicted) and, where the recordings lie beside the repository, the halves of
a Panda's. `dynid fit` imports, identifies, validates, exports and reports; release 0.1 gets the
recordings imported and only does `identify --preset best` and `report`. The releases take turns
after one run of each that fills the caches. User and system time of the processes and their
children; exits 1 where the ratio of the medians of a job is above the asked one.
"""

from __future__ import annotations

import argparse
import gzip
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ASKED = 1.5
ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
PANDA = ROOT.parent / "shared" / "data" / "panda_gaz"
HALF = 0.5


@dataclass(frozen=True)
class Job:
    """A robot, a log to identify from and one to predict."""

    name: str
    robot: str
    log: tuple[Path, ...]
    validation: tuple[Path, ...]


def cpu(source: Path, words: Sequence[str | Path]) -> float:
    """User and system time of a command of a release [s]."""
    own = source.parent / ".venv" / "bin" / "python"
    python = own if own.exists() else sys.executable
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [python, "-m", "dynid", *map(str, words)],
        env=os.environ | {"PYTHONPATH": str(source)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def jobs(folder: Path) -> list[Job]:
    """The jobs whose recordings are here, as files that both releases read."""
    logs: list[Path] = []
    for name in ("ur5_no6", "ur5_no5"):
        logs.append(folder / f"{name}.csv")
        packed = EXAMPLES / "data" / f"{name}.csv.gz"
        logs[-1].write_bytes(gzip.decompress(packed.read_bytes()))
    found = [Job("UR5 no6, on no5", "ur5", (logs[0],), (logs[1],))]
    if PANDA.exists():
        robot = str(EXAMPLES / "robots" / "panda.toml")
        halves = [panda_half(folder, second) for second in (False, True)]
        found.append(Job("Panda 1st half, on 2nd", robot, (halves[0],), (halves[1],)))
    return found


def panda_half(folder: Path, second: bool) -> Path:
    """Half of the Panda's text files as one CSV with names."""
    names = ("time", "positions", "velocity", "torques")
    texts = [(PANDA / f"exciting_traj_{name}.txt").read_text().split() for name in names]
    rows = len(texts[0])
    heads = ["t [s]"] + [f"{kind}{j}" for kind in ("q", "qd", "effort") for j in range(1, 8)]
    start, end = (int(HALF * rows), rows) if second else (0, int(HALF * rows))
    lines = [",".join(heads)]
    for i in range(start, end):
        values = [texts[0][i]]
        for text in texts[1:]:
            values += text[7 * i : 7 * i + 7]
        lines.append(",".join(values))
    path = folder / f"panda_{int(second) + 1}.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def old_cost(source: Path, job: Job, folder: Path) -> float:
    """`identify --preset best` and `report` of release 0.1, its imports not counted [s]."""
    folder.mkdir()
    records = [folder / "log.parquet", folder / "validation.parquet"]
    for logs, record in zip((job.log, job.validation), records, strict=True):
        cpu(source, ["import", *logs, "--robot", job.robot, "-o", record])
    words = ["identify", records[0], "--preset", "best", "--validate", records[1]]
    spent = cpu(source, [*words, "-o", folder / "estimate.json"])
    return spent + cpu(source, ["report", folder, "-o", folder / "report.html"])


def new_cost(job: Job, folder: Path) -> float:
    """`dynid fit`, everything included [s]."""
    words = ["fit", job.robot, *job.log, "--validate", *job.validation, "-o", folder]
    return cpu(ROOT / "src", words)


def main() -> int:
    """Print a line a run and one a job."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("old", type=Path, nargs="?", help="without it there is nothing to compare")
    parser.add_argument("--runs", type=int, default=3)
    asked = parser.parse_args()
    if asked.old is None:
        print("nothing compared: name the source folder of a tree of v0.1.0")
        return 0
    dear = 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for number, job in enumerate(jobs(folder)):
            pairs: list[tuple[float, float]] = []
            for turn in range(asked.runs + 1):
                here = folder / f"{number}-{turn}"
                here.mkdir()
                pair = old_cost(asked.old, job, here / "old"), new_cost(job, here / "new")
                if turn:
                    pairs.append(pair)
                    print(f"{job.name}: 0.1 {pair[0]:.1f} s, fit {pair[1]:.1f} s", flush=True)
            old, new = (statistics.median(column) for column in zip(*pairs, strict=True))
            dear += new > ASKED * old
            print(
                f"{job.name}, median CPU: 0.1 {old:.1f} s, fit {new:.1f} s: {new / old:.2f} times"
            )
    return int(dear > 0)


if __name__ == "__main__":
    sys.exit(main())
