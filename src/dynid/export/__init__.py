"""Identified models as files that other programs load."""

from dynid.export.model import ExportModel as ExportModel
from dynid.export.model import completed_model as completed_model
from dynid.export.robot_xml import quaternion as quaternion
from dynid.export.robot_xml import roll_pitch_yaw as roll_pitch_yaw
from dynid.export.writing import AFTER_REVERSALS as AFTER_REVERSALS
from dynid.export.writing import ExportedFile as ExportedFile
from dynid.export.writing import check_suffix as check_suffix
from dynid.export.writing import simulator_obstacle as simulator_obstacle
from dynid.export.writing import write_model as write_model
