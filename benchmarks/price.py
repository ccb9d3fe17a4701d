"""What safety costs: condition numbers, or CPU time, of designs beside those of release 0.1.

    python benchmarks/price.py [OLD] [--robots ur3 ur5 ur10] [--seeds 3] [--starts 4]
    python benchmarks/price.py OLD --cpu [--robots ur5] [--seeds 10] [--starts 1]

OLD is the source folder (`src`) of a tree of v0.1.0. Both releases design by the criterion cond, as
many seeds each, in processes of their own. The new release keeps its defaults: a floor at the
mounting plane, 10 mm between bodies, 5 % below every limit. The old one, which knows no floor, gets
it as a scene, 10 mm lower: that much less clearance. Prints a line a design; exits 1 where the
median over the seeds of an arm is more than 15 % above that of 0.1.

`--cpu` compares the CPU time of a start, all limits on, above a table, both releases in turn, in
processes whose kernels are compiled, with the same limits (`--margin 0`; the new release keeps
10 mm to itself too). Exits 1 where the sum is above a third of that of 0.1, or the median condition
number of the designs above its own.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

MOST_PERCENT = 15.0
CLEARANCE_M = 0.01
"""The new release's, which the old one is spared at its floor."""
SCENE = {"shapes": [{"type": "floor", "height": -CLEARANCE_M}]}
TABLE = {"shapes": [{"type": "table", "size": [1.2, 0.8], "position": [0, 0, 0]},
                    {"type": "floor", "height": -0.75}]}  # fmt: skip
MOST_CPU = 1 / 3
TIMED = """
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
found = design(robot, DesignSettings(criterion="cond", jobs=1, **settings))
whole = time.process_time() - began
print(json.dumps([spent, whole, found.condition_number if found.feasible else float("inf")]))
"""
"""Run by both releases: CPU time of the starts and of the whole design [s], condition number."""
OURS = Path(__file__).parents[1] / "src"


def designed(source: Path, words: list[str], file: Path) -> float:
    """Run a release's `dynid design`; the condition number that it tells."""
    found = subprocess.run(
        [sys.executable, "-m", "dynid", "design", *words, "-o", str(file), "--json"],
        env=os.environ | {"PYTHONPATH": str(source)},
        stdout=subprocess.PIPE,
        check=True,
    )
    told = json.loads(found.stdout)
    if not told["feasible"]:
        raise SystemExit(f"{source}: no feasible motion for {' '.join(words)}")
    return float(told["condition_number"])


def timed(
    source: Path, robot: str, settings: dict[str, object]
) -> tuple[list[float], float, float]:
    """A release's CPU times of the starts and of the design [s], and the condition number."""
    found = subprocess.run(
        [sys.executable, "-c", TIMED, json.dumps([robot, settings])],
        env=os.environ | {"PYTHONPATH": str(source), "OPENBLAS_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        check=True,
    )
    return json.loads(found.stdout)


def cpu(old: Path, robot: str, seeds: int, starts: int, scene: str) -> bool:
    """Compare the CPU time of starts; whether it is as asked."""
    sides = {"0.1": (old, {}), "now": (OURS, {"margin_percent": 0.0})}
    spent: dict[str, list[float]] = {name: [] for name in sides}
    wholes, conds = ({name: [] for name in sides} for _ in range(2))
    for seed in range(-1, seeds):
        line = f"{robot:6s} seed {seed}:"
        for name, (source, more) in sides.items():
            settings = {"scene": scene, "seed": max(seed, 0), "starts": starts, **more}
            each, whole, cond = timed(source, robot, settings)
            # The first round compiles.
            if seed >= 0:
                spent[name] += each
                wholes[name].append(whole)
                conds[name].append(cond)
            line += (
                f" {name} {sum(each) / len(each):.2f} s a start, {whole:.1f} s, cond {cond:.1f};"
            )
        print(line, flush=True)
    for what, of, form in (("CPU of starts", spent, ".2f"), ("of designs", wholes, ".1f")):
        before, after = of["0.1"], of["now"]
        print(f"{robot:6s} {what}: sum {sum(before):{form}} and {sum(after):{form}} s, ratio "
              f"{sum(after) / sum(before):.3f}; ratio of medians "
              f"{statistics.median(after) / statistics.median(before):.3f}")  # fmt: skip
    before, after = (statistics.median(conds[name]) for name in sides)
    print(f"{robot:6s} condition number: median {before:.1f} and {after:.1f}")
    return sum(spent["now"]) <= MOST_CPU * sum(spent["0.1"]) and after <= before


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("old", type=Path, nargs="?", help="without it there is nothing to compare")
    parser.add_argument("--cpu", action="store_true")
    parser.add_argument("--robots", nargs="+")
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--starts", type=int)
    asked = parser.parse_args()
    robots = asked.robots or (["ur5"] if asked.cpu else ["ur3", "ur5", "ur10"])
    seeds, starts = asked.seeds or (10 if asked.cpu else 3), asked.starts or (1 if asked.cpu else 4)
    if asked.old is None:
        print("nothing compared: name the source folder of a tree of v0.1.0")
        return
    dear = 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "floor.json").write_text(json.dumps(SCENE))
        if asked.cpu:
            (folder / "table.json").write_text(json.dumps(TABLE))
            scene = str(folder / "table.json")
            good = [cpu(asked.old, robot, seeds, starts, scene) for robot in robots]
            raise SystemExit(not all(good))
        for robot in robots:
            pairs: list[tuple[float, float]] = []
            for seed in range(seeds):
                words = [robot, "--starts", str(starts), "--seed", str(seed)]
                old_words = [*words, "--criterion", "cond", "--scene", str(folder / "floor.json")]
                old = designed(asked.old, old_words, folder / f"{robot}-{seed}-old.json")
                new = designed(OURS, [*words, "--for", "cond"], folder / f"{robot}-{seed}-new.json")
                pairs.append((old, new))
                print(f"{robot:6s} seed {seed}: 0.1 {old:8.1f}, now {new:8.1f}", flush=True)
            old, new = (statistics.median(values) for values in zip(*pairs, strict=True))
            percent = 100 * (new / old - 1)
            dear += percent > MOST_PERCENT
            print(f"{robot:6s} median: 0.1 {old:.1f}, now {new:.1f}: {percent:+.0f} %", flush=True)
    raise SystemExit(bool(dear))


if __name__ == "__main__":
    main()
