"""`dynid design`: from a robot to a certified excitation trajectory in a file.

What `dynid design` can be told.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.constraints import PRESETS, MotionConstraints
from dynid.core import Array, InputError, Progress, file_hash, provenance
from dynid.excitation import (
    CRITERIA,
    METHODS,
    AOptimal,
    Criterion,
    DesignEvaluation,
    Effort,
    ExcitationDesign,
    ExcitationProblem,
    GramKernel,
    Optimised,
    all_criteria,
    by_genetic_algorithm,
    by_gradient,
    check_room,
    parse_criterion,
    prior_scale,
    region_of,
    workers,
)
from dynid.reduction import BaseParametrization, reduce_model
from dynid.regressor import InverseDynamicModel, parse_terms
from dynid.robot import RobotModel, load_robot, with_mount
from dynid.signals import process
from dynid.trajectory import FAMILY_NAMES, copied_bounds, motion_family
from dynid.workflow.analyze import unit_notes
from dynid.workflow.design_files import DesignLimits, given_limits, write_design
from dynid.workflow.recordings import open_record, robot_reference

DEFAULT_CRITERION = "cond"
DEFAULT_STARTS = 12
"""Of the gradient method, where neither starts nor a budget are given."""
DEFAULT_BUDGET_S = 120.0
"""[s] Time after which the default number of starts is cut short: ten times what they take on two
idle cores, so that a seed gives the same answer again."""
POPULATION, GENERATIONS = 300, 5
"""The paper's."""
MOST_HARMONICS = 100
PATIENCE = 60
"""Starts without a better motion that end a search with a budget."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignSettings:
    """How to design.

    Raises:
        InputError: A word that is not known, or a number that makes no sense.
    """

    method: str = "gradient"
    """`gradient`, or `ga` for the paper's genetic algorithm."""
    criterion: str = DEFAULT_CRITERION
    """One of `CRITERIA`."""
    trajectory: str = "fourier"
    """One of `FAMILY_NAMES`."""
    harmonics: int = 5
    """Of the series; a B-spline gets as many free numbers."""
    period_s: float = 10.0
    """Time of one period [s]."""
    rate_hz: float = 125.0
    """Samples a second at which criteria are computed."""
    population: int = POPULATION
    """Of the genetic algorithm."""
    generations: int = GENERATIONS
    """Of the genetic algorithm, after the random one."""
    starts: int | None = None
    """Of the gradient method; None for the default, or for as many as fit into the budget."""
    budget_s: float | None = None
    """Time [s]; None for none beside the default's."""
    seed: int = 0
    """Of all random numbers."""
    limits: str = "safe"
    """`safe`: all that is known of the robot; `paper`: position, velocity, acceleration."""
    scene: str | None = None
    """Scene file: what stands around the robot and what it carries."""
    collision: bool = True
    """Whether collisions are looked at, with `safe`."""
    frames: str = ""
    """`dh`, `mdh` or `urdf`; empty for the robot's own."""
    mount: str | None = None
    """Mounting; None for the robot's own."""
    terms: str = "fc,fv,im"
    """Friction terms beside the inertial parameters."""
    start_pose: tuple[float, ...] | None = None
    """Where the motion starts and ends, for families that can [rad or m]."""
    noise: tuple[float, ...] | None = None
    """Standard deviation of each joint's torque, by which its rows are divided [N.m or N]."""
    previous: tuple[str, ...] = ()
    """Recordings whose information the new motion shall complete."""
    jobs: int = 1
    """Processes, the calling one included."""
    dask: str | None = None
    """Address of a Dask scheduler whose workers take part."""

    def __post_init__(self) -> None:
        for name, value, words in (
            ("--method", self.method, METHODS),
            ("--criterion", self.criterion, tuple(CRITERIA)),
            ("--trajectory", self.trajectory, FAMILY_NAMES),
            ("--limits", self.limits, PRESETS),
        ):
            if value not in words:
                raise InputError("unknown word", where=name, value=value, limit=", ".join(words))
        least = 1 if self.trajectory in ("bspline", "poses") else 2
        if not least <= self.harmonics <= MOST_HARMONICS:
            raise InputError(
                "too few harmonics to move" if self.harmonics < least else "too many harmonics",
                where="--harmonics",
                value=self.harmonics,
                limit=f"{least} to {MOST_HARMONICS}",
            )
        if not 0.1 <= self.period_s <= 3600:
            raise InputError(
                "must be a time", where="--period", value=self.period_s, limit="0.1 to 3600 s"
            )
        if self.seed < 0:
            raise InputError("must not be negative", where="--seed", value=self.seed)
        for name, numbers in (("--start", self.start_pose), ("--noise", self.noise)):
            if numbers is not None and not all(math.isfinite(number) for number in numbers):
                raise InputError("needs finite numbers", where=name, value=list(numbers))
        if self.noise is not None and not all(number > 0 for number in self.noise):
            raise InputError("must be positive", where="--noise", value=list(self.noise))
        if self.scene is not None and (self.limits == "paper" or not self.collision):
            raise InputError(
                "a scene is looked at only with --limits safe and collisions on",
                where="--scene",
                value=self.scene,
            )

    @property
    def unused(self) -> tuple[str, ...]:
        """Options that were given and that the method has no use for."""
        genetic = self.method == "ga"
        given = {
            "--population": not genetic and self.population != POPULATION,
            "--generations": not genetic and self.generations != GENERATIONS,
            "--starts": genetic and self.starts is not None,
            "--dask": genetic and self.dask is not None,
        }
        return tuple(name for name, wrongly in given.items() if wrongly)

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        data: dict[str, Any] = asdict(self)
        for name in ("start_pose", "noise", "previous"):
            if data[name] is not None:
                data[name] = list(data[name])
        return data

    @property
    def scene_path(self) -> Path | None:
        """The scene file."""
        return None if self.scene is None else Path(self.scene)


