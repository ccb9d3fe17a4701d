"""Cost of one design evaluation, beside the plain way, and of its exact gradient.

A value is what the genetic algorithm asks for: motion from Fourier coefficients, Gram matrix,
condition number; UR5, paper's columns, 1250 samples, one thread. The plain way fills W (7500 x 52)
from a Python loop over pinocchio's regressor and takes `numpy.linalg.cond`. The sides alternate,
so that both meet the same load of the machine, and the fastest round counts. Asked: a tenth of the
plain way's time, and at most four values for a value with its gradient, whatever the criterion.
Needs pinocchio: pip install 'dynid[dev]'.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from shared.measuring import fastest
from shared.pinocchio_arm import PinocchioArm

from dynid.excitation import CRITERIA, Criterion, GramKernel, parse_criterion
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.robot import load_robot
from dynid.trajectory import harmonic_basis

SAMPLES, PERIOD, HARMONICS = 1250, 10.0, 5
ROUNDS = 200
ASKED_VALUE, ASKED_GRADIENT = 0.1, 4.0
SAME_CONDITION = 1e-8


def main() -> int:
    """Print the table; 1 if an asked figure is missed."""
    model = InverseDynamicModel(robot=load_robot("ur5"), frames="dh")
    base = reduce_model(model)
    n = model.robot.joints
    basis = harmonic_basis(np.arange(SAMPLES) * PERIOD / SAMPLES, PERIOD, HARMONICS)
    numbers = np.random.default_rng(0).normal(size=(2 * HARMONICS, n)) * 0.3
    kernel = GramKernel(model, base, coulomb_width=None)
    theirs = PinocchioArm(model.robot)
    w = np.zeros((SAMPLES, n, len(model.columns)))

    def motion() -> list[np.ndarray]:
        return [part @ numbers for part in basis]

    def plain() -> float:
        rows = theirs.rows(*motion(), out=w).reshape(SAMPLES * n, -1)
        return float(np.linalg.cond(rows[:, base.independent]))

    def value(kernel: GramKernel, criterion: Criterion) -> Callable[[], float]:
        return lambda: criterion.value(kernel.gram(*motion()))

    def gradient(criterion: Criterion) -> Callable[[], object]:
        def work() -> object:
            gram, pullback = kernel.gram_and_pullback(*motion())
            bars = pullback(criterion.objective_and_gradient(gram)[1])
            return sum(part.T @ bar for part, bar in zip(basis, bars, strict=True))

        return work

    cond = value(kernel, parse_criterion("cond"))
    reference = "plain: pinocchio in a loop, numpy.linalg.cond"
    asked = "dynid: cond, as the genetic algorithm asks"
    works: dict[str, Callable[[], object]] = {reference: plain, asked: cond}
    for name in CRITERIA:
        works[f"dynid: {name}"] = value(kernel, parse_criterion(name))
        works[f"dynid: {name} and gradient"] = gradient(parse_criterion(name))
    times = fastest(works, ROUNDS, {reference})
    here, there = cond(), plain()
    if abs(here - there) > SAME_CONDITION * there:
        print(f"the two ways disagree: {here} and {there}", file=sys.stderr)
        return 1
    print(f"UR5, {SAMPLES} samples, one thread, fastest of {ROUNDS} rounds; cond {here:.4f}")
    print(f"{'':48}{'ms':>8}{'of plain':>10}{'of value':>10}")
    worst = 0.0
    for name, seconds in times.items():
        share = ""
        if name.endswith(" and gradient"):
            ratio = seconds / times[name.removesuffix(" and gradient")]
            worst = max(worst, ratio)
            share = f"{ratio:10.2f}"
        print(f"{name:48}{1e3 * seconds:8.2f}{seconds / times[reference]:10.3f}{share}")
    ratio = times[asked] / times[reference]
    print(
        f"a value takes {ratio:.3f} of the plain way (asked: {ASKED_VALUE:g} at most), "
        f"a gradient {worst:.2f} values (asked: {ASKED_GRADIENT:g} at most)"
    )
    return int(ratio > ASKED_VALUE or worst > ASKED_GRADIENT)


if __name__ == "__main__":
    sys.exit(main())
