"""Designs as files: a trajectory file with one more object, `design`.

The limits of a design as a value that its file keeps, scene included.

`dynid check`: the certificate of a design or of any trajectory file.

The motion of a design in the formats of others: CSV, URScript, ROS.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.constraints import (
    FLOORS,
    MARGIN,
    PRESETS,
    Certificate,
    MotionConstraints,
    Scene,
    certify,
    paper_constraints,
    safe_constraints,
    scene_from_json,
)
from dynid.core import InputError, JsonFields, content_hash, dynid_version, load_object, write_text
from dynid.excitation import ExcitationDesign, Purpose, purpose_of
from dynid.reduction import BaseParametrization
from dynid.robot import RobotModel, Tool, load_robot, robot_to_json, with_tool
from dynid.signals import process
from dynid.trajectory import (
    LANGUAGES,
    JointMotion,
    StoredTrajectory,
    copied_bounds,
    csv_text,
    joint_trajectory_yaml,
    points_text,
    read_trajectory,
    through_poses,
    trajectory_to_json,
    ur_program,
    write_trajectory,
)
from dynid.workflow.analyze import unit_notes
from dynid.workflow.recordings import open_record

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
    floor: float | str = "mount"
    """Height of the floor in the base frame [m]; `mount`: at the mounting plane; `none`."""
    tool: tuple[float, ...] | None = None
    """(3) the tool's point in the flange's frame [m]; None for the robot's own."""
    payload: tuple[float, ...] | None = None
    """(4) mass that the flange carries [kg] and its centre [m]; None for the robot's own."""
    margin_percent: float = 100.0 * MARGIN
    """Of the limits of velocity, speed, torque, momentum and power, kept free."""
    clearance: float | None = None
    """Smallest distance of bodies [m]; None for the usual ones."""

    def __post_init__(self) -> None:
        for name, value, known in (
            ("--limits", self.preset, PRESETS),
            ("--floor", self.floor, FLOORS if isinstance(self.floor, str) else (self.floor,)),
        ):
            if value not in known:
                raise InputError("unknown word", where=name, value=value, limit=", ".join(PRESETS))
        for name, numbers, count in (("--tool", self.tool, 3), ("--payload", self.payload, 4)):
            if numbers is not None and not (
                len(numbers) == count and all(math.isfinite(x) for x in numbers)
            ):
                raise InputError(f"needs {count} numbers", where=name, value=list(numbers))
        if not 0 <= self.margin_percent < 100:
            raise InputError(
                "margin", where="--margin", value=self.margin_percent, limit="0 to 100 %"
            )

    def equipped(self, robot: RobotModel) -> RobotModel:
        """The robot with the tool and the payload.

        Raises:
            RobotError: They make no sense.
        """
        return with_tool(robot, tcp=self.tool, payload=self.payload)

    def constraints(self, robot: RobotModel) -> MotionConstraints:
        """The judge of these limits, for the robot with its tool.

        Raises:
            InputError: Contradictory bounds, a scene that is none, or one without room for the
                robot.
        """
        if self.preset == "paper":
            return paper_constraints(robot)
        return safe_constraints(
            self.equipped(robot),
            self._scene(),
            collision=self.collision,
            clearance=self.clearance,
            margin=self.margin_percent / 100.0,
            floor=self.floor,
        )

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "preset": self.preset,
            "collision": self.collision,
            "scene": None if self.scene is None else dict(self.scene),
            "scene_file": self.scene_file or None,
            "floor": self.floor,
            "tool": None if self.tool is None else list(self.tool),
            "payload": None if self.payload is None else list(self.payload),
            "margin_percent": self.margin_percent,
            "clearance": self.clearance,
        }

    def _scene(self) -> Scene | None:
        if self.scene is None:
            return None
        return scene_from_json(JsonFields(self.scene), self.scene_file or "scene")


def given_limits(
    preset: str, collision: bool, scene: Path | None, base: DesignLimits | None = None, **more: Any
) -> DesignLimits:
    """Limits from the command line's words.

    Args:
        preset: `safe` or `paper`.
        collision: Whether to look at collisions.
        scene: The scene file; None for the one of `base`.
        base: What holds where nothing is given.
        more: Other fields of `DesignLimits`; None where they are not given.

    Raises:
        InputError: An unknown word, a scene that cannot be read, or surroundings that would not be
            looked at.
    """
    blind = preset == "paper" or not collision
    for name, value in (("--scene", scene), ("--floor", more.get("floor"))):
        if blind and value is not None and value not in FLOORS:
            raise InputError(
                "it is looked at only with --limits safe and collisions on",
                where=name,
                value=str(value),
            )
    given: dict[str, Any] = {name: value for name, value in more.items() if value is not None}
    if scene is not None:
        given |= {"scene": load_object(scene).values, "scene_file": str(scene)}
    elif blind:
        given |= {"scene": None, "scene_file": ""}
    return replace(base or DesignLimits(), preset=preset, collision=collision, **given)


