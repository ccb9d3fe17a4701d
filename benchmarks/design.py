"""Excitation design side by side: ours, the plain way, random motions.

The paper's problem: UR5, dh frames, paper's columns and limits, 10 s, 5 harmonics, 1250 samples.
Everything runs after one another in this process, but for the last row's workers; times are CPU
time of this process where two sides are compared, the fastest round of each, and wall time where
a budget is asked for.
Needs pinocchio: pip install 'dynid[dev]'. Options: --seeds N (10), --quick.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from threadpoolctl import threadpool_limits

from dynid import DesignSettings, ExcitationDesign, design
from dynid.constraints import paper_constraints
from dynid.excitation import (
    DesignEvaluation,
    ExcitationProblem,
    by_genetic_algorithm,
    parse_criterion,
    random_numbers,
    region_of,
)
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.robot import load_robot
from dynid.trajectory import FourierFamily
from regressor import pinocchio_model

PLAIN_MOTIONS = 180
"""Motions that the plain way evaluates, which takes as long as a genetic run; its time is scaled up
to as many motions."""
SCENE = """{"shapes": [{"type": "floor", "height": -0.75},
 {"type": "table", "size": [1.2, 0.8], "position": [0, 0, 0]}]}"""


class Row(NamedTuple):
    """One line of the table."""

    what: str
    measured: str
    asked: str
    met: bool | None


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
    robot = problem.base.model.robot
    theirs, _ = pinocchio_model(robot, problem.base.model.frames)
    data = theirs.createData()
    columns = list(problem.base.independent)
    n = robot.joints
    random = np.random.default_rng(0)
    region = region_of(problem)
    numbers = random_numbers(region, PLAIN_MOTIONS, random, fill=1.0)
    began = time.process_time()
    for x in numbers:
        motion = problem.family.trajectory(x[:, 0], x[:, 1:]).evaluate(problem.times)
        w = np.zeros((len(motion.t), n, 13 * n))
        for k in range(len(motion.t)):
            w[k, :, : 10 * n] = pin.computeJointTorqueRegressor(
                theirs, data, motion.q[k], motion.dq[k], motion.ddq[k]
            )
        own = np.arange(n)
        w[:, own, 10 * n + own] = np.tanh(motion.dq / 0.001)
        w[:, own, 11 * n + own] = motion.dq
        w[:, own, 12 * n + own] = motion.ddq
        np.linalg.cond(w.reshape(-1, 13 * n)[:, columns])
    return (time.process_time() - began) / PLAIN_MOTIONS


def genetic_rows(problem: ExcitationProblem, seeds: int) -> tuple[list[Row], float, float]:
    """The rows, and wall and CPU time of one run."""
    plains, conds, walls, cpus, counts = [], [], [], [], []
    for seed in range(seeds):
        # Turn by turn, so that both sides meet the same load of the machine.
        plains.append(plain_seconds(problem))
        began = time.process_time()
        found = by_genetic_algorithm(problem, seed=seed)
        cpus.append(time.process_time() - began)
        walls.append(found.wall_s)
        counts.append(found.evaluations)
        conds.append(float(np.exp(found.search.candidates[0][0].objective)))
    plain, ours = min(plains), min(cpus)
    ratio = plain * counts[0] / ours
    spread = f"cond {min(conds):.1f} to {max(conds):.1f}, {counts[0]} motions"
    return (
        [
            Row(
                f"GA 300 x 5, seeds 0-{seeds - 1}", spread, "<= 153, every seed", max(conds) <= 153
            ),
            Row(
                "GA, time of a run against the plain way",
                f"{ours:.2f} s against {plain * counts[0]:.1f} s: 1/{ratio:.1f}",
                "<= 1/10",
                ratio >= 10,
            ),
        ],
        float(np.median(walls)),
        float(ours),
    )


def first_below(found: ExcitationDesign, value: float) -> float:
    return min((e.wall_s for e in found.history if e.value <= value and e.feasible), default=np.inf)


def random_row(problem: ExcitationProblem, seconds: float) -> Row:
    """The best random motion in as much CPU time as one genetic run takes."""
    evaluation, region = DesignEvaluation(problem), region_of(problem)
    random = np.random.default_rng(0)
    best, count, began = np.inf, 0, time.process_time()
    with threadpool_limits(limits=1, user_api="blas"):
        while time.process_time() - began < seconds:
            best = min(best, evaluation.value(random_numbers(region, 1, random, fill=1.0)[0]))
            count += 1
    return Row(f"random, best of {count} in the GA's time", f"cond {np.exp(best):.1f}", "-", None)


def main() -> int:
    """Print the table; 1 if an asked figure is missed."""
    quick = "--quick" in sys.argv
    seeds = int(sys.argv[sys.argv.index("--seeds") + 1]) if "--seeds" in sys.argv else 10
    problem = paper_problem()
    DesignEvaluation(problem).warm_up()
    rows, ga_wall, ga_cpu = genetic_rows(problem, 2 if quick else seeds)
    rows.append(random_row(problem, ga_cpu))
    paper = {"criterion": "cond", "limits": "paper", "jobs": 2}
    found = design("ur5", DesignSettings(**paper))
    cond = found.condition_number
    rows.append(
        Row(
            "gradient, default budget",
            f"cond {cond:.1f} in {found.wall_s:.1f} s, {found.starts} starts",
            "<= 52 in 15 s",
            cond <= 52 and found.wall_s <= 15 and found.feasible,
        )
    )
    below = first_below(found, 60)
    rows.append(
        Row(
            "gradient, first design below 60",
            f"after {below:.2f} s; the GA finishes after {ga_wall:.2f} s",
            "sooner",
            below < ga_wall,
        )
    )
    if not quick:
        found = design("ur5", DesignSettings(**paper, budget_s=60.0))
        cond = found.condition_number
        what = f"cond {cond:.1f} in {found.wall_s:.1f} s, {found.starts} starts, {found.ended_by}"
        rows.append(Row("gradient, --budget 60", what, "<= 46", cond <= 46 and found.feasible))
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.json"
        scene.write_text(SCENE)
        found = design(
            "ur5", DesignSettings(criterion="cond", scene=str(scene), jobs=2, budget_s=30.0)
        )
    cond = found.condition_number
    rows.append(
        Row(
            "everything on, floor and table, --budget 30",
            f"cond {cond:.1f} in {found.wall_s:.1f} s, feasible: {found.feasible}",
            "<= 110 in 60 s, certified",
            cond <= 110 and found.wall_s <= 60 and found.feasible,
        )
    )
    for row in rows:
        met = "" if row.met is None else ("yes" if row.met else "NO")
        print(f"{row.what:44} {row.measured:58} {row.asked:26} {met}")
    return int(any(row.met is False for row in rows))


if __name__ == "__main__":
    sys.exit(main())
