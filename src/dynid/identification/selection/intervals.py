"""Torque intervals that know where they are: wide where the recording has not been."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from dynid.core import Array, InputError, Mask, frozen
from dynid.identification.bayesian import symbol_of
from dynid.regressor import INERTIAL

LEVELS = (0.5, 0.68, 0.8, 0.9, 0.95, 0.99)
"""Levels whose quantiles are kept; others lie on straight lines between."""
FRICTION_CHANGE, GAIN_CHANGE = 0.1, 0.05
"""Standard deviation of friction and of drive gains between days: gains regressed from two
recordings of one UR5 differ by 1 to 20 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """What a recording on another day may change, at some states."""

    moving: Mask
    """(n, N) whether each joint moves."""
    stiction: Array
    """(n, N) size of what friction may hold while a joint hardly moves [N.m or N]."""
    change: Array
    """(n, N) standard deviation from friction and drive gains of another day [N.m or N]."""


def conditions(
    names: Sequence[str],
    values: Array,
    columns: Array,
    moving: Mask,
) -> Conditions:
    """Conditions of states.

    Args:
        names: (r) names of the base parameters.
        values: (r) their values.
        columns: (r, n, N) their columns.
        moving: (n, N) whether each joint moves.
    """
    inertial = {"Im", "Imm", *INERTIAL}
    rubs = [k for k, name in enumerate(names) if symbol_of(name) not in inertial]
    friction = np.tensordot(values[rubs], columns[rubs], axes=1)
    torque = np.tensordot(values, columns, axes=1)
    stiction = np.zeros(torque.shape)
    for k in rubs:
        if symbol_of(names[k]) == "Fc":
            j = int(names[k][2:]) - 1
            # Where the Coulomb column is not saturated, friction holds what it is given.
            stiction[j] = abs(values[k]) * np.sqrt(np.maximum(1.0 - columns[k, j] ** 2, 0.0))
    return Conditions(
        moving=moving,
        stiction=stiction,
        change=np.hypot(FRICTION_CHANGE * friction, GAIN_CHANGE * torque),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueInterval:
    """Torque intervals that grow where the recording has not been.

    s^2 = sigma^2 + c^2 h with the leverage h = |root' x|^2 of a state's columns x. The half width
    is a quantile of |error| / s on the regions left out (split conformal prediction), of rows in
    motion and at rest apart; at rest never less than stiction may hold. What friction and drive
    gains of another day may change is added in square.
    """

    root: Array
    """(r, k) root of the uncertainty of the base parameters: their information, what is unsure
    of the published inertias, and what near-equal models differ by."""
    sigma: Array
    """(n) RMS error on stretches of time left out [N.m or N]."""
    scale: Array
    """(n) c."""
    slowest: Array
    """(n) speed from which a joint moves [rad/s or m/s]."""
    quantiles: Array
    """(2, n, L) of |error| / s at `LEVELS`, at rest and in motion."""

    def __post_init__(self) -> None:
        n = len(self.sigma)
        for name, shape in (
            ("root", (None, None)),
            ("sigma", (n,)),
            ("scale", (n,)),
            ("slowest", (n,)),
            ("quantiles", (2, n, len(LEVELS))),
        ):
            object.__setattr__(self, name, frozen(getattr(self, name), shape=shape, name=name))

    def half_width(self, columns: Array, there: Conditions, level: float) -> Array:
        """(n, N) half widths [N.m or N] of the intervals of states.

        Args:
            columns: (r, n, N) base columns of the states.
            there: What another day may change there.
            level: Share of measured torques that shall lie within, 0.5 to 0.99.

        Raises:
            InputError: A level outside `LEVELS`.
        """
        if not LEVELS[0] <= level <= LEVELS[-1]:
            raise InputError(
                "level of an interval", value=level, limit=f"{LEVELS[0]} to {LEVELS[-1]}"
            )
        variance = np.square(self.sigma)[:, None]
        variance = variance + np.square(self.scale)[:, None] * leverage(self.root, columns)
        rest, motion = np.array(
            [[np.interp(level, LEVELS, row) for row in part] for part in self.quantiles],
            dtype=np.float64,
        )
        # As arithmetic: the type of `where` is not known to checkers.
        factor = rest[:, None] + there.moving * (motion - rest)[:, None]
        half = factor * np.sqrt(variance)
        # Friction at rest is anywhere between its bounds.
        half = np.maximum(half, level * there.stiction)
        normal = NormalDist().inv_cdf((1.0 + level) / 2.0)
        return np.hypot(half, normal * there.change)

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "root": self.root.tolist(),
            "sigma": self.sigma.tolist(),
            "scale": self.scale.tolist(),
            "slowest": self.slowest.tolist(),
            "levels": list(LEVELS),
            "quantiles": self.quantiles.tolist(),
        }


def leverage(root: Array, columns: Array) -> Array:
    """(n, N) |root' x|^2 for columns (r, n, N)."""
    return np.square(np.tensordot(root, columns, axes=(0, 0))).sum(axis=0)
