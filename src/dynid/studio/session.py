"""What the page is about, without the page: robot, motions, scene, limits, one job at a time.

Files that the page may write.

Play, pause, scrub: where a motion is at a time of the clock.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid.constraints import Certificate, MotionConstraints, Scene, certify, safe_constraints
from dynid.core import Array, DynidError, InputError
from dynid.studio.jobs import Job, Supervisor
from dynid.studio.live import Instant, at_rest, instant
from dynid.studio.opening import (
    REST,
    Held,
    Opened,
    OpenMotion,
    Playable,
    PlayedTrajectory,
    open_motion,
)
from dynid.studio.scene_editing import SceneEditor

LONGEST = 120


def file_in(folder: Path, name: str, suffix: str) -> Path:
    """A file in the studio's folder: a name typed into a page chooses no other place.

    Args:
        folder: The studio's folder.
        name: What was typed.
        suffix: What the name must end in.

    Raises:
        InputError: More than a name, or another ending.
    """
    odd = name.startswith(".") or any(not c.isprintable() or c in "/\\" for c in name)
    if odd or len(name) > LONGEST or Path(name).suffix.lower() != suffix:
        raise InputError(
            "a file name without a directory is needed", value=name, limit=f"*{suffix}"
        )
    return folder / name


def free_name(folder: Path, name: str) -> str:
    """A name that no file of the folder has: what is there is overwritten only when typed.

    Args:
        folder: The studio's folder.
        name: What is wished, such as `design.json`; `design_2.json` comes after it.
    """
    wished, free, count = Path(name), name, 1
    while (folder / free).exists():
        count += 1
        free = f"{wished.stem}_{count}{wished.suffix}"
    return free


SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""What the page offers, as shares of real time."""


@dataclass(slots=True)
class Player:
    """A place in a motion that moves with the clock while it plays.

    Every method that depends on the clock is told its time [s], so that tests need none.

    Raises:
        InputError: A duration that is not positive.
    """

    duration: float
    """Of the motion [s]."""
    loop: bool = True
    """Whether the end is followed by the start."""
    speed: float = 1.0
    """Seconds of the motion a second of the clock."""
    playing: bool = False
    _place: float = 0.0
    _since: float = 0.0

    def __post_init__(self) -> None:
        if not self.duration > 0:
            raise InputError("a motion to play needs a duration", value=self.duration)

    def place(self, now: float) -> float:
        """Where the motion is [s]."""
        if not self.playing:
            return self._place
        raw = self._place + (now - self._since) * self.speed
        return raw % self.duration if self.loop else min(raw, self.duration)

    def play(self, now: float) -> None:
        """Go on from here; from the start where the end was reached."""
        if self.playing:
            return
        if self._place >= self.duration:
            self._place = 0.0
        self.playing, self._since = True, now

    def pause(self, now: float) -> None:
        """Stay here."""
        self._place, self.playing = self.place(now), False

    def seek(self, place: float, now: float) -> None:
        """Go to a place, kept within the motion; playing goes on from there."""
        self._place, self._since = min(max(place, 0.0), self.duration), now

    def set_speed(self, speed: float, now: float) -> None:
        """Change the speed without a jump.

        Raises:
            InputError: A speed that is not positive.
        """
        if not speed > 0:
            raise InputError("the speed must be positive", value=speed)
        self._place, self._since = self.place(now), now
        self.speed = speed

    def settle(self, now: float) -> bool:
        """Stop at the end of a motion that does not repeat; whether it did just now."""
        if self.playing and not self.loop and self.place(now) >= self.duration:
            self.pause(now)
            return True
        return False


