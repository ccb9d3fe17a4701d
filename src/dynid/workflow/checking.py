"""`dynid check`: the certificate of a design or of any trajectory file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dynid.constraints.certificate import Certificate, certify
from dynid.core.errors import InputError
from dynid.workflow.design_files import StoredDesign, read_design
from dynid.workflow.design_limits import DesignLimits, given_limits
from dynid.workflow.robot_units import unit_notes


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """The verdict on one file."""

    design: StoredDesign
    """What was judged."""
    limits: DesignLimits
    """What it was held to."""
    certificate: Certificate
    """What is left of each limit, and where it is least."""

    @property
    def feasible(self) -> bool:
        """Whether the motion may run."""
        return self.certificate.feasible

    def to_json(self) -> dict[str, Any]:
        """The keys that `dynid check --json` prints, and more."""
        designed = self.design.limits
        return {
            **self.certificate.to_json(),
            "broken": list(self.certificate.broken),
            "robot": self.design.robot.name,
            "mount": self.design.robot.mount,
            "duration_s": self.design.stored.trajectory.duration,
            "limits": self.limits.preset,
            "designed_for": None if designed is None else designed.preset,
            "scene": self.limits.scene_file or None,
        }


def check(
    design: str | Path,
    *,
    limits: str = "safe",
    scene: str | Path | None = None,
    collision: bool = True,
    robot: str | Path | None = None,
    mount: str | None = None,
) -> Check:
    """Judge a design from its start to its end, between samples too.

    Args:
        design: A design, or any trajectory file.
        limits: `safe`, whatever the design was made for; or `paper`: position, velocity and
            acceleration alone.
        scene: A scene file; None for the one that the design was made in.
        collision: Whether to look at collisions.
        robot: Another name or file of the robot.
        mount: The mounting; None for the design's.

    Raises:
        InputError: Not a design, a scene that makes no sense, or one that would not be looked at.
    """
    if scene is not None and (limits == "paper" or not collision):
        raise InputError(
            "a scene is looked at only with --limits safe and collisions on",
            where="--scene",
            value=str(scene),
        )
    stored = read_design(design, robot=robot, mount=mount)
    held = given_limits(limits, collision, None if scene is None else Path(scene))
    if scene is None and stored.limits is not None and collision:
        held = DesignLimits(
            preset=limits,
            collision=collision,
            scene=stored.limits.scene,
            scene_file=stored.limits.scene_file,
        )
    certificate = certify(stored.stored.trajectory, held.constraints(stored.robot))
    notes = (*unit_notes(stored.robot), *certificate.notes)
    certificate = replace(certificate, notes=notes)
    return Check(design=stored, limits=held, certificate=certificate)
