"""Excitation design side by side: ours, the plain way, random motions.

The paper's problem: UR5, dh frames, paper's columns and limits, 10 s, 5 harmonics, 1250 samples.
Everything runs after one another in this process, but for the last row's workers; times are CPU
time of this process where two sides are compared, the fastest round of each, and wall time where
a budget is asked for.
Needs pinocchio: pip install 'dynid[dev]'. Options: --seeds N (10), --quick.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from shared.pinocchio_arm import PinocchioArm
from threadpoolctl import threadpool_limits

from dynid import DesignSettings, design
from dynid.constraints import paper_constraints
from dynid.excitation import (
    DesignEvaluation,
    ExcitationProblem,
    GeneticAlgorithm,
    by_optimiser,
    parse_criterion,
    random_numbers,
    region_of,
)
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.robot import load_robot
from dynid.trajectory import FourierFamily

PLAIN_MOTIONS = 180
"""Motions that the plain way evaluates, which takes as long as a genetic run; its time is scaled up
to as many motions."""
SCENE = {
    "shapes": [
        {"type": "floor", "height": -0.75},
        {"type": "table", "size": [1.2, 0.8], "position": [0, 0, 0]},
    ]
}


class Table:
    """The rows, printed as they come, and whether every asked figure is met."""

    met = True

    def row(self, what: str, measured: str, asked: str, met: bool | None) -> None:
        """Print one; None where nothing is asked."""
        word = {None: "", True: "yes", False: "NO"}[met]
        print(f"{what:44} {measured:58} {asked:26} {word}", flush=True)
        self.met &= met is not False


def paper_problem() -> ExcitationProblem:
    robot = load_robot("ur5")
    return ExcitationProblem(
        base=reduce_model(InverseDynamicModel(robot=robot)),
        criterion=parse_criterion("cond"),
        family=FourierFamily(period=10.0, harmonics=5),
        constraints=paper_constraints(robot),
    )


def plain_seconds(problem: ExcitationProblem) -> float:
    """CPU time of one evaluation: pinocchio's regressor in a loop, then numpy.linalg.cond."""
    arm, columns = PinocchioArm(problem.base.model.robot), list(problem.base.independent)
    numbers = random_numbers(region_of(problem), PLAIN_MOTIONS, np.random.default_rng(0), fill=1.0)
    began = time.process_time()
    for x in numbers:
        motion = problem.family.trajectory(x[:, 0], x[:, 1:]).evaluate(problem.times)
        w = arm.rows(motion.q, motion.dq, motion.ddq)
        np.linalg.cond(w.reshape(-1, w.shape[2])[:, columns])
    return (time.process_time() - began) / PLAIN_MOTIONS


def genetic(table: Table, problem: ExcitationProblem, seeds: int) -> tuple[float, float]:
    """The rows of the genetic algorithm; median wall and least CPU time of a run [s]."""
    plains, conds, walls, cpus, ga = [], [], [], [], GeneticAlgorithm()
    for seed in range(seeds):
        # Turn by turn, so that both sides meet the same load of the machine.
        plains.append(plain_seconds(problem))
        began = time.process_time()
        found = by_optimiser(problem, ga, seed=seed)
        cpus.append(time.process_time() - began)
        walls.append(found.wall_s)
        conds.append(float(np.exp(found.search.candidates[0][0].objective)))
    plain, ours = min(plains) * ga.evaluations, min(cpus)
    table.row(
        f"GA 300 x 5, seeds 0-{seeds - 1}",
        f"cond {min(conds):.1f} to {max(conds):.1f}, {ga.evaluations} motions",
        "<= 153, every seed",
        max(conds) <= 153,
    )
    table.row(
        "GA, time of a run against the plain way",
        f"{ours:.2f} s against {plain:.1f} s: 1/{plain / ours:.1f}",
        "<= 1/10",
        plain / ours >= 10,
    )
    return float(np.median(walls)), ours


def random_motions(table: Table, problem: ExcitationProblem, seconds: float) -> None:
    """The best random motion in as much CPU time as one genetic run takes."""
    evaluation, region = DesignEvaluation(problem), region_of(problem)
    random = np.random.default_rng(0)
    best, count, began = np.inf, 0, time.process_time()
    with threadpool_limits(limits=1, user_api="blas"):
        while time.process_time() - began < seconds:
            best = min(best, evaluation.value(random_numbers(region, 1, random, fill=1.0)[0]))
            count += 1
    table.row(f"random, best of {count} in the GA's time", f"cond {np.exp(best):.1f}", "-", None)


def main() -> int:
    """Print the table; 1 if an asked figure is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--quick", action="store_true")
    asked = parser.parse_args()
    table, problem = Table(), paper_problem()
    DesignEvaluation(problem).warm_up()
    ga_wall, ga_cpu = genetic(table, problem, 2 if asked.quick else asked.seeds)
    random_motions(table, problem, ga_cpu)

    def gradient(what: str, most: float, seconds: float, words: str, **settings: object):
        """A row of a design, and the design."""
        found = design("ur5", DesignSettings(criterion="cond", jobs=2, **settings))
        cond, wall = found.condition_number, found.wall_s
        told = f"cond {cond:.1f} in {wall:.1f} s, {found.starts} starts, {found.ended_by}"
        table.row(what, told, words, cond <= most and wall <= seconds and found.feasible)
        return found

    found = gradient("gradient, default budget", 52, 15, "<= 52 in 15 s", limits="paper")
    below = min((e.wall_s for e in found.history if e.value <= 60 and e.feasible), default=np.inf)
    table.row(
        "gradient, first design below 60",
        f"after {below:.2f} s; the GA finishes after {ga_wall:.2f} s",
        "sooner",
        below < ga_wall,
    )
    if not asked.quick:
        what = "gradient, --budget 60"
        gradient(what, 46, np.inf, "<= 46", limits="paper", budget_s=60.0)
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.json"
        scene.write_text(json.dumps(SCENE))
        what = "everything on, floor and table, --budget 30"
        words = "<= 110 in 60 s, certified"
        gradient(what, 110, 60, words, scene=str(scene), budget_s=30.0)
    return int(not table.met)


if __name__ == "__main__":
    sys.exit(main())
