"""Designs as files: a trajectory file with one more object, `design`.

They are checked (`dynid check`), and are the motions that a model is for.
"""

import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from dynid import constraints, core, excitation, signals, trajectory
from dynid.robot import RobotLike, RobotModel, Tool, load_robot, robot_to_json
from dynid.settings import LimitSettings, SceneSettings
from dynid.workflow.design_limits import DesignLimits, given_limits, limits_from_json
from dynid.workflow.identify import PROMISED
from dynid.workflow.recordings import robot_reference

POSE_ACCELERATION = 5.0
"""Between the poses of a task, where the robot knows no limit [rad/s^2 or m/s^2]."""
POSE_RATE_HZ = 25.0
"""At which motions of a task are sampled."""


MATCHES, DIFFERS, ABSENT = "matches", "differs", "absent"
ROBOT = "robot_sha256"
"""Key of a design's settings: the robot as it was designed for."""


def robot_hash(robot: RobotModel) -> str:
    """What a robot is, its collision bodies and limits included; its tool stands by itself."""
    facts = robot_to_json(robot)
    # Where numbers come from may change, and how a path was written; twelve digits survive another
    # machine's rounding.
    told = ("source", "notes", "urdf", "file", "body_notes")
    return core.content_hash({k: facts[k] for k in facts if k not in told}, 12)


def _digest_of(
    stored: trajectory.StoredTrajectory,
    facts: Mapping[str, Any],
    limits: DesignLimits,
    robot: str,
    tool: Tool,
) -> dict[str, str]:
    """Hashes of what a certificate is about, one a subject, and of them all.

    They tell that a file was edited, or a robot; whoever forges one can make a digest as well.
    `facts` is the object `design` of the file, `robot` the robot's `robot_hash`.
    """
    held = limits.to_json()
    unknown = {name: x for name, x in facts["limits"].items() if name not in held}
    around = {name: held.pop(name) for name in ("scene", "scene_file", "floor")}
    # What was found there is part of the robot.
    del held["mesh_dirs"]
    rest = {name: value for name, value in facts.items() if name not in ("limits", "digest")}
    more = {name: value for name, value in stored.extra.items() if name != "design"} | unknown
    bounds = {name: value.tolist() for name, value in asdict(stored.limits).items()}
    parts = {
        "motion": core.content_hash(trajectory.trajectory_to_json(stored.trajectory)),
        "robot": robot,
        "scene": core.content_hash(around),
        "tool": core.content_hash({name: np.ravel(x).tolist() for name, x in asdict(tool).items()}),
        "limits": core.content_hash([held, bounds]),
        "statements": core.content_hash([rest, stored.robot, stored.provenance.to_json(), more]),
        "version": core.dynid_version(),
    }
    return {**parts, "sha256": core.content_hash(parts)}


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredDesign(core.Value):
    """A design, or any trajectory, as its file holds it."""

    stored: trajectory.StoredTrajectory
    """The motion and what it was made for."""
    robot: RobotModel
    """As mounted in the design."""
    facts: dict[str, Any]
    """The object `design`; empty for a plain trajectory."""
    limits: DesignLimits | None
    """What it was designed for; None for a plain trajectory."""
    sha256: str
    """Of the file; empty of a trajectory that was given as an object."""
    expected_percent: float | None = None
    """Torque error that one period is expected to leave [%]; None where the file has none."""
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


DesignLike = (
    excitation.ExcitationDesign
    | StoredDesign
    | trajectory.StoredTrajectory
    | trajectory.Trajectory
    | str
    | Path
)
"""A design, what `read_design` or `read_trajectory` found, or the file of either; a trajectory
beside a robot."""


def open_trajectory(motion: DesignLike) -> trajectory.Trajectory:
    """One period of a motion.

    Args:
        motion: A trajectory, a design, or the file of either.

    Raises:
        InputError: As `read_trajectory`; or no motion.
    """
    if isinstance(motion, str | Path):
        motion = trajectory.read_trajectory(motion)
    elif isinstance(motion, StoredDesign):
        motion = motion.stored
    found = (
        motion if isinstance(motion, trajectory.Trajectory) else getattr(motion, "trajectory", None)
    )
    if not isinstance(found, trajectory.Trajectory):
        raise core.InputError("not a trajectory, a design or its file", value=type(motion).__name__)
    return found


