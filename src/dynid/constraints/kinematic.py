"""Bounds of position, velocity and acceleration, joint by joint."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array, Mask
from dynid.robot.model import RobotModel
from dynid.trajectory.bounds import MotionBounds


def bound_ratios(bounds: MotionBounds, q: Array, dq: Array, ddq: Array) -> tuple[Array, ...]:
    """What each bound is used, three (N, n) arrays; 1 is the bound.

    Positions count from the middle of their range; a bound that is infinite is used 0.
    """
    middle, half = _range(bounds)
    return (
        np.abs(q - middle) / half,
        np.abs(dq) / bounds.velocity,
        np.abs(ddq) / bounds.acceleration,
    )


def bound_violation(
    bounds: MotionBounds, q: Array, dq: Array, ddq: Array, share: float
) -> tuple[float, Array, Array, Array]:
    """Sum of squared excesses over `share` of each bound, and its derivatives (N, n)."""
    middle, half = _range(bounds)
    total = 0.0
    slopes: list[Array] = []
    for value, limit in (
        (q - middle, share * half),
        (dq, share * bounds.velocity),
        (ddq, share * bounds.acceleration),
    ):
        over = np.maximum(np.abs(value) / limit - 1.0, 0.0)
        total += float(np.vdot(over, over))
        slopes.append(2.0 * over * np.sign(value) / limit)
    return total, slopes[0], slopes[1], slopes[2]


def bound_notes(robot: RobotModel, bounds: MotionBounds) -> list[str]:
    """What the robot does not say of its bounds, in words: what is unknown does not bind."""
    notes: list[str] = []
    unknown = np.isnan(robot.limits.lower) | np.isnan(robot.limits.upper)
    taken = unknown & np.isfinite(bounds.lower) & np.isfinite(bounds.upper)
    if taken.any():
        low, high = float(bounds.lower[taken].min()), float(bounds.upper[taken].max())
        notes.append(
            f"no position limits are known of {_joints(robot, taken)}: taken as {low:.4g} to"
            f" {high:.4g}"
        )
    for name, values in (("velocity", bounds.velocity), ("acceleration", bounds.acceleration)):
        free = np.isinf(values)
        if free.any():
            notes.append(
                f"{name} is not judged of {_joints(robot, free)}: no limit is known ([limits] in a"
                " robot file)"
            )
    return notes


def _joints(robot: RobotModel, which: Mask) -> str:
    if which.all():
        return "any joint"
    return ", ".join(name for name, one in zip(robot.joint_names, which, strict=True) if one)


def _range(bounds: MotionBounds) -> tuple[Array, Array]:
    if np.isinf(bounds.lower).any() or np.isinf(bounds.upper).any():
        lower = np.where(np.isinf(bounds.lower), -1e300, bounds.lower)
        upper = np.where(np.isinf(bounds.upper), 1e300, bounds.upper)
        return lower / 2 + upper / 2, upper / 2 - lower / 2
    return (bounds.lower + bounds.upper) / 2, (bounds.upper - bounds.lower) / 2
