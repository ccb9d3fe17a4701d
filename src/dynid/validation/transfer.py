"""What differs on another day, or another robot of the type: the error by cause; friction refitted.

Each joint's error is explained by an offset, by friction, by a share of the model's gravity and by
a share of its inertial torques, together and joint by joint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynid.core import Array, InputError
from dynid.identification import Estimate, motion_state
from dynid.signals import Samples

CAUSES = ("offset", "gravity", "friction", "inertia")
CORRELATION_S = 0.2
"""Residuals this long are taken as one when a deviation is given."""
_SMOOTH = 0.02
"""Smoothing velocity of the Coulomb shape, share of the joint's usual top speed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TransferReport:
    """A prediction error split by cause."""

    rms: Array
    """(4, n) RMS of what each of `CAUSES` explains alone of the joint's error [N.m or N]."""
    share: Array
    """(2, n) of the model's gravity and of its inertial torque that is missing; NaN where a joint
    has none."""
    rest: Array
    """(n) RMS of what none explains [N.m or N]."""

    def to_json(self) -> dict[str, Any]:
        """A JSON object: one list a cause, one number a joint."""
        out: dict[str, Any] = {
            cause: [float(x) for x in row] for cause, row in zip(CAUSES, self.rms, strict=True)
        }
        gravity, inertia = (
            [float(x) if np.isfinite(x) else None for x in row] for row in self.share
        )
        return out | {
            "gravity_share": gravity,
            "inertia_share": inertia,
            "rest": [float(x) for x in self.rest],
        }


def transfer_report(estimate: Estimate, samples: Samples, error: Array) -> TransferReport:
    """Split a prediction error by cause.

    Args:
        estimate: The estimate that predicted.
        samples: The record.
        error: (N, n) measured minus predicted torques of its used rows [N.m or N].
    """
    model, n = estimate.model, samples.joints
    parameters = np.array(estimate.standard_parameters())
    parameters[10 * n :] = 0.0
    rest = np.zeros_like(samples.q)
    gravity = model.inverse_dynamics(samples.q, rest, rest, parameters)
    moving = model.inverse_dynamics(samples.q, samples.dq, samples.ddq, parameters) - gravity
    moving += samples.ddq * _motor_inertia(estimate)
    rows, fast = samples.rows, np.percentile(np.abs(samples.dq), 98, axis=0)
    rms, share, left = np.zeros((len(CAUSES), n)), np.full((2, n), np.nan), np.zeros(n)
    for j in range(n):
        dq = samples.dq[rows, j]
        columns = (
            np.ones_like(dq),
            gravity[rows, j],
            np.tanh(dq / max(_SMOOTH * fast[j], 1e-9)),
            dq,
            moving[rows, j],
        )
        values, parts = _fit(columns, error[:, j])
        causes = (parts[0], parts[1], parts[2] + parts[3], parts[4])
        rms[:, j] = [float(np.sqrt(np.square(part).mean())) for part in causes]
        share[:, j] = values[1], values[4]
        left[j] = float(np.sqrt(np.square(error[:, j] - sum(parts)).mean()))
    return TransferReport(rms=rms, share=share, rest=left)


def _fit(columns: tuple[Array, ...], error: Array) -> tuple[Array, list[Array]]:
    """Factors of columns, NaN for those that are zero, and what each explains."""
    stack = np.column_stack(columns)
    size = np.linalg.norm(stack, axis=0)
    seen = size > 1e-9 * max(float(size.max()), 1e-300)
    values = np.full(stack.shape[1], np.nan)
    values[seen] = np.linalg.lstsq(stack[:, seen] / size[seen], error, rcond=1e-6)[0] / size[seen]
    return values, [np.nan_to_num(v) * column for v, column in zip(values, columns, strict=True)]


def _motor_inertia(estimate: Estimate) -> Array:
    n, names = estimate.model.robot.joints, estimate.model.names
    values = estimate.standard_parameters()
    return np.array(
        [values[names.index(f"Im{j + 1}")] if f"Im{j + 1}" in names else 0.0 for j in range(n)]
    )


def refit_friction(estimate: Estimate, samples: Samples) -> Estimate:
    """The same inertias with the friction of another record.

    Args:
        estimate: The estimate; inertial parameters and motor inertia stay as they are.
        samples: The record that friction is taken from.

    Raises:
        InputError: The estimate has no friction.
    """
    model, n = estimate.model, samples.joints
    motor = {f"Im{j + 1}" for j in range(n)}
    chosen = [
        k
        for k, column in enumerate(estimate.independent)
        if column >= 10 * n and model.names[column] not in motor
    ]
    if not chosen:
        raise InputError("the estimate has no friction", where="--refit")
    state = motion_state(model, samples)
    stack = samples.as_recorded(model.stack(samples.q, samples.dq, samples.ddq, state=state))
    rows = samples.rows
    columns = stack[list(estimate.independent)][..., rows] / estimate.noise[:, None]
    known = samples.as_recorded(model.known_torque(samples.q).T)[:, rows]
    torque = (samples.tau[rows].T + known) / estimate.noise[:, None]
    fixed = [k for k in range(len(estimate.values)) if k not in chosen]
    left = torque - np.tensordot(estimate.values[fixed], columns[fixed], axes=1)
    design = columns[chosen].reshape(len(chosen), -1)
    square = design @ design.T
    inverse = np.linalg.pinv(square, hermitian=True)
    found = inverse @ (design @ left.ravel())
    rest = left.ravel() - found @ design
    # Residuals are correlated: fewer of them count.
    freedom = max(rest.size / (CORRELATION_S * samples.rate_hz) - len(chosen), 1.0)
    values, covariance = np.array(estimate.values), np.array(estimate.covariance)
    values[chosen] = found
    covariance[chosen, :] = covariance[:, chosen] = 0.0
    covariance[np.ix_(chosen, chosen)] = inverse * float(rest @ rest) / freedom
    standard = estimate.standard
    if standard is not None:
        places = [estimate.independent[k] for k in chosen]
        whole, std = np.array(standard.values), np.array(standard.std)
        whole[places], std[places] = found, np.sqrt(np.diag(covariance)[chosen])
        standard = replace(standard, values=whole, std=std)
    return replace(estimate, values=values, covariance=covariance, standard=standard)
