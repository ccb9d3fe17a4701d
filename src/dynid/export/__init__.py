"""Identified models as files that other programs load."""

from dynid.export.robot_xml import quaternion, roll_pitch_yaw
from dynid.export.writing import ExportedFile, write_model

__all__ = [
    "ExportedFile",
    "quaternion",
    "roll_pitch_yaw",
    "write_model",
]
