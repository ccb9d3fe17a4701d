"""What safety costs: condition numbers of designs beside those of release 0.1.

    python benchmarks/price.py [OLD] [--robots ur3 ur5 ur10] [--seeds 3] [--starts 4]

OLD is the source folder (`src`) of a tree of v0.1.0. Both releases design by the criterion cond, as
many seeds each, in processes of their own. The new release keeps its defaults: a floor at the
mounting plane, 10 mm between bodies, 5 % below every limit. The old one, which knows no floor, gets
it as a scene, 10 mm lower: that much less clearance. Prints a line a design; exits 1 where the
median over the seeds of an arm is more than 15 % above that of 0.1.
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


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("old", type=Path, nargs="?", help="without it there is nothing to compare")
    parser.add_argument("--robots", nargs="+", default=["ur3", "ur5", "ur10"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--starts", type=int, default=4)
    asked = parser.parse_args()
    if asked.old is None:
        print("nothing compared: name the source folder of a tree of v0.1.0")
        return
    dear = 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "floor.json").write_text(json.dumps(SCENE))
        for robot in asked.robots:
            pairs: list[tuple[float, float]] = []
            for seed in range(asked.seeds):
                words = [robot, "--starts", str(asked.starts), "--seed", str(seed)]
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