def write_design(
    design: excitation.ExcitationDesign
    | StoredDesign
    | trajectory.StoredTrajectory
    | trajectory.Trajectory,
    path: str | Path,
    *,
    robot: RobotLike | None = None,
) -> None:
    """Write a design as JSON; it appears whole or not at all.

    Args:
        design: The design, or what was read of one, which is written as it was; a trajectory needs
            `robot`.
        path: The file; `read_design`, `dynid check` and `dynid run` take it.
        robot: The robot on its mounting, for one that no file holds; None for the design's.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    if isinstance(design, trajectory.Trajectory):
        design = _beside(design, robot)
    if not isinstance(design, excitation.ExcitationDesign):
        trajectory.write_trajectory(
            design.stored if isinstance(design, StoredDesign) else design, path
        )
        return
    facts = design.to_json()
    limits = limits_from_json(core.JsonFields(facts).object("limits"))
    stored = trajectory.StoredTrajectory(
        trajectory=design.trajectory,
        robot=design.robot,
        limits=design.limits.motion,
        provenance=design.provenance,
    )
    if not isinstance(robot, RobotModel):
        folders = tuple(map(Path, limits.mesh_dirs))
        robot = load_robot(robot or design.robot, mount=_mount(facts), mesh_dirs=folders)
    robot = limits.equipped(robot)
    facts["digest"] = _digest_of(
        stored, facts, limits, str(facts["limits"].pop(ROBOT, robot_hash(robot))), robot.tool
    )
    trajectory.write_trajectory(stored, path, extra={"design": facts})


def _beside(
    motion: trajectory.Trajectory, robot: RobotLike | None, asked: SceneSettings | None = None
) -> StoredDesign:
    """A trajectory, which needs no file form, for a robot beside it."""
    if robot is None:
        raise core.InputError(
            "a trajectory does not say which robot it is for", next_step="Pass --robot ROBOT."
        )
    around = asked or SceneSettings()
    folders = tuple(map(Path, around.mesh_dirs or ()))
    model = load_robot(robot, mount=around.mount, mesh_dirs=folders)
    _check_joints(motion, model, type(motion).__name__)
    stored = trajectory.StoredTrajectory(
        trajectory=motion,
        robot=robot_reference(robot),
        limits=model.limits.motion,
        provenance=core.provenance(),
    )
    return StoredDesign(stored=stored, robot=model, facts={}, limits=None, sha256="")


def read_design(
    path: str | Path,
    *,
    robot: RobotLike | None = None,
    mount: str | None = None,
    mesh_dirs: Sequence[str | Path] | None = None,
) -> StoredDesign:
    """Read a design or a plain trajectory, and its robot.

    Args:
        path: The file.
        robot: The robot, or another name or file of it, where the stored one has moved.
        mount: The mounting; None for the design's.
        mesh_dirs: Folders where meshes of a URDF are looked for; None for the design's.

    Raises:
        InputError: Not a design, or its robot cannot be read or has other joints.
    """
    stored = trajectory.read_trajectory(path)
    facts: dict[str, Any] = {}
    limits, expected = None, None
    with _in_file(path):
        if stored.extra.get("design"):
            facts = dict(core.JsonFields(stored.extra).object("design").values)
            limits = limits_from_json(core.JsonFields(facts, "design.").object("limits"))
            expected = _expected_percent(facts)
    if mesh_dirs is None:
        mesh_dirs = () if limits is None else limits.mesh_dirs
    try:
        model = load_robot(
            stored.robot if robot is None else robot,
            mount=_mount(facts) if mount is None else mount,
            mesh_dirs=tuple(map(Path, mesh_dirs)),
        )
    except core.InputError as error:
        step = f"{error.next_step} Or pass --robot." if error.next_step else "Pass --robot."
        what = f"the robot of the design: {error.what}"
        raise error.changed(what=what, where=str(path), next_step=step) from error
    _check_joints(stored.trajectory, model, path)
    found = StoredDesign(
        stored=stored,
        robot=model,
        facts=facts,
        limits=limits,
        sha256=core.file_hash(Path(path)),
        expected_percent=expected,
    )
    if limits is None:
        return found
    with _in_file(path):
        model = limits.equipped(model)
        return replace(found, robot=model, changed=_changed(stored, facts, limits, model))


def _check_joints(motion: trajectory.Trajectory, robot: RobotModel, path: str | Path) -> None:
    if robot.joints != motion.joints:
        raise core.InputError(
            "the motion is one of another robot",
            where=str(path),
            value=f"{motion.joints} joints",
            limit=f"{robot.joints} of {robot.name}",
        )


def _expected_percent(facts: dict[str, Any]) -> float | None:
    """Of one period: noise averages out with the root of their number."""
    fields = core.JsonFields(facts, "design.")
    if facts.get(PROMISED) is None:
        return None
    percent = fields.number(PROMISED)
    periods = fields.whole("repetitions") if "repetitions" in facts else 1
    if not (percent > 0 and periods > 0):
        raise core.InputError(
            f"design.{PROMISED} and design.repetitions must be positive", value=(percent, periods)
        )
    return percent * math.sqrt(periods)


@contextmanager
def _in_file(path: str | Path) -> Generator[None]:
    """Errors of a design's values name its file."""
    try:
        yield
    except core.InputError as error:
        where = f"{path}, {error.where}" if error.where else str(path)
        raise error.changed(where=where) from error


@contextmanager
def design_file(design: DesignLike, robot: RobotLike | None = None) -> Generator[Path]:
    """The file of a design; one in memory is written to a folder that is removed afterwards.

    The robot is asked for as in `write_design`.
    """
    if isinstance(design, str | Path):
        yield Path(design)
        return
    with TemporaryDirectory(prefix="dynid-") as folder:
        path = Path(folder) / "design.json"
        write_design(design, path, robot=robot)
        yield path


