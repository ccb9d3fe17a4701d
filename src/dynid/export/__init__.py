"""Identified models as files that other programs load."""

from dynid.export.model import ExportModel, completed_model
from dynid.export.robot_xml import quaternion, roll_pitch_yaw
from dynid.export.writing import ExportedFile, simulator_obstacle, write_model

__all__ = [
    "ExportModel",
    "ExportedFile",
    "completed_model",
    "quaternion",
    "roll_pitch_yaw",
    "simulator_obstacle",
    "write_model",
]
