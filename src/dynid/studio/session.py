"""What `dynid studio PATH` shows, and what its visitors share, without the page.

A robot, a design, or all that lies in a directory; motions, scene, limits, one job at a time.
"""

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dynid.constraints import Certificate, MotionConstraints, Worst, certify
from dynid.core import Array, DynidError, InputError, load_object, printable
from dynid.identification import FORMAT
from dynid.recording import ExperimentRecord, read_record
from dynid.robot import RobotModel, builtin_names, load_robot
from dynid.studio.jobs import Job, Supervisor
from dynid.studio.scene_editing import Near, SceneEditor, instant
from dynid.trajectory import Trajectory
from dynid.workflow import DesignLimits, read_design, truth_path

REST = "nothing moves"
"""Name of the motion that is none."""


DEFAULT_ROBOT = "ur5"
LONGEST = 120
"""Characters of a file's name."""
LOGS = (".csv", ".xlsx", ".mat", ".mcap", ".db3", ".bag")
"""Endings of recordings that must be imported before they can be shown."""
_SCENE_KEYS = frozenset({"shapes", "payload"})


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenMotion:
    """A motion that can be played, and the file it is from."""

    name: str
    duration: float
    """From its start to its end [s]."""
    at: Callable[[float], tuple[Array, Array, Array]]
    """Positions, velocities and accelerations (n) at a time [s]."""
    path: Path = Path()
    trajectory: Trajectory | None = None
    """Of a design: it can be run and certified."""
    record: ExperimentRecord | None = None
    """Of a recording."""
    limits: DesignLimits | None = None
    """What it was designed for."""
    reference: str = DEFAULT_ROBOT
    """Built-in name or path of its robot."""
    robot: RobotModel | None = None
    """The design's, which says how it is mounted."""


def held(q: Array) -> OpenMotion:
    """A pose (n) that somebody holds by hand."""
    rest = np.zeros(len(q))
    return OpenMotion(name=REST, duration=1.0, at=lambda _: (q, rest, rest))


def _played(trajectory: Trajectory, t: float) -> tuple[Array, Array, Array]:
    motion = trajectory.evaluate(np.array([np.clip(t, 0.0, trajectory.duration)]))
    return motion.q[0], motion.dq[0], motion.ddq[0]


