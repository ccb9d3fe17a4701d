"""Speed beside the plain way, in turn on one thread; the fastest round counts.

    python benchmarks/speed.py [start|sums|designs|header|runs...]

`start`: wall time of `dynid --help` beside `python -c "import numpy"`.
`sums`: regressor and products of a UR5 (52 columns) beside a loop over pinocchio's regressor with
products of its rows.
`designs`: what the genetic algorithm asks for, from Fourier coefficients to the criterion (paper's
columns, 1250 samples), beside pinocchio in a loop and `numpy.linalg.cond`; and its gradient.
`header`: the generated C header, compiled with -O2; UR5 with the paper's friction, and with
friction that grows with load and torque ripple of two waves, cubic in speed, of every joint.
`runs`: 60 s of a plan with `--on sim`, by CPU time, and on the controller in virtual time.

Asked figures stand beside what is measured; exits with 1 where one is missed. Needs pinocchio (pip
install 'dynid[dev]') and a C compiler.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
from shared.measuring import ROOT, asked, child, fastest, run
from shared.pinocchio_arm import PinocchioArm

from dynid.core import Array, one_thread
from dynid.drivers import Driver, SimulatedDriver, UrDriver, inspect
from dynid.excitation import CRITERIA, GramKernel, parse_criterion
from dynid.experiment import ExperimentPlan
from dynid.export import write_model
from dynid.export.generated_code import c_prefix
from dynid.export.verification import C_FLAGS, c_compiler
from dynid.identification import PanelRows, PassPlan, sum_rows
from dynid.recording import RecordMetadata, RecordWriter
from dynid.reduction import reduce_model
from dynid.regressor import FrictionTerms, Gear, InverseDynamicModel, TorqueRipple
from dynid.robot import load_robot
from dynid.signals import Samples
from dynid.simulation import simulated_arm
from dynid.trajectory import harmonic_basis, motion_family
from urtwin import controller_process

sys.path.insert(0, str(ROOT / "tests" / "export"))
import known_exports

SAMPLES, FEW, PERIOD, HARMONICS = 20_000, 1250, 10.0, 5
COMMANDS = {
    "numpy": ("-c", "import numpy"),
    "help": ("-m", "dynid", "--help"),
    "version": ("-m", "dynid", "--version"),
}
SAME = 1e-8
"""The two ways must agree, to this share of the largest number."""
POSE = np.array([0.1, -1.4, 0.3, -2.1, 0.2, 0.1])
CALLS, RUNS = 200_000, 7
PROGRAM = """
#include <stdio.h>
#include <time.h>
#include "arm.h"