def parse_floor(text: str | None) -> float | str | None:
    """Read `--floor`: a height [m], `mount` or `none`.

    Raises:
        InputError: Something else.
    """
    if text is None or text in FLOORS:
        return text
    return _numbers(text, "--floor", (1,), "HEIGHT, mount or none")[0]


def parse_tool(text: str | None) -> tuple[float, ...] | None:
    """Read `--tool`: x, y, z of the tool's point in the flange's frame [m].

    Raises:
        InputError: Other than three numbers.
    """
    return None if text is None else _numbers(text, "--tool", (3,), "X,Y,Z")


def parse_payload(text: str | None) -> tuple[float, ...] | None:
    """Read `--payload`: a mass [kg], or a mass and its centre x, y, z [m].

    Raises:
        InputError: Other than one or four numbers, or a negative mass.
    """
    if text is None:
        return None
    numbers = _numbers(text, "--payload", (1, 4), "KG or KG,X,Y,Z")
    if numbers[0] < 0:
        raise InputError("a negative mass", where="--payload", value=text)
    return numbers if len(numbers) == 4 else (*numbers, 0.0, 0.0, 0.0)


def _numbers(text: str, where: str, counts: tuple[int, ...], form: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in counts or not all(math.isfinite(number) for number in numbers):
        raise InputError("not the numbers that this needs", where=where, value=text, limit=form)
    return numbers


def limits_from_json(fields: JsonFields) -> DesignLimits:
    """The inverse of `DesignLimits.to_json`; what release 0.1 did not know has its default.

    Raises:
        InputError: Missing keys or values of the wrong type.
    """
    preset, collision = fields.text("preset"), fields.get("collision")
    if not isinstance(collision, bool):
        raise InputError("collision must be true or false", value=collision)
    found: dict[str, Any] = {}
    if fields.get("scene") is not None:
        found["scene"] = fields.object("scene").values
    if fields.get("floor") is not None:
        floor = fields.get("floor")
        found["floor"] = floor if isinstance(floor, str) else fields.number("floor")
    for name in ("margin_percent", "clearance"):
        if fields.get(name) is not None:
            found[name] = fields.number(name)
    for name in ("tool", "payload"):
        if fields.get(name) is not None:
            found[name] = tuple(fields.vector(name).tolist())
    scene_file = str(fields.get("scene_file") or "")
    return DesignLimits(preset=preset, collision=collision, scene_file=scene_file, **found)


MATCHES, DIFFERS, ABSENT = "matches", "differs", "absent"
ROBOT = "robot_sha256"
"""Key of a design's settings: the robot as it was designed for."""


def robot_hash(robot: RobotModel) -> str:
    """What a robot is, its collision bodies and limits included; its tool stands by itself."""
    facts = robot_to_json(robot)
    # Where numbers come from may change; twelve digits survive another machine's rounding.
    return content_hash({k: facts[k] for k in facts if k not in ("source", "notes")}, 12)


def digest_of(
    stored: StoredTrajectory, facts: Mapping[str, Any], limits: DesignLimits, robot: str, tool: Tool
) -> dict[str, str]:
    """Hashes of what a certificate is about, one a subject, and of them all.

    They tell that a file was edited, or a robot; whoever forges one can make a digest as well.

    Args:
        stored: The file, or what becomes one.
        facts: Its object `design`.
        limits: Its limits.
        robot: The robot's `robot_hash`.
        tool: What its flange carries.
    """
    held = limits.to_json()
    around = {name: held.pop(name) for name in ("scene", "scene_file", "floor")}
    rest = {name: value for name, value in facts.items() if name not in ("limits", "digest")}
    bounds = {name: value.tolist() for name, value in asdict(stored.limits).items()}
    parts = {
        "motion": content_hash(trajectory_to_json(stored.trajectory)),
        "robot": robot,
        "scene": content_hash(around),
        "tool": content_hash({name: np.ravel(x).tolist() for name, x in asdict(tool).items()}),
        "limits": content_hash([held, bounds]),
        "statements": content_hash(
            [
                rest,
                stored.robot,
                stored.provenance.to_json(),
                {name: value for name, value in stored.extra.items() if name != "design"},
            ]
        ),
        "version": dynid_version(),
    }
    return {**parts, "sha256": content_hash(parts)}


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
    changed: tuple[str, ...] = ()
    """What is not as it was when the motion was certified: keys of the digest."""

    @property
    def digest(self) -> str:
        """`matches`, `differs`, or `absent` for a plain trajectory and designs of release 0.1."""
        if self.changed:
            return DIFFERS
        return MATCHES if "digest" in self.facts else ABSENT

    def describe_digest(self) -> str | None:
        """What is to be said of the digest; None where it matches."""
        if self.digest == MATCHES:
            return None
        if self.digest == ABSENT:
            return "the file has no digest of what it was certified for"
        return f"changed since it was certified: {', '.join(self.changed)}"


def write_design(design: ExcitationDesign, path: str | Path) -> None:
    """Write a design as JSON; it appears whole or not at all.

    Args:
        design: The design.
        path: The file; `read_design`, `dynid check` and `dynid run` take it.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    facts = design.to_json()
    limits = limits_from_json(JsonFields(facts).object("limits"))
    stored = StoredTrajectory(
        trajectory=design.trajectory,
        robot=design.robot,
        limits=copied_bounds(design.limits),
        provenance=design.provenance,
    )
    robot = limits.equipped(load_robot(design.robot, mount=_mount(facts)))
    facts["digest"] = digest_of(
        stored, facts, limits, str(facts["limits"].pop(ROBOT, robot_hash(robot))), robot.tool
    )
    write_trajectory(
        path,
        design.trajectory,
        robot=design.robot,
        limits=design.limits,
        provenance=design.provenance,
        extra={"design": facts},
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
    changed: tuple[str, ...] = ()
    if limits is not None:
        model = limits.equipped(model)
        changed = _changed(stored, facts, limits, model)
    return StoredDesign(stored=stored, robot=model, facts=facts, limits=limits, changed=changed)


def _changed(
    stored: StoredTrajectory, facts: dict[str, Any], limits: DesignLimits, robot: RobotModel
) -> tuple[str, ...]:
    if "digest" not in facts:
        return ()
    before = JsonFields(facts, "design.").object("digest").values
    now = digest_of(stored, facts, limits, robot_hash(robot), robot.tool)
    parts = {name: before.get(name) for name in now if name != "sha256"}
    found = [name for name in parts if parts[name] != now[name]]
    if before.get("sha256") != content_hash(parts) or set(before) != set(now):
        found.append("digest")
    return tuple(found)


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
            "floor": self.limits.floor,
            "digest": self.design.digest,
            "changed": list(self.design.changed),
        }


def check(
    design: str | Path,
    *,
    limits: str = "safe",
    scene: str | Path | None = None,
    collision: bool = True,
    robot: str | Path | None = None,
    mount: str | None = None,
    floor: float | str | None = None,
    tool: tuple[float, ...] | None = None,
    payload: tuple[float, ...] | None = None,
    margin_percent: float | None = None,
    clearance: float | None = None,
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
        floor: Height of the floor [m], `mount` or `none`; this and the next four are the design's
            where they are None.
        tool: (3) the tool's point in the flange's frame [m].
        payload: (4) mass that the flange carries [kg] and its centre [m].
        margin_percent: Of the limits, kept free.
        clearance: Smallest distance of bodies [m].

    Raises:
        InputError: Not a design, a scene that makes no sense, or one that would not be looked at.
    """
    stored = read_design(design, robot=robot, mount=mount)
    held = given_limits(
        limits,
        collision,
        None if scene is None else Path(scene),
        stored.limits,
        floor=floor,
        tool=tool,
        payload=payload,
        margin_percent=margin_percent,
        clearance=clearance,
    )
    certificate = certify(stored.stored.trajectory, held.constraints(stored.robot))
    notes = (*unit_notes(stored.robot), *certificate.notes)
    certificate = replace(certificate, notes=notes)
    return Check(design=stored, limits=held, certificate=certificate)


KINDS = ("csv", "urscript", "ros", *LANGUAGES)


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
        case _ if kind in LANGUAGES:
            text = points_text(design.trajectory, kind, design.limits)
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
