"""Excitation design side by side: the genetic algorithm and the gradient, with and without a scene.

The paper's problem: UR5, dh frames, paper's columns and limits, 10 s, 5 harmonics, 1250 samples.
Everything runs after one another in this process, but for the gradient's workers; times are wall
times. What a motion costs beside the plain way is told by `regressor.py`.

    python benchmarks/design.py [--seeds 10] [--quick]
"""

import json
import tempfile
from pathlib import Path

import numpy as np
from shared.measuring import run

from dynid import DesignSettings, ExcitationDesign, design

SCENE = {
    "shapes": [
        {"type": "floor", "height": -0.75},
        {"type": "table", "size": [1.2, 0.8], "position": [0, 0, 0]},
    ]
}


class Table:
    """The rows, printed as they come, and whether every asked figure is met."""

    met = True

    def row(self, what: str, measured: str, asked: str, met: bool) -> None:
        """Print one."""
        print(f"{what:44} {measured:58} {asked:26} {'yes' if met else 'NO'}", flush=True)
        self.met &= met

    def gradient(
        self, what: str, most: float, seconds: float, asked: str, **settings: object
    ) -> ExcitationDesign:
        """A row of a design, and the design."""
        found = design("ur5", DesignSettings(criterion="cond", jobs=2, **settings))
        cond, wall = found.condition_number, found.wall_s
        told = f"cond {cond:.1f} in {wall:.1f} s, {found.starts} starts, {found.ended_by}"
        self.row(what, told, asked, cond <= most and wall <= seconds and found.feasible)
        return found


def main(seeds: int = 10, quick: bool = False) -> bool:
    """Print the table; true if an asked figure is missed."""
    table, number = Table(), 2 if quick else seeds
    design("ur5", DesignSettings(limits="paper", starts=1))
    genetic = [
        design("ur5", DesignSettings(limits="paper", method="ga", seed=k)) for k in range(number)
    ]
    conds = [found.condition_number for found in genetic]
    said = f"cond {min(conds):.1f} to {max(conds):.1f}, {genetic[0].evaluations} motions"
    table.row(f"GA 300 x 5, seeds 0-{number - 1}", said, "<= 153, every seed", max(conds) <= 153)
    found = table.gradient("gradient, default budget", 52, 15, "<= 52 in 15 s", limits="paper")
    below = min((e.wall_s for e in found.history if e.value <= 60 and e.feasible), default=np.inf)
    wall = float(np.median([found.wall_s for found in genetic]))
    said = f"after {below:.2f} s; the GA finishes after {wall:.2f} s"
    table.row("gradient, first design below 60", said, "sooner", below < wall)
    if not quick:
        what = "gradient, --budget 60"
        table.gradient(what, 46, np.inf, "<= 46", limits="paper", budget_s=60.0)
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.json"
        scene.write_text(json.dumps(SCENE))
        what = "everything on, floor and table, --budget 30"
        asked = "<= 110 in 60 s, certified"
        table.gradient(what, 110, 60, asked, scene=str(scene), budget_s=30.0)
    return not table.met


if __name__ == "__main__":
    run(main)
