"""What physically consistent parameters cost against weighted least squares, record by record.

The same columns, settings and weights, each fitted by `wls` and by `sdp`. Asked: the weighted
residual sum grows by 2 % at most, errors on the other part by 1 %, pseudo-inertias and the mass
matrix are positive (1e5 random poses), masses are within a factor of 3 of published ones, and a
six-joint arm takes 2 s of CPU. Needs the extra `sdp`; the real recordings are read from
../shared/data, or the folder given, where they are.

    python benchmarks/consistent.py [DATA [NAME...]]
"""

import time
from pathlib import Path

import numpy as np
from real_recordings import Case, cases, identified
from shared.measuring import DATA, print_head, print_row, run

import dynid
from dynid.core import Array, one_thread
from dynid.identification import (
    PRIOR_GAIN,
    Estimate,
    IdentificationProblem,
    PhysicallyConsistent,
    WeightedLeastSquares,
)
from dynid.identification.physical import residual_sum
from dynid.identification.problem import joint_factors
from dynid.reduction import reduce_model
from dynid.robot import to_pseudo_inertia
from dynid.signals import process
from dynid.simulation import simulate, simulated_arm
from dynid.trajectory import random_excitation
from dynid.workflow.running import record_of

POSES = 100_000
ASKED = "residual +2 %, held out +1 %, all positive, masses within 3, 2 s"


def simulated() -> list[Case]:
    """The simulated UR5, one motion for another."""
    robot = dynid.load_robot("ur5")
    records: list[dynid.ExperimentRecord] = []
    for seed in (1, 2):
        motion = random_excitation(robot.limits, seed=seed, period_s=20.0, acceleration=8.0)
        records.append(record_of(simulate(simulated_arm(robot), motion, seed=seed)))
    return [Case("simulated UR5", records[0], robot, records[1])]


def smallest_mass_eigenvalue(estimate: Estimate) -> float:
    """Over random poses [kg.m^2]."""
    model, parameters = estimate.model, estimate.standard_parameters()
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, size=(POSES, model.robot.joints))
    return float(np.linalg.eigvalsh(model.mass_matrix(q, parameters)).min())


def compared(case: Case, plain: Estimate) -> tuple[float, float, float]:
    """Both fits of one problem.

    Growth of the weighted residual sum [%], the largest move of a parameter [standard deviations],
    and CPU seconds of the consistent fit.
    """
    samples = process(case.record, case.robot, plain.settings)
    problem = IdentificationProblem(base=reduce_model(plain.model), samples=samples)
    factors = joint_factors(problem)
    fit = WeightedLeastSquares(prior_gain=PRIOR_GAIN).fit(problem)
    least = residual_sum(factors, fit.weights, fit.values)
    started = time.process_time()
    bodies = PhysicallyConsistent(prior_gain=PRIOR_GAIN).fit(problem)
    seconds = time.process_time() - started
    moved = float((np.abs(bodies.values - fit.values) / plain.std).max())
    return 100 * (residual_sum(factors, fit.weights, bodies.values) / least - 1), moved, seconds


def mass_ratio(case: Case, values: Array) -> float:
    """The largest factor between an identified and a published mass; NaN without any."""
    published = np.array([body[0] for body in case.robot.inertias])
    found = values[: 10 * len(published) : 10]
    known = published > 0
    if not known.any():
        return float("nan")
    return float(np.exp(np.abs(np.log(found[known] / published[known])).max()))


def cells(case: Case, preset: str) -> tuple[str, ...]:
    """Identify both ways and give a row of the table."""
    results = [
        identified(case, dynid.IdentifySettings(preset=preset, estimator=word))
        for word in ("wls", "sdp")
    ]
    plain, consistent = results
    standard = consistent.estimate.standard
    assert standard is not None
    errors = [x.validation.metrics.normalized_error for x in results if x.validation]
    growth, moved, seconds = compared(case, plain.estimate)
    n = case.robot.joints
    bodies = to_pseudo_inertia(standard.values[: 10 * n].reshape(n, 10))
    return (
        case.name,
        preset,
        f"{growth:+.1f}",
        f"{100 * (errors[1] / errors[0] - 1):+.1f}",
        f"{np.linalg.eigvalsh(bodies).min():.1e}",
        f"{smallest_mass_eigenvalue(consistent.estimate):.1e}",
        f"{mass_ratio(case, standard.values):.2f}",
        f"{moved:.1f}",
        f"{seconds:.2f}",
    )


@one_thread()
def main(data: Path = DATA, names: tuple[str, ...] = (), /) -> None:
    """Print the table."""
    columns = "record, preset, residual [%], held out [%], pseudo-inertia, mass matrix"
    print_head((columns + ", mass over published, moved [std], CPU s").split(", "))
    for case in [*simulated(), *(cases(data) if data.exists() else [])]:
        if names and not case.name.startswith(tuple(names)):
            continue
        for preset in ("paper", "best"):
            print_row(cells(case, preset))
    print(f"asked: {ASKED}")


if __name__ == "__main__":
    run(main)
