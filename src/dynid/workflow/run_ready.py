"""Before a real robot moves: its checks, its way to the start, and a person who agrees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dynid.constraints.motion import MotionConstraints
from dynid.core.errors import JobError
from dynid.drivers.ur.state import ControllerState, inspect
from dynid.experiment.approach import plan_approach
from dynid.experiment.plan import ExperimentPlan
from dynid.experiment.preflight import check_design, check_robot, require_ready
from dynid.workflow.robot_units import unit_notes

Confirm = Callable[[str, str], None]
"""Shown what is about to move and the word that agrees to it; raises where nobody agrees."""
MOVED = 0.01
"""Joint motion between check and start that calls for another check [rad]."""


def made_ready(
    plan: ExperimentPlan,
    state: ControllerState,
    constraints: MotionConstraints,
    confirm: Confirm | None,
) -> ExperimentPlan:
    """The plan with its way to the start: check the design, then the robot, then ask.

    Args:
        plan: What is to be executed.
        state: The robot's controller, as it says it is.
        constraints: What the motion and the way to its start are held to.
        confirm: Shown what is about to move; None agrees to everything.

    Raises:
        InputError: A design that must not run, or nobody agrees.
        JobError: The robot is not ready.
    """
    certificate = check_design(plan, constraints)
    approach = plan_approach(state.q, plan.start, constraints)
    checks = check_robot(plan, state, approach)
    require_ready(checks, state.host)
    if confirm is not None:
        lines = [f"{check.name}: {check.finding}" for check in checks]
        lines += [f"mounted as: {plan.robot.mount} (the robot cannot tell; look)"]
        lines += [*unit_notes(plan.robot), *certificate.notes]
        lines += [
            f"{step.name}: {step.execution.settle + step.execution.periods} x "
            f"{step.execution.trajectory.duration:g} s"
            for step in plan.passes()
        ]
        confirm("\n".join(f"- {line}" for line in lines), state.host)
        _check_still_there(state)
    return replace(plan, via=approach.via)


def _check_still_there(state: ControllerState) -> None:
    """The way was planned from where the robot stood before a person thought it over.

    Raises:
        JobError: It has moved since.
    """
    away = float(np.abs(inspect(state.host).q - state.q).max())
    if away > MOVED:
        raise JobError(
            "the robot has moved since it was checked",
            where=state.host,
            value=f"{away:.3g} rad",
            limit=f"{MOVED:g} rad",
            next_step="Start again.",
        )
