"""What a record says of its own inputs: the likeliest cause first, and not what follows from it."""

from __future__ import annotations

from dynid.core.notices import Notice
from dynid.identification.conditioning import ILL_CONDITIONED
from dynid.identification.estimate import Estimate
from dynid.identification.plausibility import implausible_gravity
from dynid.recording.record import ExperimentRecord
from dynid.signals.samples import Samples
from dynid.validation.alignment import offset_notice, time_offset
from dynid.validation.disturbance import disturbed
from dynid.validation.drift import drifting_friction
from dynid.validation.joint_order import exchanged_joints, order_notice
from dynid.validation.prediction import ValidationResult, samples_of
from dynid.validation.trimmed import trimmed_errors
from dynid.validation.wrong_inputs import REVERSED, suspicious_inputs

POOR_FIT = 10.0
"""[%] of the torque of moving joints; less is left where inputs are right."""


def wrong_inputs(
    estimate: Estimate,
    samples: Samples,
    record: ExperimentRecord,
    training: ValidationResult,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
) -> tuple[Notice, ...]:
    """Look for inputs that do not fit, a contact, friction that drifts.

    An offset in time or exchanged joints make gains, signs, gravity and contacts look wrong as
    well: nothing more is said then. Torques that were clipped fit no gain and no sign. A gain
    that was found explains its joint's gravity.

    Args:
        estimate: The estimate.
        samples: The samples that it was fitted to.
        record: The first record.
        training: That record, reproduced.
        start_s: Start of the window that was identified from [s].
        stop_s: Its end [s].
    """
    names = estimate.model.robot.joint_names
    told = estimate.motion_condition_number <= ILL_CONDITIONED
    full = samples_of(estimate, record, start_s=start_s, stop_s=stop_s)
    offset = time_offset(estimate, full) if told else None
    if offset is not None:
        return (offset_notice(offset),)
    clipped = any(problem.code == "saturated" for problem in record.problems)
    inputs = () if clipped else suspicious_inputs(estimate, samples)
    gravity = implausible_gravity(estimate)
    poor = training.moving.relative_error_overall_percent > POOR_FIT
    if told and not clipped and (inputs or gravity or poor):
        exchanged = exchanged_joints(estimate, full)
        if exchanged is not None:
            return (order_notice(*exchanged, names),)
    # Masses are known less well than joints agree.
    doubts = () if inputs or clipped else gravity
    # A motion that tells little apart cannot tell its own stretches apart either.
    told = told and not any(REVERSED in notice.message for notice in inputs)
    contacts = disturbed(training, names, trimmed_errors(estimate, full)) if told else ()
    return (
        *inputs,
        *doubts,
        *contacts,
        *drifting_friction(estimate, training, names),
    )
