"""Drive gains from what the controller itself expects: target current against target moment.

A UR controller streams the torque of its own model (`target_moment`) and the current that it
expects for it (`target_current`): the moment over the drive gain, and the friction that it
compensates. Joint by joint,

    target_current = target_moment / k + a tanh(dq / width) + b dq

is linear in 1/k, a and b. No torque is measured, so nothing of the arm enters but its own
settings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError, JobError
from dynid.core.linalg import inverse_upper, upper_triangle
from dynid.core.notices import Notice
from dynid.identification.statistics import correlation_lag, long_run_covariance

WIDTH = 0.01
"""Speed over which the controller's dry friction changes sign [rad/s]."""
LARGEST_STD = 0.05
"""Relative standard deviation above which a gain is not given."""
LEAST_SHARE = 1e-12
"""Part of the current that the moment must move apart from friction, over the current: less is
rounding. Whether more is enough, the residuals say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveGains:
    """Drive gains with their uncertainty; NaN where the motion does not show them.

    Raises:
        InputError: Shapes that disagree.
    """

    gain: Array
    """(n) joint torque per motor current [N.m/A]."""
    std: Array
    """(n) standard deviations that allow for correlated residuals [N.m/A]."""
    coulomb: Array
    """(n) dry friction that the controller compensates [N.m]."""
    viscous: Array
    """(n) viscous friction that the controller compensates [N.m.s/rad]."""
    r2: Array
    """(n) share of the current's variation that is explained."""
    samples: int
    warnings: tuple[Notice, ...] = ()

    def __post_init__(self) -> None:
        n = np.size(self.gain)
        for name in ("gain", "std", "coulomb", "viscous", "r2"):
            value = frozen(getattr(self, name), shape=(n,), name=name, finite=False)
            object.__setattr__(self, name, value)

    def to_json(self, names: tuple[str, ...]) -> dict[str, Any]:
        """A JSON object; null where a gain is not known.

        Args:
            names: (n) joint names.
        """
        return {
            "samples": self.samples,
            "gains": [
                {
                    "joint": name,
                    "gain": _number(self.gain[j]),
                    "std": _number(self.std[j]),
                    "coulomb": _number(self.coulomb[j]),
                    "viscous": _number(self.viscous[j]),
                    "r2": _number(self.r2[j]),
                }
                for j, name in enumerate(names)
            ],
            "warnings": [notice.to_json() for notice in self.warnings],
        }


def drive_gains(
    current: Array,
    moment: Array,
    velocity: Array,
    *,
    rate_hz: float,
    names: tuple[str, ...],
    width: float = WIDTH,
) -> DriveGains:
    """Gains from the controller's targets.

    Args:
        current: (N, n) target currents [A].
        moment: (N, n) target moments [N.m].
        velocity: (N, n) target velocities, or measured ones [rad/s].
        rate_hz: Samples a second.
        names: (n) joint names, for messages.
        width: Speed over which the compensated dry friction changes sign [rad/s].

    Raises:
        InputError: Shapes that disagree, a width that is not positive, or too few samples.
        JobError: No joint's gain can be told.
    """
    shape = (current.shape[0], len(names))
    if not current.shape == moment.shape == velocity.shape == shape:
        raise InputError(
            "target current, target moment and velocity differ in shape",
            value=(current.shape, moment.shape, velocity.shape),
            limit=shape,
        )
    if not width > 0:
        raise InputError("the width must be positive", value=width)
    if shape[0] < 16:
        raise InputError("too few samples for drive gains", value=shape[0], limit="at least 16")
    rows, warnings = np.empty((len(names), 5)), list[Notice]()
    for j, name in enumerate(names):
        columns = np.stack([moment[:, j], np.tanh(velocity[:, j] / width), velocity[:, j]])
        rows[j], reason = _joint(columns, current[:, j], rate_hz)
        if reason:
            warnings.append(Notice("low_excitation", f"no drive gain for {name}: {reason}"))
    if np.isnan(rows[:, 0]).all():
        raise JobError(
            "no joint's drive gain can be told from this recording",
            value=warnings[0].message,
            next_step="Record a motion that loads and accelerates every joint.",
        )
    return DriveGains(
        gain=rows[:, 0],
        std=rows[:, 1],
        coulomb=rows[:, 2],
        viscous=rows[:, 3],
        r2=rows[:, 4],
        samples=shape[0],
        warnings=tuple(warnings),
    )


def _joint(columns: Array, current: Array, rate_hz: float) -> tuple[Array, str]:
    """Gain, its deviation, Coulomb, viscous and r2 of one joint, and why there is none."""
    nothing = np.full(5, np.nan)
    norms = np.linalg.norm(columns, axis=1)
    if norms[1] < 1e-9 or norms[0] < 1e-9:
        return nothing, "the joint stands still or carries no moment"
    # The moment last: its pivot is what of it the friction columns cannot show.
    scaled = (columns / norms[:, None])[[1, 2, 0]].T
    upper = upper_triangle(np.column_stack([scaled, current]))
    pivots = np.abs(np.diag(upper)[:3])
    moved = float(np.abs(upper[2, 3]))
    if pivots.min() < 1e-9 or moved < LEAST_SHARE * np.linalg.norm(current):
        return nothing, "its moment does not move the current apart from its friction"
    inverse = inverse_upper(upper[:3, :3])
    solution = inverse @ upper[:3, 3]
    residual = current - scaled @ solution
    if moved < np.linalg.norm(residual):
        return nothing, "its moment moves the current less than the fit leaves unexplained"
    scores = scaled.T * residual
    lag = correlation_lag(residual[None], rate_hz) if residual.any() else 1
    bread = inverse @ inverse.T
    covariance = bread @ long_run_covariance(scores, lag) @ bread
    friction = solution[:2] / norms[1:]
    per_moment = solution[2] / norms[0]
    relative = float(np.sqrt(max(covariance[2, 2], 0.0)) / abs(solution[2]))
    if relative > LARGEST_STD:
        return nothing, f"its standard deviation would be {100 * relative:.0f} %"
    gain = 1.0 / per_moment
    spread = float(np.square(current - current.mean()).sum())
    r2 = 1.0 - float(residual @ residual) / max(spread, 1e-300)
    return np.array([gain, abs(gain) * relative, *(gain * friction), r2]), ""


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
