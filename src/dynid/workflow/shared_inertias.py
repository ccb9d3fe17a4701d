"""Several recordings of one robot at once: shared inertias, friction of each record's own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

from dynid.core import InputError, Progress, provenance, told
from dynid.identification import (
    PRIOR_GAIN,
    Estimate,
    IdentificationProblem,
    SharedFit,
    SharedProblem,
    WeightedLeastSquares,
    fit_shared,
    shared_estimates,
    with_load,
)
from dynid.recording import ExperimentRecord, identity
from dynid.reduction import reduce_model
from dynid.regressor import FrictionTerms, InverseDynamicModel
from dynid.robot import RobotModel, load_robot
from dynid.signals import ProcessingSettings, process
from dynid.workflow.choosing import LONG_RECORD, IdentifySettings, choose


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedIdentification:
    """Estimates of several records with the same inertias in all of them."""

    estimates: tuple[Estimate, ...]
    """One a record: the shared inertias and the record's own friction. Each validates, compares
    and exports as any other."""
    problem: SharedProblem
    """The recordings as one problem."""
    fit: SharedFit
    """Its least squares solution."""

    @property
    def shared(self) -> tuple[str, ...]:
        """Names of the base parameters that the records share."""
        base = self.problem.problems[0].base
        return tuple(base.names[k] for k in self.problem.common)

    @property
    def own(self) -> tuple[str, ...]:
        """Names of the base parameters that each record has of its own."""
        base = self.problem.problems[0].base
        return tuple(base.names[k] for k in self.problem.own)

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "robot": self.estimates[0].model.robot.name,
            "shared": list(self.shared),
            "own": list(self.own),
            "records": [
                {
                    "samples": estimate.samples,
                    "noise": estimate.noise.tolist(),
                    "parameters": estimate.parameter_table(),
                    "warnings": told(estimate.warnings),
                    "findings": [finding.to_json() for finding in estimate.warnings],
                }
                for estimate in self.estimates
            ],
        }


def identify_shared(
    records: Sequence[ExperimentRecord],
    robot: RobotModel | str | Path,
    settings: IdentifySettings | None = None,
    *,
    progress: Progress | None = None,
) -> SharedIdentification:
    """Identify several recordings at once, the inertias shared and the friction not.

    Each joint of each record has a noise of its own.

    Args:
        records: Recordings of the robot: cold, warm, of other days.
        robot: The robot, or its name or file.
        settings: What to do, weighted least squares only; the window applies to each record.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: No recordings, some that do not fit the robot, or another estimator.
        JobError: A singular problem.
    """
    settings = settings or IdentifySettings()
    if not records:
        raise InputError("needs at least one record")
    if settings.estimator not in (None, "wls") or settings.weighting != "joint":
        raise InputError(
            "several records at once are fitted by weighted least squares, joint by joint",
            value=(settings.estimator, settings.weighting),
            limit="wls, joint",
        )
    model = robot if isinstance(robot, RobotModel) else load_robot(robot)
    with threadpool_limits(limits=1, user_api="blas"):
        return _identify(list(records), model, settings, progress)


def _identify(
    records: list[ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings,
    progress: Progress | None,
) -> SharedIdentification:
    processing = ProcessingSettings(
        cutoff_hz=settings.cutoff_hz,
        start_s=settings.start_s,
        stop_s=settings.stop_s,
        decimate=settings.preset == "best" or max(r.samples for r in records) > LONG_RECORD,
    )
    friction, words = settings.terms or FrictionTerms(), ()
    if settings.preset == "best":
        choice = choose(records, robot, settings, processing, progress)
        # Periods are averaged record by record or not at all: here every sample counts.
        processing = replace(choice.processing, period_s=None)
        friction, words = choice.friction, choice.words
    plain = InverseDynamicModel(robot=robot, frames=settings.frames, friction=friction)
    problems: list[IdentificationProblem] = []
    for record in records:
        samples = process(record, robot, processing)
        found = with_load(plain, samples, WeightedLeastSquares(prior_gain=PRIOR_GAIN))
        problems.append(IdentificationProblem(base=reduce_model(found), samples=samples))
    problem = SharedProblem(problems=tuple(problems))
    fit = fit_shared(problem)
    origins = {r.metadata.origin or f"record {k + 1}": identity(r) for k, r in enumerate(records)}
    estimates = shared_estimates(
        problem,
        fit,
        records=records,
        settings=processing,
        preset=settings.preset,
        choices=words,
        made=provenance(inputs=origins, settings=settings.to_json()),
    )
    return SharedIdentification(estimates=estimates, problem=problem, fit=fit)
