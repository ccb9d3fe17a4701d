"""One interface to both optimisers: a problem in, a certified motion out, with what it is worth."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from dynid import constraints, core
from dynid.excitation.evaluation import (
    Candidate,
    DesignEvaluation,
    ExcitationProblem,
    HistoryEntry,
    Search,
    SearchProgress,
    Stop,
)
from dynid.excitation.gradient import STAGES, TIGHTEN, improve
from dynid.excitation.purpose import Expected
from dynid.excitation.region import MotionRegion, region_of
from dynid.excitation.searches import DesignOptimiser, Effort, MotionSearch, multistart
from dynid.trajectory import Trajectory

TIGHTER = (0.05, 0.1)
"""Shares by which limits shrink when the search's own did not pass the certificate."""
HALVINGS = 7
"""Of the interval in which the largest passing amplitude is sought."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """A motion and the verdict on it."""

    x: core.Array
    trajectory: Trajectory
    certificate: constraints.Certificate
    repair: str
    """What had to be done: empty, `tightened` or `smaller`."""


def finish(
    search: Search, evaluation: DesignEvaluation, region: MotionRegion, *, stop: Stop
) -> Finished:
    """The best motion that passes the certificate.

    Candidates are taken best first. If none passes, the best one is improved again under tighter
    limits, unless there is no more time (`stop`), then made smaller until it passes. If nothing
    helps, the best one comes back with its certificate, which says what is broken.
    """
    tried = partial(_certified, evaluation)
    seen: list[Finished] = []
    for candidate, _ in search.candidates:
        seen.append(tried(candidate.x, ""))
        if seen[-1].certificate.holds:
            return seen[-1]
    # It holds at the samples of the search: any motion under tighter limits takes its place.
    first = replace(search.candidates[0][0], violation=math.inf)
    again = partial(improve, evaluation, region, first, stop=stop, stages=STAGES[2:])
    for share in TIGHTER:
        if stop():
            break
        found = tried(again(found=lambda _: None, tighten=share).x, "tightened")
        if found.certificate.holds:
            return found
    return _smaller(evaluation, first.x) or seen[0]


def without_turns(evaluation: DesignEvaluation, x: core.Array) -> core.Array:
    """The same poses, each revolute joint as near to the middle of its range as turns bring it.

    A turn changes neither torques nor distances, but the robot would have to make it on its way to
    the start. A start pose that was asked for is kept. Numbers (n, 1 + k) whose motion kept the
    position bounds still do.
    """
    problem = evaluation.problem
    if problem.start_pose is not None:
        return x
    q = problem.family.trajectory(x[:, 0], x[:, 1:]).evaluate(problem.times).q
    bounds = problem.constraints.settings.bounds
    # Of the range, not of the mean: a range that is nearer to the middle cannot leave the bounds.
    away = (q.min(axis=0) + q.max(axis=0) - bounds.lower - bounds.upper) / 2
    turns: core.Array = np.rint(away / (2 * np.pi))
    turns[np.array(evaluation.constraints.robot.prismatic, dtype=bool)] = 0.0
    moved = np.array(x)
    moved[:, 0] -= 2 * np.pi * turns
    return moved


def _certified(evaluation: DesignEvaluation, x: core.Array, repair: str) -> Finished:
    x = without_turns(evaluation, x)
    trajectory = evaluation.problem.family.trajectory(x[:, 0], x[:, 1:])
    certificate = constraints.certify(trajectory, evaluation.constraints)
    return Finished(x=x, trajectory=trajectory, certificate=certificate, repair=repair)


def _smaller(evaluation: DesignEvaluation, x: core.Array) -> Finished | None:
    """The motion about its own mean pose, as large as passes; None if even its pose does not."""
    best: Finished | None = None
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        share = (low + high) / 2
        size = np.ones(x.shape)
        size[:, 1:] = share
        found = _certified(evaluation, x * size, "smaller")
        if found.certificate.holds:
            best, low = found, share
        else:
            high = share
    return best


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationDesign(core.Value):
    """An excitation trajectory with everything that is known about it."""

    trajectory: Trajectory
    """One period."""
    robot: str
    """Name or path of the robot, by which it can be loaded again."""
    robot_name: str
    """What the robot calls itself."""
    mount: str
    """The mounting it was designed for."""
    frames: str
    """Frames of the parameters behind the criteria."""
    terms: str
    """Friction terms beside the inertial parameters."""
    limits: core.MotionBounds
    """Bounds of position, velocity and acceleration."""
    purpose: str
    """What the model is for: `prediction`, `parameters` or `cond`."""
    purpose_motions: str
    """The motions on which torque errors are expected, in words."""
    criterion: str
    """What was minimised."""
    method: str
    """`ga` or `gradient`."""
    criteria: Mapping[str, float]
    """Every criterion by name, of all samples of one period, Coulomb steps as they are."""
    expected: Expected
    """What an identification from all repetitions is expected to know."""
    repetitions: int
    """How often the period is to be run: more than 1 only where an accuracy asks for it."""
    findings: tuple[core.Finding, ...]
    """`weak_excitation`, where the motion excites too little."""
    scaled_condition_number: float
    """Of one period, with the columns scaled to unit norm."""
    base_parameters: int
    """How many the motion shows."""
    samples: int
    """At which the criteria were computed."""
    certificate: constraints.Certificate
    """Remaining margin of each limit."""
    repair: str
    """What the certificate made necessary: empty, `tightened` or `smaller`."""
    evaluations: int
    """Motions evaluated."""
    starts: int
    """Starts of the gradient method that ended, or generations."""
    wall_s: float
    """Time of the design [s]."""
    seed: int
    """Of all random numbers."""
    ended_by: str
    """`starts`, `generations`, `stagnation`, `budget` or `interrupt`."""
    history: tuple[HistoryEntry, ...]
    """How the best motion got better."""
    provenance: core.Provenance
    """Inputs, settings, seed and versions."""
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """How the limits were chosen, for `dynid check`."""

    @property
    def condition_number(self) -> float:
        """The paper's: first-come columns, unscaled, of one period."""
        return self.criteria["cond"]

    @property
    def log_det(self) -> float:
        """Logarithm of the determinant of the Gram matrix."""
        return -self.criteria["d-opt"]

    @property
    def feasible(self) -> bool:
        """Whether it is certified."""
        return self.certificate.feasible

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the search."""
        return self.ended_by == "interrupt"

    def to_json(self) -> dict[str, Any]:
        """The keys that `dynid design --json` prints, and more."""
        known = {
            "robot": self.robot_name,
            "mount": self.mount,
            "frames": self.frames,
            "terms": self.terms,
            "trajectory": type(self.trajectory).__name__,
            "duration_s": self.trajectory.duration,
            "base_parameters": self.base_parameters,
            "samples": self.samples,
            "condition_number": self.condition_number,
            "scaled_condition_number": self.scaled_condition_number,
            "log_det": self.log_det,
            "for": self.purpose,
            "purpose_motions": self.purpose_motions,
            "predicted_torque_error_percent": self.expected.torque_error_percent,
            "predicted_torque_error_bound_percent": self.expected.bound_percent,
            "predicted_torque_error": self.expected.torque_error,
            "largest_parameter_std": self.expected.largest_parameter_std,
            "noise": self.expected.noise,
            "repetitions": self.repetitions,
            "findings": [item.to_json() for item in self.findings],
            "criterion": self.criterion,
            "criteria": self.criteria,
            "method": self.method,
            **self.certificate.to_json(),
            "repair": self.repair or None,
            "evaluations": self.evaluations,
            "starts": self.starts,
            "wall_s": self.wall_s,
            "seed": self.seed,
            "ended_by": self.ended_by,
            "interrupted": self.interrupted,
            "history": [{**asdict(one), "wall_s": round(one.wall_s, 4)} for one in self.history],
            "limits": self.settings,
        }
        return core.plain(known)


LEAST_MOTIONS = 40
"""A budget must let at least so many motions be looked at."""


@core.one_thread()
def by_gradient(
    problem: ExcitationProblem,
    effort: Effort,
    *,
    seed: int,
    beside: core.Workers | None = None,
    tell: SearchProgress | None = None,
) -> tuple[Finished, Search]:
    """Design by gradients from many starts; see `multistart`."""
    search = multistart(problem, effort, seed=seed, beside=beside, tell=tell)
    return _finished(problem, search, effort.budget_s)


@core.one_thread()
def by_optimiser(
    problem: ExcitationProblem,
    optimiser: DesignOptimiser,
    *,
    seed: int,
    budget_s: float | None = None,
    tell: SearchProgress | None = None,
) -> tuple[Finished, Search]:
    """Design by the paper's genetic algorithm, or by an optimiser of one's own.

    Raises:
        InputError: A budget that is too short.
        JobError: No motion was judged.
    """
    evaluation, region = DesignEvaluation(problem), region_of(problem)
    evaluation.warm_up()
    search, total = Search(problem=problem), optimiser.evaluations

    def stop() -> bool:
        return budget_s is not None and search.wall_s >= budget_s

    def judge(x: core.Array) -> Candidate:
        x = core.frozen(x, shape=(len(region.middle), 1 + problem.family.free_count), name="x")
        broken = evaluation.search_violation(x, TIGHTEN)
        candidate = Candidate(x=x, objective=evaluation.value(x), violation=broken)
        search.evaluations = evaluation.evaluations
        search.add(candidate, evaluation.evaluations)
        if tell is not None:
            timed = 0.0 if budget_s is None else search.wall_s / budget_s
            tell(search, min(evaluation.evaluations / total if total else timed, 1.0))
        return candidate

    try:
        search.starts = optimiser.minimize(
            MotionSearch(
                problem=problem,
                region=region,
                judge=judge,
                constrained=evaluation.constrained,
                seed=seed,
                stop=stop,
            )
        )
        search.ended_by = "budget" if stop() else optimiser.ends
        if search.best is None and search.ended_by != "budget":
            step = "Call search.judge in minimize."
            raise core.JobError(f"the optimiser {optimiser.name} judged no motion", next_step=step)
    except KeyboardInterrupt:
        search.ended_by = "interrupt"
    return _finished(problem, search, budget_s)


def _finished(
    problem: ExcitationProblem, search: Search, budget_s: float | None
) -> tuple[Finished, Search]:
    best = search.best
    if best is None and search.ended_by == "interrupt":
        raise KeyboardInterrupt
    hasty = search.ended_by == "budget" and search.evaluations < LEAST_MOTIONS
    if best is None or hasty:
        raise core.InputError(
            "the time budget is too short to evaluate a few motions",
            where="--budget",
            value=budget_s,
            limit="a second or more",
        )
    if not math.isfinite(best.objective):
        raise core.JobError(
            "no motion excites every base parameter",
            next_step="Take a longer period, more harmonics or wider limits.",
        )
    evaluation = DesignEvaluation(problem)
    region = region_of(problem)
    over = search.ended_by in ("interrupt", "budget")
    finished = finish(search, evaluation, region, stop=lambda: over)
    search.evaluations += evaluation.evaluations
    return finished, search
