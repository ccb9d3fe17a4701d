"""`dynid payload`: what a robot carries, from runs with and without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

from dynid.core.errors import InputError
from dynid.identification.least_squares import PRIOR_GAIN
from dynid.identification.loading import with_load
from dynid.identification.payload import Payload, payload_of
from dynid.identification.problem import IdentificationProblem
from dynid.identification.shared import SharedProblem
from dynid.identification.shared_fit import fit_shared
from dynid.recording.identity import identity
from dynid.recording.record import ExperimentRecord
from dynid.reduction.base import reduce_model
from dynid.regressor.load import LoadFriction
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.terms import FrictionTerms
from dynid.robot.load import load_robot
from dynid.robot.model import RobotModel
from dynid.signals.process import process
from dynid.signals.samples import ProcessingSettings

WIDTH = 0.01
"""Width of the Coulomb step, unless other friction is asked for [rad/s or m/s]."""


def identify_payload(
    unloaded: ExperimentRecord | Sequence[ExperimentRecord],
    loaded: ExperimentRecord | Sequence[ExperimentRecord],
    robot: RobotModel | str | Path,
    *,
    friction: FrictionTerms | None = None,
    cutoff_hz: float | None = None,
) -> Payload:
    """The payload that the loaded runs carry and the unloaded ones do not.

    Best with one motion for both: what the model gets wrong then cancels. Friction is each
    record's own, as gears warm up between runs.

    Args:
        unloaded: Recordings without the payload.
        loaded: Recordings with it.
        robot: The robot, or its name or file, as it is without the payload.
        friction: Friction terms; the default is Coulomb, viscous, motor inertia, and friction
            that grows with the load.
        cutoff_hz: Low-pass cut-off of the motion [Hz]; None: from the first record's spectrum.

    Raises:
        InputError: No records, one record as both, or records that do not fit the robot.
        JobError: Motions that do not show all ten parameters.
    """
    without, carrying = _several(unloaded), _several(loaded)
    if not without or not carrying:
        raise InputError(
            "needs recordings with and without the payload", value=(len(without), len(carrying))
        )
    seen = {identity(record) for record in without}
    if any(identity(record) in seen for record in carrying):
        raise InputError(
            "a recording with the payload is one without it",
            next_step="Record the same motion again with the payload.",
        )
    model = robot if isinstance(robot, RobotModel) else load_robot(robot)
    if friction is None:
        joints = tuple(range(model.joints))
        nothing = LoadFriction(joints=joints, parameters=(0.0,) * 10 * model.joints)
        friction = FrictionTerms(width=WIDTH, load=nothing)
    with threadpool_limits(limits=1, user_api="blas"):
        problem = _problem(without, carrying, model, friction, cutoff_hz)
        return payload_of(problem, fit_shared(problem, one_noise=True))


def _problem(
    without: list[ExperimentRecord],
    carrying: list[ExperimentRecord],
    robot: RobotModel,
    friction: FrictionTerms,
    cutoff_hz: float | None,
) -> SharedProblem:
    settings = ProcessingSettings(cutoff_hz=cutoff_hz, decimate=True)
    problems: list[IdentificationProblem] = []
    plain = InverseDynamicModel(robot=robot, friction=friction)
    for record in (*without, *carrying):
        samples = process(record, robot, settings)
        # One filter for all: what it takes from the motion then cancels too.
        settings = replace(settings, cutoff_hz=samples.cutoff_hz)
        model = with_load(plain, samples, PRIOR_GAIN)
        problems.append(IdentificationProblem(base=reduce_model(model), samples=samples))
    return SharedProblem(
        problems=tuple(problems),
        loaded=(False,) * len(without) + (True,) * len(carrying),
    )


def _several(records: ExperimentRecord | Sequence[ExperimentRecord]) -> list[ExperimentRecord]:
    return [records] if isinstance(records, ExperimentRecord) else list(records)