def design(
    robot: RobotModel | str | Path,
    settings: DesignSettings | None = None,
    *,
    output: str | Path | None = None,
    progress: Progress | None = None,
) -> ExcitationDesign:
    """Design an excitation trajectory.

    Ctrl-C ends the search; what was found until then is certified and returned, with
    `interrupted` set.

    Args:
        robot: The robot, or its name or file.
        settings: What to do.
        output: The design's JSON file; it appears whole or not at all. An infeasible design is
            written as well: it says so.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: Settings, limits or a scene that make no sense; a budget that is too short.
        JobError: No motion within the limits excites every parameter.
    """
    asked = settings or DesignSettings()
    model = robot if isinstance(robot, RobotModel) else load_robot(robot, mount=asked.mount)
    if isinstance(robot, RobotModel) and asked.mount is not None:
        model = with_mount(model, asked.mount)
    limits = given_limits(asked.limits, asked.collision, asked.scene_path)
    judge = limits.constraints(model)
    problem = _problem(model, judge, asked)
    optimised = _optimised(problem, asked, progress)
    reference = model.name if isinstance(robot, RobotModel) else robot_reference(robot)
    result = _design(reference, problem, optimised, asked, limits)
    if output is not None:
        write_design(result, output)
    return result


def _problem(
    robot: RobotModel, judge: MotionConstraints, asked: DesignSettings
) -> ExcitationProblem:
    model = InverseDynamicModel(robot=robot, frames=asked.frames, friction=parse_terms(asked.terms))
    base = reduce_model(model)
    noise = None if asked.noise is None else np.array(asked.noise)
    if noise is not None and len(noise) != robot.joints:
        raise InputError(
            "needs a number a joint", where="--noise", value=len(noise), limit=robot.joints
        )
    if asked.start_pose is not None:
        judge.check_pose(_pose(asked.start_pose, robot.joints))
    problem = ExcitationProblem(
        base=base,
        criterion=_criterion(asked, base, noise),
        family=motion_family(asked.trajectory, asked.period_s, asked.harmonics),
        constraints=judge.settings,
        rate_hz=asked.rate_hz,
        noise=noise,
        start_pose=None if asked.start_pose is None else np.array(asked.start_pose),
    )
    check_room(judge, region_of(problem))
    return problem


