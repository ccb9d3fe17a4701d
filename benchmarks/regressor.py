"""Speed of the regressor, and cost of a design evaluation and its gradient, beside the plain way.

UR5, one thread. The plain way is a Python loop over pinocchio's regressor, for a design evaluation
with `numpy.linalg.cond` of the W (7500 x 52) that it fills. Sides alternate, so that both meet the
same load of the machine, and the fastest round counts.

`columns`: both fill the inertial columns of 1248 samples. Asked: six times pinocchio's throughput.
`designs`: a value is what the genetic algorithm asks for: motion from Fourier coefficients, Gram
matrix, criterion; paper's columns, 1250 samples. Asked: a tenth of the plain way's time, and at
most four values for a value with its gradient, whatever the criterion.
Needs pinocchio: pip install 'dynid[dev]'.
"""

import os
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from shared.measuring import fastest, run
from shared.pinocchio_arm import PinocchioArm

from dynid.excitation import CRITERIA, Criterion, GramKernel, parse_criterion
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.regressor.inertial import inertial_columns
from dynid.robot import load_robot
from dynid.trajectory import harmonic_basis

COLUMN_SAMPLES, SAMPLES, PERIOD, HARMONICS = 1248, 1250, 10.0, 5
COLUMN_ROUNDS, ROUNDS = 60, 200
ASKED_THROUGHPUT, ASKED_VALUE, ASKED_GRADIENT = 6.0, 0.1, 4.0
SAME_COLUMNS, SAME_CONDITION = 1e-9, 1e-8
"""The two ways must agree, to this share of the largest number."""


def columns(model: InverseDynamicModel, theirs: PinocchioArm) -> bool:
    """Print the times of the columns; whether they are as asked."""
    constants, n = model.constants, model.robot.joints
    q, dq, ddq = np.random.default_rng(0).uniform(-3, 3, (3, COLUMN_SAMPLES, n))
    by_joint = model.motion(q, dq, ddq)
    loop_out = np.empty((COLUMN_SAMPLES, n, 10 * n))
    columns_out = np.zeros((10 * n, n, COLUMN_SAMPLES))
    reference = "pinocchio, loop over computeJointTorqueRegressor, 60 columns"
    asked = "dynid, inertial_columns, 60 columns"
    times = fastest(
        {
            reference: lambda: theirs.loop(q, dq, ddq, loop_out),
            asked: lambda: inertial_columns(constants, by_joint, columns_out),
        },
        COLUMN_ROUNDS,
    )
    truth = theirs.rows(q, dq, ddq)[:, :, : 10 * n]
    if np.abs(columns_out.transpose(2, 1, 0) - truth).max() > SAME_COLUMNS * np.abs(truth).max():
        raise SystemExit("the two regressors disagree")
    print(f"UR5, {COLUMN_SAMPLES} samples, one thread, fastest of {COLUMN_ROUNDS} rounds")
    print(f"{'':62}{'us/sample':>10}{'ratio':>7}")
    for name, seconds in times.items():
        each = 1e6 * seconds / COLUMN_SAMPLES
        print(f"{name:62}{each:10.3f}{times[reference] / seconds:7.2f}")
    ratio = times[reference] / times[asked]
    print(f"throughput {ratio:.1f} times that of the loop; asked: {ASKED_THROUGHPUT:g}")
    return ratio >= ASKED_THROUGHPUT


def designs(model: InverseDynamicModel, theirs: PinocchioArm) -> bool:
    """Print the times of design evaluations; whether they are as asked."""
    base, n = reduce_model(model), model.robot.joints
    basis = harmonic_basis(np.arange(SAMPLES) * PERIOD / SAMPLES, PERIOD, HARMONICS)
    numbers = np.random.default_rng(0).normal(size=(2 * HARMONICS, n)) * 0.3
    kernel = GramKernel(model, base, coulomb_width=None)
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
            gram = kernel.gram(*motion())
            bars = kernel.pullback(criterion.objective_and_gradient(gram)[1])
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
        raise SystemExit(f"the two ways disagree: {here} and {there}")
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
    return ratio <= ASKED_VALUE and worst <= ASKED_GRADIENT


def main() -> bool:
    """Print the tables; true if an asked figure is missed."""
    model = InverseDynamicModel(robot=load_robot("ur5"), frames="dh")
    theirs = PinocchioArm(model.robot, model.frames)
    return not all([columns(model, theirs), designs(model, theirs)])


if __name__ == "__main__":
    run(main)
