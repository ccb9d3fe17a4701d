"""Designs as files: a trajectory file with one more object, `design`.

The limits of a design as a value that its file keeps, scene included.

`dynid check`: the certificate of a design or of any trajectory file.

The motion of a design in the formats of others: CSV, URScript, ROS.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.constraints import (
    PRESETS,
    Certificate,
    MotionConstraints,
    Scene,
    certify,
    paper_constraints,
    safe_constraints,
    scene_from_json,
)
from dynid.core import InputError, JsonFields, load_object, write_text
from dynid.excitation import ExcitationDesign, Purpose, purpose_of
from dynid.reduction import BaseParametrization
from dynid.robot import RobotModel, load_robot
from dynid.signals import process
from dynid.trajectory import (
    JointMotion,
    StoredTrajectory,
    csv_text,
    joint_trajectory_yaml,
    read_trajectory,
    through_poses,
    ur_program,
    write_trajectory,
)
from dynid.workflow.analyze import unit_notes
from dynid.workflow.recordings import open_record

CLEARANCE = 0.01
"""Kept to the scene [m]. An arm that stands on its table has no more under its shoulder: the UR5
keeps 13 mm there whatever it does."""
POSE_ACCELERATION = 5.0
"""Between the poses of a task, where the robot knows no limit [rad/s^2 or m/s^2]."""
POSE_RATE_HZ = 25.0
"""At which motions of a task are sampled."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignLimits:
    """Which limits hold, and around what.

    Raises:
        InputError: Limits that are not known.
    """

    preset: str = "safe"
    """`safe` or `paper`."""
    collision: bool = True
    scene: Mapping[str, Any] | None = None
    """The scene file's content."""
    scene_file: str = ""
    """Where it was read."""

    def __post_init__(self) -> None:
        if self.preset not in PRESETS:
            raise InputError(
                "unknown limits", where="--limits", value=self.preset, limit=", ".join(PRESETS)
            )

    def constraints(
        self,
        robot: RobotModel,
        *,
        payload_mass: float = 0.0,
        payload_com: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> MotionConstraints:
        """The judge of these limits.

        Args:
            robot: The robot.
            payload_mass: What it carries [kg].
            payload_com: Where, in the flange's frame [m].

        Raises:
            InputError: Contradictory bounds, a scene that is none, or one without room for the
                robot.
        """
        if self.preset == "paper":
            return paper_constraints(robot)
        return safe_constraints(
            robot,
            self._scene(),
            collision=self.collision,
            clearance=CLEARANCE,
            payload_mass=payload_mass,
            payload_com=payload_com,
        )

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "preset": self.preset,
            "collision": self.collision,
            "scene": None if self.scene is None else dict(self.scene),
            "scene_file": self.scene_file or None,
        }

    def _scene(self) -> Scene | None:
        if self.scene is None:
            return None
        return scene_from_json(JsonFields(self.scene), self.scene_file or "scene")


def given_limits(preset: str, collision: bool, scene: Path | None) -> DesignLimits:
    """Limits from the command line's words.

    Raises:
        InputError: An unknown word, or a scene that cannot be read.
    """
    return DesignLimits(
        preset=preset,
        collision=collision,
        scene=None if scene is None else load_object(scene).values,
        scene_file="" if scene is None else str(scene),
    )


def limits_from_json(fields: JsonFields) -> DesignLimits:
    """The inverse of `DesignLimits.to_json`.

    Raises:
        InputError: Missing keys or values of the wrong type.
    """
    preset, collision = fields.text("preset"), fields.get("collision")
    if not isinstance(collision, bool):
        raise InputError("collision must be true or false", value=collision)
    scene = fields.get("scene")
    return DesignLimits(
        preset=preset,
        collision=collision,
        scene=None if scene is None else fields.object("scene").values,
        scene_file=str(fields.get("scene_file") or ""),
    )


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


def purpose_from(paths: Sequence[str], base: BaseParametrization) -> Purpose:
    """The purpose that files stand for.

    Args:
        paths: Designs or other trajectory files, recordings, or JSON objects with a list `poses`,
            through which the arm is moved at half its speed.
        base: The base parameters.

    Raises:
        InputError: A file that is none of these, or one of another robot.
    """
    robot = base.model.robot
    motions: list[JointMotion] = []
    for path in paths:
        if Path(path).suffix.lower() != ".json":
            samples = process(open_record(path, robot), robot)
            motions.append(JointMotion(t=samples.t, q=samples.q, dq=samples.dq, ddq=samples.ddq))
            continue
        fields = load_object(path)
        trajectory = (
            through_poses(fields.matrix("poses"), robot.limits, acceleration=POSE_ACCELERATION)
            if "poses" in fields.values
            else read_trajectory(path).trajectory
        )
        times = np.arange(0.0, trajectory.duration, 1 / POSE_RATE_HZ)
        motions.append(trajectory.evaluate(times))
    return purpose_of(base, motions, ", ".join(paths))
