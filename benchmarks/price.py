"""What the present costs beside release 0.1: condition numbers, CPU of designs, CPU of `dynid fit`.

    python benchmarks/price.py OLD [--robots ur3 ur5 ur10] [--seeds 3] [--starts 4]
    python benchmarks/price.py OLD --cpu [--robots ur5] [--seeds 10] [--starts 1]
    python benchmarks/price.py OLD --fit [--runs 3]

OLD is the source folder (`src`) of a tree of v0.1.0; an environment `.venv` beside it is taken. The
releases take turns, each in processes of its own; exits 1 where an asked figure is missed.

The first compares condition numbers of designs by the criterion cond. The new release keeps its
defaults: a floor at the mounting plane, 10 mm between bodies, 5 % below every limit. The old one,
which knows no floor, gets it as a scene, 10 mm lower: that much less clearance. Asked: the median
over the seeds of an arm at most 15 % above that of 0.1.

`--cpu` compares the CPU time of a start, all limits on, above a table, with the same limits
(no margin; the new release keeps 10 mm to itself too). Asked: a third of that of 0.1 in sum, the
median condition number not above its own.

`--fit` compares the UR5 logs of examples/data (one identified, the other predicted) and, where they
are, the halves of a Panda's recording. `dynid fit` imports, identifies, validates, exports and
reports; release 0.1 gets the recordings imported and only does `identify --preset best` and
`report`. Asked: 1.5 times the median CPU.
"""

import argparse
import gzip
import json
import subprocess
import tempfile
from collections import defaultdict
from pathlib import Path
from statistics import median

import numpy as np
from shared.measuring import DATA, ROOT, SOURCE, child

MOST, MOST_CPU, MOST_FIT = 1.15, 1 / 3, 1.5
FLOOR = {"shapes": [{"type": "floor", "height": -0.01}]}
"""The old release is spared the clearance of the new one."""
TABLE = {
    "shapes": [
        {"type": "table", "size": [1.2, 0.8], "position": [0, 0, 0]},
        {"type": "floor", "height": -0.75},
    ]
}
DESIGN = """
import importlib, json, sys, time
from dynid import DesignSettings, design
module = importlib.import_module("dynid.excitation.multistart")
spent, start = [], module.one_start
def timed(*words, **more):
    began = time.process_time()
    found = start(*words, **more)
    spent.append(time.process_time() - began)
    return found
module.one_start = timed
robot, settings = json.loads(sys.argv[1])
began = time.process_time()
found = design(robot, DesignSettings(jobs=1, **settings))
whole = time.process_time() - began
print(json.dumps([spent, whole, found.condition_number if found.feasible else float("inf")]))
"""
"""Run by both releases: CPU time of the starts and of the whole design [s], condition number."""


def designed(source: Path, robot: str, **settings: object) -> tuple[list[float], float, float]:
    """A release's CPU times of the starts and of the design [s], and the condition number."""
    words = ["-c", DESIGN, json.dumps([robot, settings])]
    return json.loads(child(words, source=source, OPENBLAS_NUM_THREADS="1").said)


def conditions(old: Path, robot: str, seeds: int, starts: int, folder: Path) -> bool:
    """Compare condition numbers; whether they are as asked."""
    scene = folder / "floor.json"
    scene.write_text(json.dumps(FLOOR))
    pairs = []
    for seed in range(seeds):
        same = {"seed": seed, "starts": starts}
        before = designed(old, robot, criterion="cond", scene=str(scene), **same)[2]
        pairs.append((before, designed(SOURCE, robot, purpose="cond", **same)[2]))
        print(f"{robot:6s} seed {seed}: 0.1 {before:8.1f}, now {pairs[-1][1]:8.1f}", flush=True)
    before, now = map(median, zip(*pairs, strict=True))
    print(f"{robot:6s} median: 0.1 {before:.1f}, now {now:.1f}: {100 * (now / before - 1):+.0f} %")
    return now <= MOST * before


