"""The two sets of limits that commands offer: the paper's, and all that is safe."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dynid.constraints.motion import MotionConstraints
from dynid.constraints.scene import Scene
from dynid.constraints.settings import ConstraintSettings
from dynid.robot.model import RobotModel
from dynid.trajectory.bounds import usable_bounds

PRESETS = ("safe", "paper")
"""The words of `--limits`."""


def paper_constraints(
    robot: RobotModel, *, acceleration: ArrayLike | None = None
) -> MotionConstraints:
    """The paper's problem alone: bounds of position, velocity and acceleration.

    Args:
        robot: The robot.
        acceleration: Bounds where the robot knows none [rad/s^2 or m/s^2].

    Raises:
        InputError: Bounds that leave no room.
    """
    settings = ConstraintSettings(
        bounds=usable_bounds(robot.limits, acceleration),
        torque=False,
        tcp_speed=False,
        elbow_speed=False,
        momentum=False,
        power=False,
        self_collision=False,
    )
    return MotionConstraints(robot, settings)


def safe_constraints(
    robot: RobotModel,
    scene: Scene | None = None,
    *,
    collision: bool = True,
    acceleration: ArrayLike | None = None,
    clearance: float = 0.01,
    payload_mass: float = 0.0,
    payload_com: ArrayLike = (0.0, 0.0, 0.0),
) -> MotionConstraints:
    """Everything that is known of the robot, and its surroundings.

    Args:
        robot: The robot.
        scene: What stands around it and what it carries.
        collision: Whether to look at collisions (`--no-collision` switches it off).
        acceleration: Bounds where the robot knows none [rad/s^2 or m/s^2].
        clearance: Smallest distance to the scene [m].
        payload_mass: Mass of what the flange carries [kg].
        payload_com: (3) its centre of mass in the flange's frame [m].

    Raises:
        InputError: Bounds that leave no room, or a scene in which the robot cannot stand.
    """
    settings = ConstraintSettings(
        bounds=usable_bounds(robot.limits, acceleration),
        self_collision=collision,
        scene=scene if collision else None,
        clearance=clearance,
        payload_mass=payload_mass,
        payload_com=np.asarray(payload_com, dtype=np.float64),
    )
    return MotionConstraints(robot, settings)
