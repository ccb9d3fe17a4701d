"""Small arms and problems, so that a whole design takes a fraction of a second."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.constraints import paper_constraints, safe_constraints
from dynid.excitation import ExcitationProblem, parse_criterion
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.robot import RobotModel
from dynid.robot.robotfile import robot_from_toml
from dynid.trajectory import motion_family

Floats = NDArray[np.float64]
ARM = """
name = "{name}"
joint_names = ["one", "two", "three"]
[dh]
convention = "standard"
a = [0.0, 0.4, 0.3]
d = [0.2, 0.0, 0.1]
alpha = [1.5707963267948966, 0.0, 0.0]
joint_types = ["revolute", "revolute", "{last}"]
[limits]
lower = [-3.0, -2.0, {lower}]
upper = [3.0, 2.5, {upper}]
velocity = [2.0, 2.0, {speed}]
acceleration = [10.0, 10.0, 10.0]
torque = [{torque}, {torque}, {torque}]
[safety]
tcp_speed = 1.0
[inertia]
frames = "dh"
mass = [4.0, 6.0, 2.0]
com = [[0.0, 0.0, 0.0], [-0.2, 0.0, 0.0], [-0.1, 0.0, 0.0]]
"""


def arm_text(*, sliding: bool = False, torque: float = 80.0) -> str:
    """The robot file of a three-joint arm."""
    return ARM.format(
        name="small",
        last="prismatic" if sliding else "revolute",
        lower=0.1 if sliding else -2.5,
        upper=0.5 if sliding else 2.5,
        speed=0.5 if sliding else 2.5,
        torque=torque,
    )


def arm(*, sliding: bool = False, torque: float = 80.0) -> RobotModel:
    text = arm_text(sliding=sliding, torque=torque)
    return robot_from_toml(text.encode(), Path("small.toml"))


def leaning(*, torque: float) -> RobotModel:
    """The same where the second joint cannot bring the arm upright, so that it must be held."""
    robot = arm(torque=torque)
    lower, upper = np.array(robot.limits.lower), np.array(robot.limits.upper)
    lower[1:], upper[1:] = (-0.5, -0.5), (0.5, 0.5)
    return replace(robot, limits=replace(robot.limits, lower=lower, upper=upper))


def problem(
    robot: RobotModel | None = None,
    *,
    criterion: str = "cond",
    family: str = "fourier",
    period: float = 6.0,
    harmonics: int = 3,
    safe: bool = False,
    rate_hz: float = 50.0,
    start_pose: Floats | None = None,
) -> ExcitationProblem:
    chosen = arm() if robot is None else robot
    judge = safe_constraints(chosen) if safe else paper_constraints(chosen)
    return ExcitationProblem(
        base=reduce_model(InverseDynamicModel(robot=chosen)),
        criterion=parse_criterion(criterion),
        family=motion_family(family, period, harmonics),
        constraints=judge,
        rate_hz=rate_hz,
        start_pose=start_pose,
    )
