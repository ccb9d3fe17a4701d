"""Whether a written file gives our torques when another program loads it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.core.arrays import Array
from dynid.export.completion import Completion
from dynid.export.nearest_friction import NearestFriction
from dynid.identification.estimate import Estimate

STATES = 200
SEED = 0
SPEED = 3.0
"""[rad/s or m/s]"""
ACCELERATION = 10.0
"""[rad/s^2 or m/s^2]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class States:
    """Random states of an arm."""

    q: Array
    """(N, n) positions [rad or m]."""
    dq: Array
    """(N, n) velocities."""
    ddq: Array
    """(N, n) accelerations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """The largest difference between a file's torques and ours."""

    max_torque_difference: float | None
    """[N.m or N]; None where no other program could load the file."""
    tolerance: float
    """What is allowed [N.m or N]."""
    loaded_with: str
    """The program, with its version; or why there was none."""
    states: int = STATES
    """Random states compared."""

    @property
    def passed(self) -> bool:
        """Whether the file was loaded and its torques are ours."""
        found = self.max_torque_difference
        return found is not None and found <= self.tolerance

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "max_torque_difference": self.max_torque_difference,
            "tolerance": self.tolerance,
            "loaded_with": self.loaded_with,
            "states": self.states,
        }


def random_motion(joints: int, prismatic: Iterable[bool]) -> States:
    """The states that files are verified on."""
    random = np.random.default_rng(SEED)
    reach = np.where(list(prismatic), 1.0, np.pi)
    q, dq, ddq = random.uniform(-1.0, 1.0, (3, STATES, joints))
    return States(q=reach * q, dq=SPEED * dq, ddq=ACCELERATION * ddq)


def our_torque(
    estimate: Estimate,
    completed: Completion,
    states: States,
    held: Iterable[str] | None = None,
    friction: NearestFriction | None = None,
) -> Array:
    """(N, n) torques by the model that was identified, not by anything in this package.

    Args:
        estimate: The estimate.
        completed: Its standard parameters.
        states: Where.
        held: Terms beside the inertias that the file has a place for: the others, and
            counterbalances, are left out. None for everything.
        friction: Coulomb and viscous friction of such a file.
    """
    model, values = estimate.model, np.array(completed.values)
    if held is None or friction is None:
        torque = model.inverse_dynamics(states.q, states.dq, states.ddq, values)
        return torque - model.known_torque(states.q)
    kept = set(held) - {"Fc", "Fv"}
    for k, column in enumerate(model.columns[10 * model.robot.joints :]):
        if column.name.rstrip("0123456789") not in kept:
            values[10 * model.robot.joints + k] = 0.0
    torque = model.inverse_dynamics(states.q, states.dq, states.ddq, values)
    return torque + friction.torque(states.dq)
