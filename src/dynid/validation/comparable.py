"""Whether the parameters of two estimates mean the same."""

from __future__ import annotations

import numpy as np

from dynid.core.errors import InputError
from dynid.core.notices import Notice
from dynid.identification.estimate import Estimate
from dynid.robot.model import RobotModel

_SAME_PLACE = 1e-9
_SAME_GRAVITY = 1e-6
_SAME_GAIN = 1e-9


def refuse_strangers(a: Estimate, b: Estimate) -> None:
    """Refuse two estimates whose parameters do not mean the same.

    Raises:
        InputError: Different robots, mountings, frames, terms or base sets; one message names
            all that differs.
    """
    reasons: list[str] = []
    one, other = a.model.robot, b.model.robot
    if not _same_chain(one, other):
        reasons.append(f"robots ({_called(one)} and {_called(other)})")
    elif not np.allclose(one.gravity, other.gravity, atol=_SAME_GRAVITY, rtol=0):
        reasons.append(f"mountings ({one.mount} and {other.mount})")
    if a.model.frames != b.model.frames:
        reasons.append(f"frames ({a.model.frames} and {b.model.frames})")
    terms = [estimate.model.friction.describe() for estimate in (a, b)]
    if terms[0] != terms[1]:
        reasons.append(f"terms ({terms[0]} and {terms[1]})")
    if not reasons and (a.independent, a.expressions) != (b.independent, b.expressions):
        reasons.append(f"base sets ({len(a.values)} and {len(b.values)} parameters)")
    if reasons:
        raise InputError(
            f"the estimates differ in {' and in '.join(reasons)}",
            next_step="Identify both recordings with the same --robot and the same --terms.",
        )


def comparison_warnings(a: Estimate, b: Estimate) -> tuple[Notice, ...]:
    """What may mislead in a comparison that is allowed."""
    found: list[Notice] = []
    gains = [estimate.model.robot.drives.gain for estimate in (a, b)]
    if not np.allclose(*gains, rtol=_SAME_GAIN, atol=0, equal_nan=True):
        message = "the drive gains differ; parameters from currents are scaled by them"
        found.append(Notice("unit_suspect", message))
    for label, estimate in (("first", a), ("second", b)):
        codes = sorted({notice.code for notice in estimate.warnings})
        for code in codes:
            found.append(Notice(code, f"the {label} estimate carries this warning"))
    return tuple(found)


def _called(robot: RobotModel) -> str:
    return f"{robot.name}, {robot.joints} joints"


def _same_chain(one: RobotModel, other: RobotModel) -> bool:
    """Kinematics decide, not names: a URDF of the same arm may be called otherwise."""
    return (
        one.joint_types == other.joint_types
        and np.allclose(one.placements, other.placements, atol=_SAME_PLACE, rtol=0)
        and np.allclose(one.axes, other.axes, atol=_SAME_PLACE, rtol=0)
    )
