"""What the controller tells of the arm itself on ports 30001 and 30002: its kinematics and limits.

The layouts of KinematicsInfo and ConfigurationData, as Universal Robots' client library reads
them (Universal_Robots_Client_Library, src/primary/robot_state/kinematics_info.cpp and
configuration_data.cpp). A client is told once, in its first robot state.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from dynid.core import Array
from dynid.robot import RobotModel
from dynid.simulation.controller.machine import ControllerMachine

_NOT_CALIBRATED = (0xFFFFFFFF,) * 6
_JOINT_DEFAULTS, _TOOL_DEFAULTS, _EQUIVALENT_RADIUS = (1.047, 1.396), (0.25, 1.2), 0.25
"""Speed and acceleration of moves; the radius that turns rotations into metres."""
_MASTERBOARD, _BOX = 6, 4
_TYPES = {"ur5": 1, "ur10": 2, "ur3": 3, "ur16": 4, "ur20": 7, "ur30": 8}
_CB_SUBTYPE, _E_SUBTYPE = 1, 3
_AXES = 6


def kinematics_info(machine: ControllerMachine) -> bytes:
    """The DH table of the arm, as after no calibration."""
    theta, a, d, alpha = dh_table(machine.core.arm.plant.arm.robot)
    return struct.pack(">6I24dI", *_NOT_CALIBRATED, *theta, *a, *d, *alpha, 0)


def configuration_data(machine: ControllerMachine) -> bytes:
    """Joint limits, defaults of the moves, the DH table and the kind of robot."""
    arm = machine.core.arm
    theta, a, d, alpha = dh_table(arm.plant.arm.robot)
    limits = arm.limits
    positions = np.nan_to_num(np.column_stack([limits.lower, limits.upper]), nan=0.0)
    motions = np.nan_to_num(np.column_stack([limits.velocity, limits.acceleration]), nan=0.0)
    name = arm.plant.arm.robot.name.removesuffix("e")
    kind = (_MASTERBOARD, _BOX, _TYPES.get(name, 0), _subtype(machine))
    numbers = (*positions.ravel(), *motions.ravel(), *_JOINT_DEFAULTS, *_TOOL_DEFAULTS)
    return struct.pack(">53d4i", *numbers, _EQUIVALENT_RADIUS, *a, *d, *alpha, *theta, *kind)


def dh_table(robot: RobotModel) -> tuple[Array, Array, Array, Array]:
    """The standard DH table at q = 0: theta [rad], a [m], d [m] and alpha [rad], six each.

    All zero for a robot that is not given by such a table.
    """
    frames = robot.parameter_frames.get("dh")
    rows = np.zeros((_AXES, 4))
    if frames is not None:
        # From one DH frame to the next; the first starts at the base.
        steps: Array = np.matmul(robot.placements, frames)
        steps[1:] = np.linalg.solve(frames[:-1], steps[1:])
        for k, step in enumerate(steps):
            theta = math.atan2(step[1, 0], step[0, 0])
            a = math.cos(theta) * step[0, 3] + math.sin(theta) * step[1, 3]
            rows[k] = (theta, a, step[2, 3], math.atan2(step[2, 1], step[2, 2]))
    return rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3]


def _subtype(machine: ControllerMachine) -> int:
    return _CB_SUBTYPE if machine.core.version[0] < 5 else _E_SUBTYPE
