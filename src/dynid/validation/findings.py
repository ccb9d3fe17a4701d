"""What a record says of its own inputs: the likeliest cause first, and not what follows from it.

Two joints whose columns were exchanged: the other order fits the torques far better.

Inputs that do not fit a record, in words.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from dynid.core import Array, Finding
from dynid.identification import (
    ILL_CONDITIONED,
    Estimate,
    implausible_gravity,
    recorded_rows,
)
from dynid.recording import ExperimentRecord
from dynid.reduction import BaseParametrization, reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.signals import Samples
from dynid.validation.input_faults import Inputs, Suspicion, across, suspects
from dynid.validation.prediction import ValidationResult, samples_of
from dynid.validation.record_faults import (
    disturbed,
    drifting_friction,
    offset_notice,
    time_offset,
    trimmed_errors,
)

EXPLAINED = 0.7
"""Drop of the sum of log noises that an exchange has to bring."""
LEFT = 0.12
"""Share of the torque that the other order may leave: more, and something else is wrong."""
MOST_ROWS = 600
SWEEPS = 4


def exchanged_joints(estimate: Estimate, samples: Samples) -> tuple[int, int, bool] | None:
    """The two joints that look exchanged, and whether only their torques are.

    Args:
        estimate: The estimate.
        samples: The record it was identified from.

    Returns:
        None where no exchange explains the torques much better.
    """
    robot = estimate.model.robot
    kinds = robot.joint_types
    # The paper's terms: those that were chosen belong to the joints as they were told.
    base = reduce_model(InverseDynamicModel(robot=robot, frames=estimate.model.frames))
    own, _ = _log_noise(base, samples)
    best: tuple[float, int, int, bool] | None = None
    for i, j in combinations(range(samples.joints), 2):
        if kinds[i] != kinds[j]:
            continue
        order = list(range(samples.joints))
        order[i], order[j] = j, i
        for alone in (False, True):
            tau = samples.tau[:, order]
            other = (
                replace(samples, tau=tau)
                if alone
                else replace(
                    samples,
                    q=samples.q[:, order],
                    dq=samples.dq[:, order],
                    ddq=samples.ddq[:, order],
                    tau=tau,
                )
            )
            value, left = _log_noise(base, other)
            drop = own - value
            if left < LEFT and (best is None or drop > best[0]):
                best = (drop, i, j, alone)
    if best is None or best[0] < EXPLAINED:
        return None
    return best[1], best[2], best[3]


def _log_noise(base: BaseParametrization, samples: Samples) -> tuple[float, float]:
    """Sum over joints of the log of the noise that a weighted fit leaves, and its share."""
    used = samples.rows
    step = max(1, (used.stop - used.start) // MOST_ROWS)
    thin = replace(
        samples,
        t=samples.t[used][::step],
        q=samples.q[used][::step],
        dq=samples.dq[used][::step],
        ddq=samples.ddq[used][::step],
        tau=samples.tau[used][::step],
        torque_filter=None,
    )
    columns = list(base.independent)
    stack, torque = recorded_rows(base.model, thin, slice(0, thin.count), columns, None)
    scale = np.maximum(np.sqrt(np.square(stack).sum(axis=(1, 2))), 1e-12)
    stack = stack / scale[:, None, None]
    square = np.einsum("rjt,sjt->jrs", stack, stack, optimize=True)
    cross = np.einsum("rjt,jt->jr", stack, torque, optimize=True)
    energy = np.square(torque).sum(axis=1)
    noise: Array = np.maximum(energy, 1e-18)
    ridge = 1e-9 * np.eye(len(columns))
    for _ in range(SWEEPS):
        matrix = np.tensordot(1 / noise, square, axes=1)
        inverse = np.linalg.inv(matrix + ridge * float(np.trace(matrix)))
        values: Array = np.asarray(inverse, dtype=np.float64) @ ((1 / noise) @ cross)
        explained = np.einsum("r,jrs,s->j", values, square, values) - 2 * cross @ values
        noise = np.maximum(energy + explained, 1e-12 * energy + 1e-18)
    share = float(np.sqrt(noise.sum() / max(float(energy.sum()), 1e-18)))
    return float(np.log(noise / thin.count).sum()) / 2, share


def order_notice(i: int, j: int, alone: bool, names: tuple[str, ...]) -> Finding:
    """An exchange from `exchanged_joints` in words."""
    what = "torques of" if alone else "columns of"
    return Finding(
        "exchanged_torques" if alone else "exchanged",
        f"the {what} {names[i]} and {names[j]} look exchanged: in the other order they fit the "
        "model far better",
        joints=(i, j),
        next_step="check the order of the joints (--columns or --joint-order)",
    )


def suspicious_inputs(estimate: Estimate, samples: Samples) -> tuple[Finding, ...]:
    """`suspects` in words."""
    names, mount = estimate.model.robot.joint_names, estimate.model.robot.mount
    axes = estimate.model.robot.gravity
    return tuple(_words(found, names, mount, axes) for found in suspects(estimate, samples))


def _words(found: Suspicion, names: tuple[str, ...], mount: str, gravity: Array) -> Finding:
    if found.kind == "mounting":
        fits = " ".join(f"{x:.2f}" for x in gravity_of(found.inputs, gravity))
        return Finding(
            "mounting",
            f"gravity fits the torques better when it stands {found.value:.1f} +- {found.std:.1f} "
            f"deg off the mounting ({mount}), [{fits}] m/s^2 in the base frame",
            value=found.value,
            std=found.std,
            unit="deg",
            next_step="level the base, or write it into the robot file ([mount] gravity)",
        )
    name = "" if found.joint is None else names[found.joint]
    joints = () if found.joint is None else (found.joint,)
    if found.kind == "sign":
        return Finding(
            "reversed",
            f"the torques of {name} fit those of the other joints only when reversed",
            severity="warning",
            joints=joints,
            value=-1.0,
            next_step="check the signs of its torque or current and position",
        )
    others = ", ".join(f"{names[j]} {x:.3g} times" for j, x in found.others)
    return Finding(
        "drive_gain",
        f"the torques of {name} are {found.value:.3g} +- {found.std:.2g} times as large as those "
        "of the other joints let expect" + (f" (nearly as likely: {others})" if others else ""),
        joints=joints,
        value=found.value,
        std=found.std,
        unit="1",
        next_step="check its drive gain; its share of the parameters is scaled by it",
    )


def gravity_of(inputs: Inputs, gravity: Array) -> Array:
    """(3) gravity in the base frame [m/s^2] that inputs stand for, as strong as the robot's."""
    size = float(np.linalg.norm(gravity))
    turned = gravity + size * inputs.tilt @ across(gravity)
    return np.asarray(turned * (size / np.linalg.norm(turned)), dtype=np.float64)


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
) -> tuple[Finding, ...]:
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
    told = told and not any(finding.kind == "reversed" for finding in inputs)
    contacts = disturbed(training, names, trimmed_errors(estimate, full)) if told else ()
    return (
        *inputs,
        *doubts,
        *contacts,
        *drifting_friction(estimate, training, names),
    )