def cpu(old: Path, robot: str, seeds: int, starts: int, folder: Path) -> bool:
    """Compare the CPU time of starts; whether it is as asked."""
    scene = folder / "table.json"
    scene.write_text(json.dumps(TABLE))
    same = {"criterion": "cond", "scene": str(scene), "starts": starts}
    sides = {"0.1": (old, {}), "now": (SOURCE, {"margin_percent": 0.0})}
    spent, wholes, conds = (defaultdict[str, list[float]](list) for _ in range(3))
    for seed in range(-1, seeds):
        for name, (source, more) in sides.items():
            each, whole, cond = designed(source, robot, seed=max(seed, 0), **same, **more)
            print(f"{robot:6s} seed {seed}: {name} {sum(each) / len(each):.2f} s a start, "
                  f"{whole:.1f} s, cond {cond:.1f}", flush=True)  # fmt: skip
            # The first round compiles.
            if seed >= 0:
                spent[name] += each
                wholes[name].append(whole)
                conds[name].append(cond)
    for what, of in (("CPU of starts", spent), ("CPU of designs", wholes)):
        before, now = of["0.1"], of["now"]
        print(f"{robot:6s} {what}: sum {sum(before):.2f} and {sum(now):.2f} s, ratio "
              f"{sum(now) / sum(before):.3f}; ratio of medians "
              f"{median(now) / median(before):.3f}")  # fmt: skip
    before, now = (median(conds[name]) for name in sides)
    print(f"{robot:6s} condition number: median {before:.1f} and {now:.1f}")
    return sum(spent["now"]) <= MOST_CPU * sum(spent["0.1"]) and now <= before


def fit_jobs(folder: Path) -> dict[str, tuple[str, Path, Path]]:
    """A robot, a log to identify from and one to predict, as files that both releases read."""
    logs = []
    for name in ("ur5_no6", "ur5_no5"):
        logs.append(folder / f"{name}.csv")
        packed = ROOT / "examples" / "data" / f"{name}.csv.gz"
        logs[-1].write_bytes(gzip.decompress(packed.read_bytes()))
    jobs = {"UR5 no6, on no5": ("ur5", logs[0], logs[1])}
    panda = DATA / "panda_gaz"
    if panda.exists():
        parts = ("time", "positions", "velocity", "torques")
        texts = [(panda / f"exciting_traj_{part}.txt").read_text().split() for part in parts]
        rows = np.column_stack([np.reshape(text, (len(texts[0]), -1)) for text in texts])
        head = ["t [s]", *(f"{kind}{j}" for kind in ("q", "qd", "effort") for j in range(1, 8))]
        halves = [folder / "panda_1.csv", folder / "panda_2.csv"]
        for path, half in zip(halves, np.array_split(rows, [len(rows) // 2]), strict=True):
            np.savetxt(path, half, "%s", delimiter=",", header=",".join(head), comments="")
        robot = str(ROOT / "examples" / "robots" / "panda.toml")
        jobs["Panda 1st half, on 2nd"] = (robot, *halves)
    return jobs


def fit(old: Path, runs: int, folder: Path) -> bool:
    """Compare `dynid fit` with release 0.1's `identify` and `report`; whether it is as asked."""

    def spent(source: Path, *words: object) -> float:
        return child(["-m", "dynid", *words], source=source, stderr=subprocess.DEVNULL).cpu_s

    good = True
    for number, (name, (robot, log, other)) in enumerate(fit_jobs(folder).items()):
        pairs = []
        for turn in range(runs + 1):
            here = folder / f"{number}-{turn}"
            here.mkdir()
            records = [here / "log.parquet", here / "validation.parquet"]
            for path, record in zip((log, other), records, strict=True):
                spent(old, "import", path, "--robot", robot, "-o", record)
            words = ("--preset", "best", "--validate", records[1], "-o", here / "estimate.json")
            before = spent(old, "identify", records[0], *words)
            before += spent(old, "report", here, "-o", here / "report.html")
            now = spent(SOURCE, "fit", robot, log, "--validate", other, "-o", here / "fit")
            # The first turn fills the caches.
            if turn:
                pairs.append((before, now))
                print(f"{name}: 0.1 {before:.1f} s, fit {now:.1f} s", flush=True)
        before, now = map(median, zip(*pairs, strict=True))
        print(f"{name}, median: 0.1 {before:.1f} s, fit {now:.1f} s: {now / before:.2f} times")
        good &= now <= MOST_FIT * before
    return good


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("old", type=Path, nargs="?", help="without it there is nothing to compare")
    parser.add_argument("--cpu", action="store_true")
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--robots", nargs="+")
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--starts", type=int)
    parser.add_argument("--runs", type=int, default=3)
    asked = parser.parse_args()
    if asked.old is None:
        print("nothing compared: name the source folder of a tree of v0.1.0")
        return
    compare, robots, seeds, starts = conditions, ["ur3", "ur5", "ur10"], 3, 4
    if asked.cpu:
        compare, robots, seeds, starts = cpu, ["ur5"], 10, 1
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        if asked.fit:
            good = [fit(asked.old, asked.runs, folder)]
        else:
            counts = asked.seeds or seeds, asked.starts or starts
            good = [compare(asked.old, one, *counts, folder) for one in asked.robots or robots]
    raise SystemExit(not all(good))


if __name__ == "__main__":
    main()
