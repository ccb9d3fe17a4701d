"""Coulomb and viscous friction in place of all that was identified, for files with no other.

Where other terms were identified too, the first two alone would be too small, or negative: what
grows with load or falls with speed is missing from them. Then the two that come nearest to all
friction over the recorded range stand in for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.export.completion import Completion
from dynid.export.model import ExportModel
from dynid.identification.estimate import Estimate
from dynid.regressor.model import InverseDynamicModel

_STATES = 2000
_SEED = 0
_ALONE = ("Fc", "Fv", "Fo", "Im", "Imm")
"""Beside these, Coulomb and viscous friction are what was identified."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NearestFriction:
    """Coulomb and viscous friction of each joint, and what they leave of all friction."""

    coulomb: Array
    """(n) [N.m or N]"""
    viscous: Array
    """(n) [N.m.s/rad or N.s/m]"""
    missing: Array
    """(n) RMS of the friction that they leave, over the recorded range [N.m or N]."""
    stands_in: bool
    """Whether they are others than those identified."""

    def put_into(self, model: ExportModel) -> ExportModel:
        """The model with this Coulomb and viscous friction."""
        return replace(model, terms={**model.terms, "Fc": self.coulomb, "Fv": self.viscous})

    def torque(self, dq: Array) -> Array:
        """(N, n) at velocities (N, n), the Coulomb step a sign."""
        return self.coulomb * np.sign(dq) + self.viscous * dq


def nearest_friction(
    estimate: Estimate, completed: Completion, model: ExportModel
) -> NearestFriction:
    """What an identified model has, where that is all; else the least squares fit to all of it.

    The fit is over states drawn evenly from the recorded range of positions, velocities and
    accelerations, neither of the two below zero.

    Args:
        estimate: The estimate.
        completed: Its standard parameters.
        model: The same, as it is exported.
    """
    n, terms = model.joints, model.terms
    offset = terms["Fo"]
    if not any(values.any() for symbol, values in terms.items() if symbol not in _ALONE):
        return NearestFriction(
            coulomb=terms["Fc"], viscous=terms["Fv"], missing=np.abs(offset), stands_in=False
        )
    q, dq, ddq = _recorded_range(estimate)
    # A constant is friction of neither kind, and must not be taken for some by chance.
    wanted = _friction(estimate.model, completed, q, dq, ddq) - offset
    both, missing = np.zeros((2, n)), np.zeros(n)
    for j in range(n):
        columns = np.column_stack([np.sign(dq[:, j]), dq[:, j]])
        both[:, j] = _not_negative(columns, wanted[:, j])
        left = wanted[:, j] - columns @ both[:, j]
        missing[j] = np.hypot(np.sqrt(np.mean(np.square(left))), offset[j])
    return NearestFriction(coulomb=both[0], viscous=both[1], missing=missing, stands_in=True)


def _not_negative(columns: Array, wanted: Array) -> Array:
    """(2) least squares weights of two columns, neither below zero."""
    best, least = np.zeros(2), float(wanted @ wanted)
    for chosen in ([0, 1], [0], [1]):
        weights = np.zeros(2)
        weights[chosen] = np.linalg.lstsq(columns[:, chosen], wanted, rcond=None)[0]
        left = wanted - columns @ weights
        if (weights >= 0.0).all() and float(left @ left) < least:
            best, least = weights, float(left @ left)
    return best


def _recorded_range(estimate: Estimate) -> tuple[Array, Array, Array]:
    seen = estimate.motion
    random = np.random.default_rng(_SEED)
    q, dq, ddq = random.uniform(-1.0, 1.0, (3, _STATES, estimate.model.robot.joints))
    middle, reach = (seen.upper + seen.lower) / 2.0, (seen.upper - seen.lower) / 2.0
    return middle + reach * q, seen.speed * dq, seen.acceleration * ddq


def _friction(
    model: InverseDynamicModel, completed: Completion, q: Array, dq: Array, ddq: Array
) -> Array:
    """(N, n) all friction of the identified model."""
    first = 10 * model.robot.joints
    values = np.array(completed.values)
    values[:first] = 0.0
    for k, column in enumerate(model.columns[first:], start=first):
        if not column.name.startswith("F"):
            values[k] = 0.0
    return model.inverse_dynamics(q, dq, ddq, values)