int main(void)
{
    double q[6], dq[6], ddq[6], torque[6], sum = 0.0;
    clock_t start;
    long call;
    int i;
    for (i = 0; i < 6; ++i) q[i] = 0.3 * i, dq[i] = 0.5 - 0.2 * i, ddq[i] = 1.0 - i;
    start = clock();
    for (call = 0; call < CALLS; ++call) {
        for (i = 0; i < 6; ++i) q[i] += 1e-5, dq[i] += 1e-6;
        NAME_inverse_dynamics(q, dq, ddq, torque);
        for (i = 0; i < 6; ++i) sum += torque[i];
    }
    printf("%.9g %.17g", (double)(clock() - start) / CLOCKS_PER_SEC / CALLS, sum);
    return 0;
}
"""


def start() -> bool:
    works = {name: partial(child, words) for name, words in COMMANDS.items()}
    times = fastest(works, 20, clock=time.perf_counter)
    print(", ".join(f"{name} {1e3 * seconds:.0f} ms" for name, seconds in times.items()))
    return asked("dynid --help over import of numpy", times["help"] / times["numpy"], most=4)


def sums() -> bool:
    model = InverseDynamicModel(robot=load_robot("ur5"))
    base, n = reduce_model(model), 6
    q, dq, ddq, torque = np.random.default_rng(0).uniform(-3, 3, (4, SAMPLES, n))
    samples = Samples(
        t=np.arange(SAMPLES) / 500, q=q, dq=dq, ddq=ddq, tau=torque, rate_hz=500, cutoff_hz=5
    )
    plan = PassPlan(
        base=base, values=np.zeros(base.rank), weights=np.ones(n), lag=150, regions=None,
        stretches=8, factors=False,
    )  # fmt: skip
    panels, theirs = PanelRows(base), PinocchioArm(model.robot)
    inertial = [k for k in base.independent if k < 10 * n]
    rows = np.zeros((FEW, n, base.rank + 1))

    def ours() -> list[Array]:
        total = [np.zeros(()) for _ in range(n)]
        for _, parts in panels.chunks(samples, slice(0, SAMPLES)):
            total = [a + panel @ panel.T for a, panel in zip(total, parts, strict=True)]
        return total

    def plain() -> Array:
        # What a patient user writes: rows in a loop, products of a thousand samples at a time.
        of = theirs.model, theirs.data
        for k in range(FEW):
            columns = pin.computeJointTorqueRegressor(*of, q[k], dq[k], ddq[k])
            rows[k, :, : len(inertial)] = columns[:, inertial]
        rows[..., -1] = torque[:FEW]
        by_joint = rows.transpose(1, 2, 0)
        return by_joint @ by_joint.transpose(0, 2, 1)

    every = slice(0, SAMPLES)
    scores = partial(sum_rows, panels, plan, samples, every, 0, SAMPLES)
    times = fastest({"pinocchio": plain, "sums": ours, "with scores and cells": scores}, 12)
    each = {name: 1e6 * x / (FEW if name == "pinocchio" else SAMPLES) for name, x in times.items()}
    print(", ".join(f"{name} {us:.2f} us a sample" for name, us in each.items()))
    return asked("throughput of sums over pinocchio's", each["pinocchio"] / each["sums"], least=10)


def designs() -> bool:
    model = InverseDynamicModel(robot=load_robot("ur5"), frames="dh")
    base, theirs = reduce_model(model), PinocchioArm(model.robot, "dh")
    basis = harmonic_basis(np.arange(FEW) * PERIOD / FEW, PERIOD, HARMONICS)
    numbers = np.random.default_rng(0).normal(size=(2 * HARMONICS, 6)) * 0.3
    kernel, w = GramKernel(base, coulomb_width=None), np.zeros((FEW, 6, len(model.columns)))

    def plain() -> float:
        rows = theirs.rows(*(part @ numbers for part in basis), out=w).reshape(FEW * 6, -1)
        return float(np.linalg.cond(rows[:, base.independent]))

    def value(name: str) -> float:
        return parse_criterion(name).value(kernel.gram(*(part @ numbers for part in basis)))

    def gradient(name: str) -> Array:
        gram = kernel.gram(*(part @ numbers for part in basis))
        bars = kernel.pullback(parse_criterion(name).objective_and_gradient(gram)[1])
        return sum((part.T @ bar for part, bar in zip(basis, bars, strict=True)), np.zeros(()))

    if abs(value("cond") - plain()) > SAME * plain():
        raise SystemExit(f"the two ways disagree: {value('cond')} and {plain()}")
    works: dict[str, Callable[[], object]] = {"plain": plain}
    for name in CRITERIA:
        works |= {name: partial(value, name), f"{name}, gradient": partial(gradient, name)}
    times = fastest(works, 200, {"plain"})
    print(", ".join(f"{name} {1e3 * seconds:.2f} ms" for name, seconds in times.items()))
    worst = max(times[f"{name}, gradient"] / times[name] for name in CRITERIA)
    missed = asked("condition number over the plain way", times["cond"] / times["plain"], most=0.1)
    return asked("value and gradient over value", worst, most=4) or missed


def header() -> bool:
    random = np.random.default_rng(0)
    gears = [Gear(joint=j, waves=(120.0, 240.0), speed=2.0, powers=4) for j in range(6)]
    weights = tuple(random.normal(size=gears[0].size).tolist())
    ripples = tuple(TorqueRipple(joint=g.joint, gears=(g,), coefficients=weights) for g in gears)
    more = replace(known_exports.with_load(FrictionTerms(), 6), ripples=ripples)
    missed, robot = False, load_robot("ur5")
    for name, terms in (("friction", FrictionTerms()), ("load and ripple, too", more)):
        known = known_exports.parameters_of(robot, friction=terms)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder)
            write_model(known_exports.estimate_of(robot, known, terms), path / "arm.h", "c")
            source = PROGRAM.replace("NAME", c_prefix(robot.name)).replace("CALLS;", f"{CALLS};")
            (path / "main.c").write_text(source.replace("/ CALLS,", f"/ {CALLS},"))
            words = [c_compiler() or "cc", *C_FLAGS, path / "main.c", "-o", path / "main", "-lm"]
            subprocess.run(words, check=True)
            told = [subprocess.check_output([path / "main"]) for _ in range(RUNS)]
        each = 1e6 * min(float(line.split()[0]) for line in told)
        missed |= asked(f"header, {name}: us a call", each, most=2)
    return missed


def runs() -> bool:
    robot, periods = load_robot("ur5"), 6
    free = 0.05 * np.random.default_rng(0).normal(size=(6, 8))
    motion = motion_family("fourier", 10.0, 5).trajectory(POSE, free)
    plan = ExperimentPlan(robot=robot, trajectory=motion, periods=periods)
    with tempfile.TemporaryDirectory() as folder:

        def ran(driver: Driver, clock: Callable[[], float]) -> float:
            path, source = Path(folder) / "run.parquet", driver.source
            words = (path, robot.joint_names, source.quantities, RecordMetadata(robot="ur5"))
            begun = clock()
            with RecordWriter(*words, channels=source.channels, force=True) as recorder:
                outcome = driver.execute(plan.passes()[-1].execution, recorder)
            if outcome.abort is not None:
                raise SystemExit(f"stopped: {outcome.abort}")
            return 10 * periods / (clock() - begun)

        # The first one compiles.
        alone = [ran(SimulatedDriver(simulated_arm(robot)), time.process_time) for _ in range(2)]
        with controller_process("ur5", virtual_time=True, hold=True) as controller:
            virtual = ran(UrDriver(inspect(controller.host)), time.perf_counter)
    missed = asked("run in process, times real time by CPU", alone[-1], least=20)
    return asked("run in virtual time, times real time", virtual, least=5) or missed


@one_thread()
def main(parts: tuple[str, ...] = (), /) -> bool:
    known = {one.__name__: one for one in (start, sums, designs, header, runs)}
    return sum(known[name]() for name in parts or known) > 0


if __name__ == "__main__":
    run(main)
