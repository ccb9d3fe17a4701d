"""What `dynid studio PATH` shows: a robot, a design, or all that lies in a directory."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, DynidError, InputError, load_object, printable
from dynid.identification import FORMAT
from dynid.recording import ExperimentRecord, read_record
from dynid.robot import RobotModel, load_robot
from dynid.trajectory import Trajectory
from dynid.workflow import DesignLimits, read_design

REST = "nothing moves"
"""Name of the motion that is none."""


DEFAULT_ROBOT = "ur5"
_LONGEST = 120
"""Characters of a file's name."""
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
        return _files(found, given, robot, strict=False)
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
    name = printable(path.name, _LONGEST)
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
            elif kind == "scene" and scene is None:
                scene, scene_file = load_object(path).values, str(path)
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
            skipped.append((path.name, str(error)))
    if model is None:
        reference = robot or DEFAULT_ROBOT
        model = load_robot(reference)
    kept: list[OpenMotion] = []
    for item in motions:
        joints = len(item.at(0.0)[0])
        if joints == model.joints:
            kept.append(item)
        else:
            skipped.append((item.path.name, f"{joints} joints, not {model.joints}"))
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
