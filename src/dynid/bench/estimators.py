"""Every estimator on the same noisy records of an arm that is known: BIRDy's figures of merit.

Leboutet et al. (2021) compare estimators by the relative distance of the parameters, the error
of the predicted torque, the tracking error of the arm under a controller that uses them, and
the time.

Recordings of a simulated UR5 that obeys the paper's model exactly, with chosen noise.
"""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dynid.core import Array, DynidError, InputError, JobError, Progress, Workers, each, one_thread
from dynid.identification import ESTIMATORS, ClosedLoop, IdentificationProblem, estimator_of
from dynid.recording import ExperimentRecord
from dynid.reduction import reduce_model
from dynid.regressor import FrictionTerms, InverseDynamicModel
from dynid.robot import load_robot
from dynid.signals import ProcessingSettings, Samples, process
from dynid.simulation import SimulatedRun, simulate, simulated_arm
from dynid.trajectory import random_excitation

WIDTH = 0.02
"""Of the arm's Coulomb step and of the model's [rad/s]: the model can be right."""
POSITION_NOISE = 2.5e-5
"""Standard deviation at noise 1 [rad]."""
TORQUE_NOISE = (2.0, 2.5, 1.5, 0.4, 0.4, 0.3)
"""Standard deviation at noise 1 [N.m]: residuals of real UR5 logs (methods.md)."""
VALIDATION_SEED = 1000
"""Trajectories of the validation runs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownArm:
    """A simulated arm's runs and its true parameters."""

    model: InverseDynamicModel
    parameters: Array
    """(p) true standard parameters."""
    run: SimulatedRun
    validation: SimulatedRun

    def problem(self, noise: float, cutoff_hz: float, seed: int) -> IdentificationProblem:
        """The identification problem of the run, its motion low-passed, with noise added.

        `noise` is a factor on `POSITION_NOISE` and `TORQUE_NOISE`.
        """
        generator = np.random.default_rng(seed)
        truth = self.run.truth
        record = ExperimentRecord(
            t=self.run.t,
            signals={
                "q": truth.q + noise * POSITION_NOISE * generator.normal(size=truth.q.shape),
                "effort": truth.torque
                + noise * np.array(TORQUE_NOISE) * generator.normal(size=truth.q.shape),
            },
        )
        samples = process(record, self.model.robot, ProcessingSettings(cutoff_hz=cutoff_hz))
        return IdentificationProblem(base=reduce_model(self.model), samples=samples)


def known_arm(seed: int) -> KnownArm:
    """Simulate the UR5 on two random excitations; MuJoCo moves it, not our regressor.

    Raises:
        MissingExtraError: MuJoCo is not installed.
    """
    robot = load_robot("ur5")
    arm = simulated_arm(robot)
    zero = np.zeros(robot.joints)
    friction = replace(arm.truth.friction, width=WIDTH, viscous_decay=zero, coulomb_drift=zero)
    arm = replace(arm, truth=replace(arm.truth, friction=friction))
    table = arm.standard_parameters_in("dh")
    runs = [
        simulate(
            arm,
            random_excitation(robot.limits, seed=s, acceleration=5.5 * np.pi),
            rate_hz=250.0,
            seed=s,
        )
        for s in (seed, VALIDATION_SEED + seed)
    ]
    return KnownArm(
        model=InverseDynamicModel(robot=robot, frames="dh", friction=FrictionTerms(width=WIDTH)),
        parameters=np.concatenate([table[:, :10].ravel(), *table[:, 10:].T]),
        run=runs[0],
        validation=runs[1],
    )


SCENARIOS = (("well filtered", 1.0, 5.0), ("noise x4", 4.0, 5.0), ("badly filtered", 4.0, 60.0))
"""Name, factor on the noise, cut-off [Hz]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One estimator on one record."""

    estimator: str
    scenario: str
    seed: int
    d_beta: float = np.nan
    """(2 / r) sum |b - b_true| / (|b| + |b_true|): 0 to 2."""
    d_tau_percent: float = np.nan
    """Mean over time of ||torque error|| / ||torque|| on another motion [%]."""
    d_q_percent: float = np.nan
    """The same for positions of the true arm under computed torque with the estimate [%]."""
    seconds: float
    """CPU time of the fit [s]."""
    failure: str = ""
    """Why there is no result."""