SCENE_FILE = "scene.json"
JOB_SCENE = "studio_scene.json"
"""Where designs and runs find the scene of the page."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownVerdict:
    """The certificate of a motion in a scene."""

    certificate: Certificate | None = None
    error: str = ""
    motion: str = ""
    changes: int = 0
    """How often the scene had been changed."""


class Session:
    """All that several visitors of the page share.

    Args:
        opened: What the studio starts with.

    Raises:
        InputError: A scene that is none.
    """

    def __init__(self, opened: Opened) -> None:
        self.robot, self.reference, self.folder = opened.robot, opened.reference, opened.folder
        self.estimates = list(opened.estimates)
        self.motions: dict[str, OpenMotion] = {item.motion.name: item for item in opened.motions}
        self.lock = threading.RLock()
        """Held by whoever reads or changes more than one thing."""
        self.editor = SceneEditor(opened.scene)
        given = Path(opened.scene_file).name
        self.scene_name = given if given and given.isprintable() else SCENE_FILE
        self.scene_error = ""
        self.limits = opened.limits
        self.constraints: MotionConstraints | None = None
        self.verdict = ShownVerdict()
        self.job: Supervisor | None = None
        self.motion: Playable = Held(_middle(opened))
        self.player = Player(1.0)
        self._live: tuple[Array, Array] | None = None
        self._judged = -1
        self.judge()
        if self.motions:
            self.choose(next(iter(self.motions)))

    def judge(self) -> None:
        """Take the scene as it is now; what is wrong with it is in `scene_error`."""
        with self.lock:
            if self._judged == self.editor.changes and self.constraints is not None:
                return
            self._judged = self.editor.changes
            try:
                self.constraints = self._judge(self.editor.scene())
                self.scene_error = ""
            except InputError as error:
                self.scene_error = str(error)
                try:
                    self.constraints = self._judge(None)
                except InputError:
                    # Not even the robot alone can be judged; the page still shows it.
                    self.constraints = None

    def _judge(self, scene: Scene | None) -> MotionConstraints:
        held = self.limits
        return safe_constraints(
            held.equipped(self.robot),
            scene,
            clearance=held.clearance,
            margin=held.margin_percent / 100.0,
            floor=held.floor,
        )

    def surroundings_for_jobs(self) -> dict[str, Any]:
        """Options of a job for the scene, the floor and the tool.

        Raises:
            InputError: A scene without room.
        """
        held = self.limits
        return {
            "scene": self.scene_for_jobs(),
            "floor": held.floor,
            "tool": held.tool,
            "payload": held.payload,
        }

    def choose(self, name: str) -> None:
        """Play another motion, from its start, paused.

        Raises:
            InputError: There is no such motion.
        """
        with self.lock:
            if name == REST:
                self.motion = Held(self.now().q)
            elif name in self.motions:
                self.motion = self.motions[name].motion
            else:
                raise InputError("no such motion", value=name)
            old = self.player
            self.player = Player(self.motion.duration, loop=old.loop, speed=old.speed)

    def open(self, path: Path) -> str:
        """Open a file that a job has made, and choose it; its name."""
        found = open_motion(path)
        with self.lock:
            self.motions[found.motion.name] = found
            self.choose(found.motion.name)
        return found.motion.name

    def hold(self, q: Array) -> None:
        """Hold a pose (n) by hand [rad or m]."""
        with self.lock:
            self.motion = Held(np.asarray(q, dtype=np.float64))
            self.player = Player(1.0, loop=self.player.loop, speed=self.player.speed)

    def follow(self, q: Array | None, dq: Array | None = None) -> None:
        """Show where a running robot is, and how fast (n); None to show the motion again."""
        with self.lock:
            self._live = None if q is None else (q, np.zeros(len(q)) if dq is None else dq)

    @property
    def following(self) -> bool:
        """Whether a running robot is shown."""
        return self._live is not None

    def now(self, clock: float | None = None) -> Now:
        """Where the shown motion is.

        Args:
            clock: The time [s]; None for that of `time.monotonic`.
        """
        at = time.monotonic() if clock is None else clock
        with self.lock:
            place = self.player.place(at)
            if self._live is not None:
                live, speed = self._live
                return Now(place=place, q=live, dq=speed, ddq=np.zeros(len(live)))
            q, dq, ddq = self.motion.at(place)
        return Now(place=place, q=q, dq=dq, ddq=ddq)

    def look(self, now: Now) -> Instant:
        """The limits and the nearest bodies now."""
        constraints = self.constraints
        if constraints is None:
            return at_rest(self.robot, now.q)
        return instant(constraints, now.q, now.dq, now.ddq)

    def certify(self) -> ShownVerdict:
        """Judge the whole motion in the scene; the verdict is kept."""
        with self.lock:
            motion, constraints, changes = self.motion, self.constraints, self.editor.changes
        try:
            if not isinstance(motion, PlayedTrajectory):
                raise InputError("only a design can be certified", value=motion.name)
            if constraints is None or self.scene_error:
                raise InputError(self.scene_error or "the robot's limits contradict each other")
            found = ShownVerdict(
                certificate=certify(motion.trajectory, constraints),
                motion=motion.name,
                changes=changes,
            )
        except DynidError as error:
            found = ShownVerdict(error=str(error), motion=motion.name, changes=changes)
        self.verdict = found
        return found

    @property
    def certifiable(self) -> bool:
        """Whether a design is shown."""
        return isinstance(self.motion, PlayedTrajectory)

    @property
    def stale(self) -> bool:
        """Whether the scene has changed since the verdict."""
        return self.verdict.changes != self.editor.changes

    def save_scene(self, name: str) -> Path:
        """Write the scene into the studio's folder; where it is.

        Raises:
            DynidError: No name for a file, a scene without room, or it cannot be written.
        """
        path = file_in(self.folder, name, ".json")
        with self.lock:
            self.judge()
            if self.scene_error:
                raise InputError(self.scene_error)
            self.editor.save(path)
            self.scene_name = name
        return path

    def scene_for_jobs(self) -> str | None:
        """The scene as a file for a job; None where the page's scene is an empty one."""
        with self.lock:
            document = self.editor.to_json()
            if not document["shapes"] and "payload" not in document and not self.editor.changes:
                return None
            self.judge()
            if self.scene_error:
                raise InputError(self.scene_error)
            # Not the person's own file: an edit on the page is kept there only when asked to.
            path = self.folder / JOB_SCENE
            self.editor.save(path)
            return str(path)

    def start(self, job: Job) -> Supervisor:
        """Start a job.

        Raises:
            InputError: Another one is still there.
            JobError: It cannot be started.
        """
        with self.lock:
            if self.job is not None and not self.job.state.ended:
                raise InputError("another job is still running", value=self.job.job.kind)
            self.job = Supervisor(job)
            return self.job

    def close(self) -> None:
        """Stop what still runs; a robot comes to rest first."""
        if self.job is not None:
            self.job.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class Now:
    """Where a motion is."""

    place: float
    """[s]"""
    q: Array
    """(n) [rad or m]"""
    dq: Array
    """(n)"""
    ddq: Array
    """(n)"""


def _middle(opened: Opened) -> Array:
    """A pose in the middle of the limits, 0 where they are not finite; a UR stands upright."""
    limits = opened.robot.limits
    middle = (limits.lower + limits.upper) / 2
    pose = np.where(np.isfinite(middle), middle, 0.0)
    if opened.robot.name.startswith("ur") and len(pose) == 6 and not pose.any():
        pose[1] = pose[3] = -np.pi / 2
    return pose