def recorded(
    name: str, record: ExperimentRecord, path: Path = Path(), reference: str = DEFAULT_ROBOT
) -> OpenMotion:
    """What was measured, between the samples in a straight line.

    Velocities are the measured ones where there are any; accelerations are their differences,
    rough as the encoders are.
    """
    t: Array = record.t - record.t[0]
    q = record.signals["q"]
    measured = record.signals.get("qd")
    dq = np.gradient(q, t, axis=0) if measured is None else measured
    rows = np.stack([q, dq, np.gradient(dq, t, axis=0)])

    def at(now: float) -> tuple[Array, Array, Array]:
        after = int(np.clip(np.searchsorted(t, now), 1, len(t) - 1))
        share = np.clip((now - t[after - 1]) / (t[after] - t[after - 1]), 0.0, 1.0)
        here = (1.0 - share) * rows[:, after - 1] + share * rows[:, after]
        return here[0], here[1], here[2]

    duration = float(t[-1])
    return OpenMotion(
        name=name, duration=duration, at=at, path=path, record=record, reference=reference
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Opened:
    """What the studio starts with."""

    robot: RobotModel
    reference: str
    """Built-in name or path of the robot."""
    folder: Path
    """Where the studio reads and writes."""
    motions: tuple[OpenMotion, ...] = ()
    estimates: tuple[Path, ...] = ()
    scene: Mapping[str, Any] | None = None
    """What stands around the robot: the design's, or the scene file's."""
    scene_file: str = ""
    limits: DesignLimits = field(default_factory=DesignLimits)
    """The first design's, with its floor, tool and margins."""
    skipped: tuple[tuple[str, str], ...] = field(default=())
    """Files that could not be used, and why."""


def open_path(path: str | None, *, robot: str | None = None) -> Opened:
    """Open a robot (name or file), a design, a recording or a directory; None: the current one.

    Raises:
        InputError: Nothing that can be shown is there.
    """
    given = Path(path) if path is not None else Path()
    if given.is_dir():
        found = sorted(given.glob("*.json")) + sorted(given.glob("*.parquet"))
        opened = _files(found, given, robot, strict=False)
        logs = sorted(path for path in given.iterdir() if path.suffix.lower() in LOGS)
        told = ((path.name, "a log: drop it onto the page to import it") for path in logs)
        return replace(opened, skipped=(*opened.skipped, *told))
    if given.is_file() and given.suffix.lower() in (".json", ".parquet"):
        return _files([given], given.parent, robot, strict=True)
    name = str(path)
    return Opened(
        robot=load_robot(name),
        reference=str(Path(name).resolve()) if given.is_file() else name,
        folder=given.parent if given.is_file() else Path(),
    )


def open_motion(path: Path, robot: str | None = None) -> OpenMotion:
    """A design or a recording as a motion to play.

    Raises:
        InputError: It is neither.
    """
    name = printable(path.name, LONGEST)
    if path.suffix.lower() == ".parquet":
        record = read_record(path)
        return recorded(name, record, path, robot or record.metadata.robot or DEFAULT_ROBOT)
    found = read_design(path, robot=robot)
    trajectory = found.stored.trajectory
    return OpenMotion(
        name=name,
        duration=trajectory.duration,
        at=partial(_played, trajectory),
        path=path,
        trajectory=trajectory,
        limits=found.limits,
        reference=robot or found.stored.robot,
        robot=found.robot,
    )


def kind_of(path: Path) -> str:
    """What a JSON file holds: `design`, `estimate`, `scene`, or nothing of ours."""
    try:
        fields = load_object(path).values
    except InputError:
        return ""
    if fields.get("format") == FORMAT:
        return "estimate"
    if str(fields.get("kind", "")).startswith("dynid."):
        return "design"
    return "scene" if fields and set(fields) <= _SCENE_KEYS else ""


def _files(paths: list[Path], folder: Path, robot: str | None, *, strict: bool) -> Opened:
    motions: list[OpenMotion] = []
    estimates: list[Path] = []
    skipped: list[tuple[str, str]] = []
    scene: Mapping[str, Any] | None = None
    scene_file = ""
    model, reference = None, robot or ""
    for path in paths:
        kind = "recording" if path.suffix.lower() == ".parquet" else kind_of(path)
        try:
            if kind == "estimate":
                estimates.append(path)
            elif kind == "scene":
                if path.name == JOB_SCENE and not strict:
                    continue
                if scene is not None:
                    skipped.append((path.name, f"the scene is that of {Path(scene_file).name}"))
                else:
                    scene = SceneEditor(load_object(path).values).to_json()
                    scene_file = str(path)
            elif kind in ("design", "recording"):
                opened = open_motion(path, robot)
                if model is None:
                    reference = opened.reference
                    model = opened.robot or load_robot(reference)
                motions.append(opened)
            elif strict:
                raise InputError("neither a design nor a recording", where=str(path))
        except DynidError as error:
            if strict:
                raise
            skipped.append((path.name, error.line))
    if model is None:
        reference = robot or DEFAULT_ROBOT
        model = load_robot(reference)
    kept: list[OpenMotion] = []
    for item in motions:
        if reason := _of_another(item, model, reference):
            skipped.append((item.path.name, reason))
        else:
            kept.append(item)
    known = [item.limits for item in kept if item.limits]
    limits = next((item for item in known if item.scene), known[0] if known else DesignLimits())
    if scene is None:
        scene, scene_file = limits.scene, limits.scene_file
    return Opened(
        robot=model,
        reference=reference,
        folder=folder,
        motions=tuple(kept),
        estimates=tuple(estimates),
        scene=scene,
        scene_file=scene_file,
        limits=limits,
        skipped=tuple(skipped),
    )


def _of_another(motion: OpenMotion, robot: RobotModel, reference: str) -> str:
    """Why a motion is not one of this robot; nothing if it may be."""
    joints, known = len(motion.at(0.0)[0]), builtin_names()
    if joints != robot.joints:
        return f"{joints} joints, not {robot.joints}"
    # Files of robots have any names, and may have moved.
    others = motion.reference != reference and {motion.reference, reference} <= set(known)
    return f"of {motion.reference}, not {reference}" if others else ""


def file_in(folder: Path, name: str, suffix: str) -> Path:
    """A file in the studio's folder: a name typed into a page chooses no other place.

    Raises:
        InputError: More than a name, or another ending than the suffix.
    """
    odd = not name or name.startswith(".") or any(not c.isprintable() or c in "/\\" for c in name)
    if odd or len(name) > LONGEST or Path(name).suffix.lower() != suffix:
        raise InputError(
            "a file name without a directory is needed", value=name, limit=f"*{suffix}"
        )
    return folder / name


def free_name(folder: Path, name: str) -> str:
    """A name that no file of the folder has, nor the truth beside a simulated recording.

    After `design.json` comes `design_2.json`.
    """
    wished, free, count = Path(name), name, 1
    while (folder / free).exists() or truth_path(folder / free).exists():
        count += 1
        free = f"{wished.stem}_{count}{wished.suffix}"
    return free


SCENE_FILE = "scene.json"
JOB_SCENE = "studio_scene.json"
"""Where designs and runs find the scene of the page."""


@dataclass(frozen=True, slots=True)
class ShownVerdict:
    """The certificate of a motion in a scene."""

    certificate: Certificate | None = None
    error: str = ""
    motion: str = ""
    changes: int = 0
    """How often the scene had been changed."""


class Session:
    """All that several visitors of the page share, beginning with what was opened.

    Raises:
        InputError: A scene that is none.
    """

    def __init__(self, opened: Opened) -> None:
        self.robot, self.reference, self.folder = opened.robot, opened.reference, opened.folder
        self.number = time.monotonic_ns() // 1000
        """Tells it from those before it; JavaScript has 53 bits for that."""
        self.estimates = list(opened.estimates)
        self.motions: dict[str, OpenMotion] = {item.name: item for item in opened.motions}
        self.lock = threading.RLock()
        """Held by whoever reads or changes more than one thing."""
        self.editor = SceneEditor(opened.scene)
        given = Path(opened.scene_file).name
        self.scene_name = given if given and given.isprintable() else SCENE_FILE
        self.scene_error = ""
        self.limits = opened.limits
        self.constraints: MotionConstraints | None = None
        self.verdict = ShownVerdict()
        self._certifying = threading.Lock()
        self.job: Supervisor | None = None
        self.motion = held(_middle(opened))
        self.design = ""
        """Name of the design that is run next."""
        self._judged = -1
        self.judge()
        if self.motions:
            self.choose(next(iter(self.motions)))

    def judge(self) -> None:
        """Take the scene as it is now; what is wrong with it is in `scene_error`."""
        with self.lock:
            if self._judged == self.editor.changes and self.constraints is not None:
                return
            self._judged, self.scene_error = self.editor.changes, ""
            # What a design was held to is not what holds here: all that is safe does.
            alone = replace(self.limits, preset="safe", collision=True, scene=None)
            try:
                around = replace(alone, scene=self.editor.to_json())
                self.constraints = around.constraints(self.robot)
            except InputError as error:
                self.scene_error = error.line
                # The page shows a robot that cannot even be judged alone.
                self.constraints = None
                with suppress(InputError):
                    self.constraints = alone.constraints(self.robot)

    def surroundings_for_jobs(self) -> dict[str, Any]:
        """Options of a job for the scene, as a file unless it is empty, the floor and the tool."""
        with self.lock:
            document, limits = self.editor.to_json(), self.limits
            there = bool(document["shapes"]) or "payload" in document or self.editor.changes > 0
            # Not the person's own file: an edit on the page is kept there only when asked to.
            scene = str(self.save_scene(JOB_SCENE)) if there else None
        around = {"floor": limits.floor, "tool": limits.tool, "payload": limits.payload}
        return {"scene": scene, **around}

    def choose(self, name: str) -> None:
        """Show another motion; no name holds a pose."""
        with self.lock:
            self.motion = self.motion_named(name) if name else held(self.motion.at(0.0)[0])
            # A recording is shown in place of its design, which can be run again.
            if self.motion.record is None:
                self.design = name

    def motion_named(self, name: str) -> OpenMotion:
        """A motion by its name."""
        if name not in self.motions:
            raise InputError("no such motion", value=name)
        return self.motions[name]

    def open(self, path: Path) -> str:
        """Open a file that a job has made, and choose it; its name."""
        found = open_motion(path)
        if reason := _of_another(found, self.robot, self.reference):
            raise InputError("this is of another robot", where=path.name, value=reason)
        with self.lock:
            self.motions[found.name] = found
            self.choose(found.name)
        return found.name

    def look(self, q: Array, dq: Array, ddq: Array) -> tuple[dict[str, Worst], list[Near]]:
        """The limits and the nearest bodies at a pose (n), speed and acceleration."""
        for values in (q, dq, ddq):
            if values.shape != (self.robot.joints,) or not np.isfinite(values).all():
                raise InputError("this is no pose of the robot", limit=self.robot.joints)
        if self.constraints is None:
            return {}, []
        return instant(self.constraints, q, dq, ddq)

    def certify(self) -> ShownVerdict:
        """Judge the whole motion in the scene, if it is a design's; the verdict is kept."""
        # One after the other: the last verdict is that of what was chosen last.
        with self._certifying:
            with self.lock:
                motion, constraints, changes = self.motion, self.constraints, self.editor.changes
            if motion.trajectory is None or not self.unjudged:
                return self.verdict
            certificate, said = None, ""
            try:
                if constraints is None or self.scene_error:
                    raise InputError(self.scene_error or "the robot's limits contradict each other")
                certificate = certify(motion.trajectory, constraints)
            except DynidError as error:
                said = error.line
            self.verdict = ShownVerdict(certificate, said, motion.name, changes)
            return self.verdict

    @property
    def unjudged(self) -> bool:
        """Whether the motion is a design's that has no verdict in the scene as it is."""
        return self.motion.trajectory is not None and (
            self.stale or self.verdict.motion != self.motion.name
        )

    @property
    def stale(self) -> bool:
        """Whether the scene has changed since the verdict."""
        return self.verdict.changes != self.editor.changes

    def save_scene(self, name: str) -> Path:
        """Write the scene into the studio's folder; where it is."""
        path = file_in(self.folder, name, ".json")
        if path.exists() and kind_of(path) != "scene":
            raise InputError(
                "the file is no scene, and nothing else is replaced",
                where=path.name,
                next_step="Name another file.",
            )
        with self.lock:
            self.judge()
            if self.scene_error:
                raise InputError(self.scene_error)
            self.editor.save(path)
        return path

    def start(self, job: Job) -> None:
        """Start a job, unless another one is still there or a file where its result goes."""
        with self.lock:
            self.check_idle()
            if Path(job.output).exists():
                raise InputError(
                    "the file exists, and nothing is replaced",
                    where=Path(job.output).name,
                    next_step="Name another file.",
                )
            self.job = Supervisor(job)

    def check_idle(self) -> None:
        """Refuse what cannot be done beside a job."""
        if self.job is not None and not self.job.state.ended:
            raise InputError("another job is still running", value=self.job.job.kind)

    def close(self) -> None:
        """Stop what still runs; a robot comes to rest first."""
        if self.job is not None:
            self.job.close()


def _middle(opened: Opened) -> Array:
    """A pose in the middle of the limits, 0 where they are not finite; a UR stands upright."""
    limits = opened.robot.limits
    middle = (limits.lower + limits.upper) / 2
    pose = np.where(np.isfinite(middle), middle, 0.0)
    if opened.robot.name.startswith("ur") and len(pose) == 6 and not pose.any():
        pose[1] = pose[3] = -np.pi / 2
    return pose
