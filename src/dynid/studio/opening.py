"""What `dynid studio PATH` shows: a robot, a design, or all that lies in a directory."""

from collections.abc import Mapping
from dataclasses import dataclass, field
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


@dataclass(frozen=True, slots=True)
class PlayedTrajectory:
    """A trajectory; the certificate is about it."""

    name: str
    trajectory: Trajectory

    @property
    def duration(self) -> float:
        """Its own [s]."""
        return self.trajectory.duration

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations (n) at a time [s]."""
        q, dq, ddq = self.sampled(np.array([np.clip(t, 0.0, self.duration)]))
        return q[0], dq[0], ddq[0]

    def sampled(self, t: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations (N, n) at times (N) [s]."""
        motion = self.trajectory.evaluate(t)
        return motion.q, motion.dq, motion.ddq


class PlayedRecord:
    """What was measured, between the samples in a straight line.

    Velocities are the measured ones where there are any; accelerations are their differences,
    rough as the encoders are.

    Args:
        name: What the page calls it.
        record: The recording, with `q`.
    """

    def __init__(self, name: str, record: ExperimentRecord) -> None:
        self.name, self.record = name, record
        self._t: Array = record.t - record.t[0]
        self._q = record.signals["q"]
        measured = record.signals.get("qd")
        self._dq = np.gradient(self._q, self._t, axis=0) if measured is None else measured
        self._ddq = np.gradient(self._dq, self._t, axis=0)

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self._t[-1])

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations (n) at a time [s]."""
        after = int(np.clip(np.searchsorted(self._t, t), 1, len(self._t) - 1))
        low, high = self._t[after - 1], self._t[after]
        share = float(np.clip((t - low) / (high - low), 0.0, 1.0))
        q, dq, ddq = (
            (1.0 - share) * values[after - 1] + share * values[after]
            for values in (self._q, self._dq, self._ddq)
        )
        return q, dq, ddq


@dataclass(frozen=True, slots=True)
class Held:
    """A pose that somebody holds by hand."""

    q: Array
    """(n) [rad or m]"""
    name: str = REST
    duration: float = 1.0

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """The pose, at rest."""
        rest = np.zeros(len(self.q))
        return self.q, rest, rest


Playable = PlayedTrajectory | PlayedRecord | Held
"""A motion with a name and an end."""
DEFAULT_ROBOT = "ur5"
_LONGEST = 120
"""Characters of a file's name."""
_SCENE_KEYS = frozenset({"shapes", "payload"})


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenMotion:
    """A motion that can be played, and the file it is from."""

    motion: Playable
    path: Path
    design: bool
    """Whether the file can be run and certified; else it is a recording."""
    limits: DesignLimits | None = None
    """What it was designed for."""
    reference: str = DEFAULT_ROBOT
    """Built-in name or path of its robot."""
    robot: RobotModel | None = None
    """The design's, which says how it is mounted."""


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
        return OpenMotion(
            motion=PlayedRecord(name, record),
            path=path,
            design=False,
            reference=robot or record.metadata.robot or DEFAULT_ROBOT,
        )
    found = read_design(path, robot=robot)
    return OpenMotion(
        motion=PlayedTrajectory(name, found.stored.trajectory),
        path=path,
        design=True,
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
        joints = len(item.motion.at(0.0)[0])
        if joints == model.joints:
            kept.append(item)
        else:
            skipped.append((item.path.name, f"{joints} joints, not {model.joints}"))
    held = [item.limits for item in kept if item.limits]
    limits = next((item for item in held if item.scene), held[0] if held else DesignLimits())
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
