"""Friction that changes while a record is made: the arm warms up.

A fit finds the mean. What it leaves over, stretch by stretch, shows whether friction falls or
rises along the record; the scatter of the stretches about a line says how sure that is.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dynid.core.arrays import Array
from dynid.core.notices import Notice
from dynid.identification.estimate import Estimate
from dynid.validation.metrics import MOVING_SPEED
from dynid.validation.prediction import ValidationResult

STRETCHES = 10
LEAST_ROWS = 20
LEAST_SHARE = 0.1
"""Variance of the friction's shape that a stretch must have: both directions of motion."""
CERTAIN = 6.0
"""Change over its standard deviation, of a joint; eight degrees of freedom, joints to choose."""
LEAST_CHANGE = 0.05
"""Share of the friction at the joint's usual speed."""
LEAST_JOINTS = 0.5
"""Share of the joints: an arm warms up as a whole."""
DRIFTS = "changes along the record"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionDrift:
    """Change of each joint's friction from the record's start to its end."""

    change: Array
    """(n) share of the friction at the joint's usual speed; NaN where it cannot be told."""
    std: Array
    """(n) its standard deviation, from the scatter of stretches."""


def friction_drift(estimate: Estimate, result: ValidationResult) -> FrictionDrift:
    """How friction moves along a record.

    Args:
        estimate: The estimate.
        result: The record that it was identified from, reproduced.
    """
    error = result.measured - result.predicted
    joints = error.shape[1]
    cuts = np.linspace(0, len(error), STRETCHES + 1).astype(int)
    middle = (np.arange(STRETCHES) + 0.5) / STRETCHES
    change, std = np.full((2, joints), np.nan)
    pose = (estimate.motion.lower + estimate.motion.upper)[None] / 2
    for j in range(joints):
        moving = np.abs(result.dq[:, j]) > MOVING_SPEED
        if not moving.any():
            continue
        usual = float(np.sqrt(np.square(result.dq[moving, j]).mean()))
        speed = np.zeros((1, joints))
        speed[0, j] = usual
        both = [estimate.predict(pose, way * speed, 0 * speed)[0, j] for way in (1.0, -1.0)]
        friction = float(both[0] - both[1]) / 2
        found = np.full(STRETCHES, np.nan)
        for k, (a, b) in enumerate(pairwise(cuts.tolist())):
            rows = moving[a:b]
            if rows.sum() < LEAST_ROWS or friction <= 0:
                continue
            v, e = result.dq[a:b, j][rows], error[a:b, j][rows]
            # Friction opposes motion: of what is left, the part that turns with the speed.
            shape = (np.sign(v) + v / usual) / 2
            shape = shape - shape.mean()
            if shape @ shape > LEAST_SHARE * len(shape):
                found[k] = float(shape @ e / (shape @ shape)) / friction
        known = np.isfinite(found)
        if known.sum() < STRETCHES - 2:
            continue
        change[j], std[j] = _line(middle[known], found[known])
    return FrictionDrift(change=change, std=std)


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope of a line and its standard deviation from the scatter about it."""
    x = x - x.mean()
    slope = float(x @ y / (x @ x))
    left = y - y.mean() - slope * x
    return slope, float(np.sqrt(left @ left / max(len(x) - 2, 1) / (x @ x)))


def drifting_friction(
    estimate: Estimate, result: ValidationResult, names: tuple[str, ...]
) -> tuple[Notice, ...]:
    """Say where the friction of most joints moves one way along the record."""
    drift = friction_drift(estimate, result)
    with np.errstate(invalid="ignore", divide="ignore"):
        sure = np.abs(drift.change) > np.maximum(CERTAIN * drift.std, LEAST_CHANGE)
    way = float(np.sign(np.nansum(np.where(sure, drift.change, 0.0))))
    agree = [int(j) for j in np.flatnonzero(sure & (np.sign(drift.change) == way))]
    if len(agree) < LEAST_JOINTS * len(names):
        return ()
    words = ", ".join(f"{names[j]} {100 * drift.change[j]:+.0f} %" for j in agree)
    text = (
        f"friction {DRIFTS} ({words} from its start to its end): the joints grow "
        f"{'warmer' if way < 0 else 'colder'}; the friction given is the record's mean. Move the "
        "arm until it no longer changes, or identify parts of the record with --from and --to"
    )
    return (Notice("non_white_residuals", text),)