def compare_estimators(
    estimators: Sequence[str] = ESTIMATORS,
    seeds: Sequence[int] = (0, 1, 2),
    *,
    beside: Workers | None = None,
    progress: Progress | None = None,
) -> tuple[Trial, ...]:
    """Run every estimator on every scenario and seed.

    Args:
        estimators: Words of `--estimator`.
        seeds: Of trajectories and noise.
        beside: Who takes part, a seed at a time; None for this process alone.
        progress: Told how far it is (0 to 1).

    Raises:
        InputError: No seeds, no estimators, or an unknown one.
        MissingExtraError: MuJoCo is not installed.
    """
    if not estimators:
        raise InputError("needs at least one estimator", where="--only")
    if not seeds:
        raise InputError("needs at least one seed", where="--seeds")
    unknown = set(estimators) - set(ESTIMATORS)
    if unknown:
        raise InputError(
            "unknown estimator",
            where="--only",
            value=", ".join(sorted(unknown)),
            limit=", ".join(ESTIMATORS),
        )
    tasks = [(seed, tuple(dict.fromkeys(estimators))) for seed in seeds]
    found = dict(each(_seed, tasks, beside or Workers(), tell=progress, words="seeds"))
    return tuple(trial for number in sorted(found) for trial in found[number])


def _seed(task: tuple[int, tuple[str, ...]]) -> list[Trial]:
    """The trials of one seed, in any process."""
    seed, estimators = task
    trials: list[Trial] = []
    with one_thread():
        arm = known_arm(seed)
        for scenario, noise, cutoff in SCENARIOS:
            problem = arm.problem(noise, cutoff, seed)
            trials += [_trial(arm, problem, word, scenario, seed) for word in estimators]
    return trials


def summary(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Mean over the seeds for each estimator and scenario, failures counted."""
    rows: list[dict[str, Any]] = []
    for word, scenario in dict.fromkeys((t.estimator, t.scenario) for t in trials):
        same = [t for t in trials if (t.estimator, t.scenario) == (word, scenario)]
        good = [t for t in same if not t.failure]
        row: dict[str, Any] = {"estimator": word, "scenario": scenario}
        for name in ("d_beta", "d_tau_percent", "d_q_percent", "seconds"):
            values = [float(getattr(t, name)) for t in good]
            row[name] = float(np.mean(values)) if values else float("nan")
        rows.append({**row, "seeds": len(same), "failures": len(same) - len(good)})
    return rows


def to_json(trials: Sequence[Trial]) -> dict[str, Any]:
    """The table and all trials."""
    return {"table": summary(trials), "trials": [asdict(t) for t in trials]}


def _trial(
    arm: KnownArm, problem: IdentificationProblem, word: str, scenario: str, seed: int
) -> Trial:
    trial = partial(Trial, estimator=word, scenario=scenario, seed=seed)
    started = time.process_time()
    try:
        fit = estimator_of(word).fit(problem)
    except DynidError as error:
        return trial(seconds=time.process_time() - started, failure=str(error))
    seconds = time.process_time() - started
    truth = problem.base.from_standard(arm.parameters)
    parameters = problem.base.to_standard(fit.values)
    other = arm.validation.truth
    # Against the true model at the same states: recorded torques are held between cycles.
    exact, predicted = (
        arm.model.inverse_dynamics(other.q, other.dq, other.ddq, p)
        for p in (arm.parameters, parameters)
    )
    return trial(
        d_beta=parameter_distance(fit.values, truth),
        d_tau_percent=relative_error(predicted, exact),
        d_q_percent=tracking_error(arm, parameters),
        seconds=seconds,
    )


def parameter_distance(values: Array, truth: Array) -> float:
    """BIRDy's distance of parameters, 0 (equal) to 2 (opposite)."""
    size = np.maximum(np.abs(values) + np.abs(truth), 1e-300)
    return float(2.0 * np.sum(np.abs(values - truth) / size) / len(truth))


def relative_error(values: Array, truth: Array) -> float:
    """100 times the mean over time of ||values - truth|| / ||truth||, both (N, n) [%]."""
    error: Array = np.sqrt(np.square(values - truth).sum(axis=1))
    size: Array = np.sqrt(np.square(truth).sum(axis=1))
    return float(100.0 * np.mean(error / np.maximum(size, 1e-12)))


def tracking_error(arm: KnownArm, parameters: Array) -> float:
    """Position error [%] of the true arm under computed torque with estimated parameters (p).

    Infinite where the arm runs away.
    """
    run = arm.validation
    aim = run.truth
    reference = Samples(
        t=run.t,
        q=aim.q,
        dq=aim.dq,
        ddq=aim.ddq,
        tau=aim.torque,
        rate_hz=run.rate_hz,
        cutoff_hz=run.rate_hz / 4,
    )
    loop = ClosedLoop(model=arm.model, parameters=arm.parameters, servo=parameters)
    try:
        return relative_error(loop.simulate(reference).q, aim.q)
    except JobError:
        return float("inf")
