"""The motion of a design in the formats of others: CSV, URScript, ROS."""

from __future__ import annotations

from pathlib import Path

from dynid.core.errors import InputError
from dynid.core.files import write_text
from dynid.excitation.design import ExcitationDesign
from dynid.robot.load import load_robot
from dynid.trajectory.sampled import csv_text, joint_trajectory_yaml
from dynid.trajectory.urscript import ur_program

KINDS = ("csv", "urscript", "ros")


def export_motion(design: ExcitationDesign, kind: str, path: str | Path) -> None:
    """Write one period of a design in another format.

    Args:
        design: The design.
        kind: One of `KINDS`.
        path: The file; it appears whole or not at all.

    Raises:
        InputError: An unknown kind, a motion that the format cannot hold, or a place where no
            such file can be.
        JobError: The disk does not take the file.
    """
    robot = load_robot(design.robot)
    match kind:
        case "csv":
            units = ["m" if slides else "rad" for slides in robot.prismatic]
            text = csv_text(design.trajectory, units=units)
        case "ros":
            text = joint_trajectory_yaml(design.trajectory, robot.joint_names)
        case "urscript":
            text = ur_program(design.trajectory, comment=f"dynid design for {robot.name}").text
        case _:
            raise InputError("unknown format", value=kind, limit=", ".join(KINDS))
    write_text(Path(path), text)
