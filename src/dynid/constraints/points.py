"""The points whose speed is limited: tool, elbow, and the centres of mass together."""

from __future__ import annotations

import math

import numpy as np

from dynid.constraints.arm import arm_geometry
from dynid.constraints.settings import ConstraintSettings
from dynid.constraints.speed import MovingPoints
from dynid.core.arrays import read_only
from dynid.robot.model import RobotModel


def judged_points(
    robot: RobotModel, settings: ConstraintSettings, notes: list[str]
) -> dict[str, tuple[MovingPoints, float]]:
    """Kind to its points and its limit [m/s or kg.m/s], for the kinds that are held."""
    arm, safety = arm_geometry(robot), robot.safety
    found: dict[str, tuple[MovingPoints, float]] = {}
    if settings.tcp_speed and not math.isnan(safety.tcp_speed):
        tool = robot.flange[:3, :3] @ settings.tcp + robot.flange[:3, 3]
        found["tcp_speed"] = (
            MovingPoints(
                arm=arm,
                link=np.array([robot.joints], dtype=np.intp),
                points=read_only(tool[None].copy()),
                weights=read_only(np.ones(1)),
            ),
            safety.tcp_speed,
        )
    if settings.elbow_speed and not math.isnan(safety.elbow_speed) and safety.elbow:
        place = robot.parameter_frames["urdf"][safety.elbow - 1, :3, 3]
        found["elbow_speed"] = (
            MovingPoints(
                arm=arm,
                link=np.array([safety.elbow], dtype=np.intp),
                points=read_only(place[None].copy()),
                weights=read_only(np.ones(1)),
            ),
            safety.elbow_speed,
        )
    if settings.momentum and not math.isnan(safety.momentum):
        known = robot.inertias[:, :4]
        if np.isnan(known).any():
            notes.append("momentum is not judged: a mass or centre of mass is unknown")
            return found
        heavy = np.flatnonzero(known[:, 0] > 0)
        if len(heavy):
            found["momentum"] = (
                MovingPoints(
                    arm=arm,
                    link=heavy + 1,
                    points=read_only(known[heavy, 1:] / known[heavy, :1]),
                    weights=read_only(known[heavy, 0].copy()),
                ),
                safety.momentum,
            )
    return found