def _criterion(asked: DesignSettings, base: BaseParametrization, noise: Array | None) -> Criterion:
    # Variances can be added only where the parameters have a common scale.
    scaled = asked.criterion == AOptimal.name
    return parse_criterion(
        asked.criterion,
        scale=prior_scale(base.model.robot, base) if scaled else None,
        previous=_information(asked, base, noise) if asked.previous else None,
    )


def _information(asked: DesignSettings, base: BaseParametrization, noise: Array | None) -> Array:
    """The Gram matrix (b, b) of the recordings that were made before."""
    total = np.zeros((base.rank, base.rank))
    kernel = GramKernel(base.model, base, noise=noise, coulomb_width=None)
    robot = base.model.robot
    for path in asked.previous:
        samples = process(open_record(path, robot), robot)
        # Per second of motion, at the rate of the design: neither side counts by its sampling.
        weight = asked.rate_hz / samples.rate_hz
        total += weight * kernel.gram(samples.q, samples.dq, samples.ddq)
    return total


def _optimised(
    problem: ExcitationProblem, asked: DesignSettings, progress: Progress | None
) -> Optimised:
    if asked.method == "ga":
        return by_genetic_algorithm(
            problem,
            seed=asked.seed,
            population=asked.population,
            generations=asked.generations,
            budget_s=asked.budget_s,
            tell=progress,
        )
    if asked.starts is None and asked.budget_s is None:
        effort = Effort(starts=DEFAULT_STARTS, budget_s=DEFAULT_BUDGET_S)
    else:
        patience = PATIENCE if asked.starts is None else None
        effort = Effort(starts=asked.starts, budget_s=asked.budget_s, patience=patience)
    with workers(asked.jobs, asked.dask) as found:
        return by_gradient(
            problem,
            effort,
            seed=asked.seed,
            executor=found.executor,
            workers=found.slots,
            tell=progress,
        )


def _design(
    reference: str,
    problem: ExcitationProblem,
    optimised: Optimised,
    asked: DesignSettings,
    limits: DesignLimits,
) -> ExcitationDesign:
    base, finished, search = problem.base, optimised.finished, optimised.search
    robot, certificate = base.model.robot, finished.certificate
    # The figures are those of the motion alone and of rows as they are, whatever was optimised.
    judge = DesignEvaluation(problem) if problem.noise is None else None
    kernel = GramKernel(base.model, base, coulomb_width=None)
    motion = finished.trajectory.evaluate(problem.times)
    gram = judge.gram(finished.x) if judge else kernel.gram(motion.q, motion.dq, motion.ddq)
    inputs = {path: file_hash(Path(path)) for path in (*asked.previous, asked.scene or "") if path}
    return ExcitationDesign(
        trajectory=finished.trajectory,
        robot=reference,
        robot_name=robot.name,
        mount=robot.mount,
        frames=base.model.frames,
        terms=base.model.friction.describe(),
        limits=copied_bounds(robot.limits),
        criterion=asked.criterion,
        method=asked.method,
        criteria=all_criteria(gram, scale=prior_scale(robot, base)),
        base_parameters=base.rank,
        samples=problem.samples,
        certificate=replace(certificate, notes=(*unit_notes(robot), *certificate.notes)),
        repair=finished.repair,
        evaluations=optimised.evaluations,
        starts=search.starts,
        wall_s=optimised.wall_s,
        seed=asked.seed,
        ended_by=search.ended_by,
        history=tuple(search.history),
        provenance=provenance(inputs, asked.to_json(), asked.seed),
        settings=limits.to_json(),
    )


def _pose(values: tuple[float, ...], joints: int) -> Array:
    if len(values) != joints:
        raise InputError(
            "a start pose needs a number a joint",
            where="--start",
            value=len(values),
            limit=joints,
        )
    return np.array(values)
