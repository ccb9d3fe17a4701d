"""Motions of the arm: generators that give one set point a control cycle."""

from urtwin.motion.joint import Motion, move_joints, servo_joints, speed_joints, stop_joints
from urtwin.motion.tool import (
    goal_joints,
    move_circle,
    move_tool,
    servo_tool,
    speed_tool,
    stop_tool,
)

__all__ = [
    "Motion",
    "goal_joints",
    "move_circle",
    "move_joints",
    "move_tool",
    "servo_joints",
    "servo_tool",
    "speed_joints",
    "speed_tool",
    "stop_joints",
    "stop_tool",
]
