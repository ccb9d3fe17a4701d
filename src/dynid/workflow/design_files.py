"""Designs as files: a trajectory file with one more object, `design`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid.core.errors import InputError
from dynid.excitation.design import ExcitationDesign
from dynid.robot.load import load_robot
from dynid.robot.model import RobotModel
from dynid.trajectory.files import StoredTrajectory, read_trajectory, write_trajectory
from dynid.trajectory.json_fields import JsonFields
from dynid.workflow.design_limits import DesignLimits, limits_from_json


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredDesign:
    """A design, or any trajectory, as its file holds it."""

    stored: StoredTrajectory
    robot: RobotModel
    """As mounted in the design."""
    facts: dict[str, Any]
    """The object `design`; empty for a plain trajectory."""
    limits: DesignLimits | None
    """What it was designed for; None for a plain trajectory."""


def write_design(design: ExcitationDesign, path: str | Path) -> None:
    """Write a design as JSON; it appears whole or not at all.

    Args:
        design: The design.
        path: The file; `read_design`, `dynid check` and `dynid run` take it.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    write_trajectory(
        path,
        design.trajectory,
        robot=design.robot,
        limits=design.limits,
        provenance=design.provenance,
        extra={"design": design.to_json()},
    )


def read_design(
    path: str | Path, *, robot: str | Path | None = None, mount: str | None = None
) -> StoredDesign:
    """Read a design or a plain trajectory, and its robot.

    Args:
        path: The file.
        robot: Another name or file of the robot, where the stored one has moved.
        mount: The mounting; None for the design's.

    Raises:
        InputError: Not a design, or its robot cannot be read or has other joints.
    """
    stored = read_trajectory(path)
    found = stored.extra.get("design")
    facts: dict[str, Any] = dict(JsonFields(stored.extra).object("design").values) if found else {}
    placed = mount if mount is not None else _mount(facts)
    try:
        model = load_robot(stored.robot if robot is None else robot, mount=placed)
    except InputError as error:
        raise InputError(
            f"the robot of the design: {error.what}",
            where=str(path),
            value=error.value,
            limit=error.limit,
            next_step=f"{error.next_step} Or pass --robot." if error.next_step else "Pass --robot.",
        ) from error
    if model.joints != stored.trajectory.joints:
        raise InputError(
            "the motion is one of another robot",
            where=str(path),
            value=f"{stored.trajectory.joints} joints",
            limit=f"{model.joints} of {model.name}",
        )
    limits = limits_from_json(JsonFields(facts, "design.").object("limits")) if facts else None
    return StoredDesign(stored=stored, robot=model, facts=facts, limits=limits)


def _mount(facts: dict[str, Any]) -> str | None:
    mount = facts.get("mount")
    # `file` says that the robot file gives gravity itself.
    return mount if isinstance(mount, str) and mount != "file" else None
