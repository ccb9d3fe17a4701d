"""`dynid design`: from a robot to a certified excitation trajectory in a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.constraints.motion import MotionConstraints
from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.core.progress import Progress
from dynid.core.provenance import file_hash, provenance
from dynid.excitation.criteria import AOptimal, Criterion, all_criteria, parse_criterion
from dynid.excitation.criteria_prior import prior_scale
from dynid.excitation.design import ExcitationDesign
from dynid.excitation.evaluation import DesignEvaluation
from dynid.excitation.executor import workers
from dynid.excitation.gram import GramKernel
from dynid.excitation.multistart import Effort
from dynid.excitation.optimise import Optimised, by_genetic_algorithm, by_gradient
from dynid.excitation.problem import ExcitationProblem
from dynid.excitation.region import region_of
from dynid.excitation.rescue import check_room
from dynid.reduction.base import BaseParametrization, reduce_model
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.terms import parse_terms
from dynid.robot.load import load_robot
from dynid.robot.model import RobotModel
from dynid.robot.mount import with_mount
from dynid.signals.process import process
from dynid.trajectory.bounds import copied_bounds
from dynid.trajectory.families import motion_family
from dynid.workflow.design_files import write_design
from dynid.workflow.design_limits import DesignLimits, given_limits
from dynid.workflow.design_settings import (
    DEFAULT_BUDGET_S,
    DEFAULT_STARTS,
    PATIENCE,
    DesignSettings,
)
from dynid.workflow.recordings import open_record, robot_reference
from dynid.workflow.robot_units import unit_notes


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