def _changed(
    stored: trajectory.StoredTrajectory,
    facts: dict[str, Any],
    limits: DesignLimits,
    robot: RobotModel,
) -> tuple[str, ...]:
    if "digest" not in facts:
        return ()
    before = core.JsonFields(facts, "design.").object("digest").values
    now = _digest_of(stored, facts, limits, robot_hash(robot), robot.tool)
    parts = {name: before.get(name) for name in now if name != "sha256"}
    found = [name for name in parts if parts[name] != now[name]]
    if before.get("sha256") != core.content_hash(parts) or set(before) != set(now):
        found.append("digest")
    return tuple(found)


def _mount(facts: dict[str, Any]) -> str | None:
    mount = facts.get("mount")
    # `file` says that the robot file gives gravity itself.
    return mount if isinstance(mount, str) and mount != "file" else None


def judge_of(
    design: StoredDesign, asked: SceneSettings
) -> tuple[DesignLimits, constraints.MotionConstraints]:
    """What a design is held to, and the judge of it.

    Limits that were edited in the file, or that no digest confirms, hold where they are stricter
    than the usual ones. Without the scene of the certificate, or one that is asked for, the
    environment is unjudged; also where the file of the scene's name says something else by now.

    Raises:
        InputError: A scene that makes no sense, or one that would not be looked at.
    """
    base, usual = design.limits, DesignLimits()
    moved = base is not None and "scene" in design.changed
    stale = base is not None and _stale(base)
    if base is not None and ("limits" in design.changed or design.digest == ABSENT):
        margin = max(base.margin_percent, usual.margin_percent)
        base = replace(base, margin_percent=margin, clearance=max(base.clearance, usual.clearance))
    if base is not None and moved:
        base = replace(base, floor=usual.floor)
    held = given_limits(asked, base)
    judge = held.constraints(design.robot)
    if (moved or stale) and asked.scene is None and judge.settings.self_collision:
        cause = "the scene was edited since the motion was certified"
        if base is not None and not moved:
            cause = f"{base.scene_file} is not the scene for which the motion was certified"
        lost = constraints.Unjudged(
            kind="environment",
            causes=(cause,),
            next_step='Pass the scene: --scene SCENE.json ({"shapes": []} for an empty one).',
        )
        judge.unjudged = (*judge.unjudged, lost)
    return held, judge


def _stale(limits: DesignLimits) -> bool:
    """Whether there is a file of the scene's name, and it is not what was certified."""
    file = Path(limits.scene_file)
    return (
        limits.scene is not None
        and file.is_file()
        and core.load_object(file).values != limits.scene
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """The verdict on one file."""

    design: StoredDesign
    """What was judged."""
    limits: DesignLimits
    """What it was held to."""
    certificate: constraints.Certificate
    """Remaining margin of each limit, and where it is least."""

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
    design: DesignLike,
    settings: LimitSettings | None = None,
    *,
    robot: RobotLike | None = None,
    **more: Any,
) -> Check:
    """Judge a design from its start to its end, between samples too.

    Args:
        design: A design or its file, any trajectory file, or a trajectory beside `robot`. One of
            a class of your own is judged from its samples alone: nothing is `proven`.
        settings: What it is held to, by default all that is safe, whatever the design was made
            for.
        robot: The robot, or another name or file of it.
        **more: Fields of the settings, such as `limits="paper"`.

    Raises:
        InputError: Not a design, a scene that makes no sense, or one that would not be looked at.
    """
    asked = replace(settings or LimitSettings(), **more)
    if isinstance(design, trajectory.Trajectory):
        stored = _beside(design, robot, asked)
    else:
        with design_file(design, robot) as path:
            stored = read_design(path, robot=robot, mount=asked.mount, mesh_dirs=asked.mesh_dirs)
    held, judge = judge_of(stored, asked)
    found = constraints.certify(stored.stored.trajectory, judge)
    return Check(design=stored, limits=held, certificate=found)


def motions_from(paths: Sequence[str | Path], robot: RobotModel) -> list[trajectory.JointMotion]:
    """The motions of designs or other trajectory files, of recordings, and of lists of poses.

    A JSON object with a list `poses` stands for a way through them at half the arm's speed.

    Raises:
        InputError: A file that is none of these, or one of another robot.
    """
    motions: list[trajectory.JointMotion] = []
    for path in paths:
        if Path(path).suffix.lower() != ".json":
            samples = signals.process(path, robot)
            motions.append(
                trajectory.JointMotion(t=samples.t, q=samples.q, dq=samples.dq, ddq=samples.ddq)
            )
            continue
        fields = core.load_object(path)
        with _in_file(path):
            if "poses" in fields.values:
                poses = fields.matrix("poses")
                motion = trajectory.through_poses(
                    poses, robot.limits, acceleration=POSE_ACCELERATION
                )
            else:
                motion = trajectory.read_trajectory(path).trajectory
        _check_joints(motion, robot, path)
        times = np.arange(0.0, motion.duration, 1 / POSE_RATE_HZ)
        motions.append(motion.evaluate(times))
    return motions
