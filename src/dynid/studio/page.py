"""What the page is told, and what it may ask for; HTTP is elsewhere."""

import contextlib
import json
import threading
import time
from collections.abc import Callable
from io import BufferedIOBase
from pathlib import Path
from typing import IO, Any

import numpy as np

from dynid import excitation, export, recording, robot
from dynid.core import DynidError, InputError, JobError, JsonFields, load_object, printable
from dynid.studio import facts, scene_editing, solids
from dynid.studio.jobs import Job, JobState, Supervisor, TailReader
from dynid.studio.session import Opened, Session, file_in, free_name, kind_of, open_path

FILES = {
    "design": "design.json",
    "run": "record.parquet",
    "identify": "estimate.json",
    "import": "log.parquet",
}
"""What a job's file is called unless its name is typed; numbered where there is one."""
EXPORTS = {"urdf": ".urdf", "mjcf": ".xml", "c": ".h", "python": ".py", "json": ".json"}
"""Formats of models, and how their files end."""
TOLD = ("what", "share", "ask", "word", "stopping", "over", "history")
"""What the page hears of a job's state."""
ROBOT_FILES = (".urdf", ".toml")
_TICK_S = 0.1
_QUIET_S = 0.4
"""A scene that is being dragged about is not judged as a whole."""
_TICK_WHILE_RUNNING_S = 0.2
"""A recording needs the machine more than the page does."""


class Page:
    """What all visitors see and do, beginning with what was opened."""

    def __init__(self, opened: Opened) -> None:
        self._open(opened)
        self._changed = threading.Condition()
        self._following = threading.Lock()
        self._starting = threading.Lock()
        """Held by whoever starts a job or opens another robot: a job is always the page's."""
        self._told, self._version = "", 0
        self._done: Supervisor | None = None
        self._ending: dict[str, Any] = {}
        self._reader: TailReader | None = None
        self._tail: dict[str, Any] | None = None
        self._actions: dict[str, Callable[[JsonFields], dict[str, Any] | None]] = {
            "choose": self._choose,
            "judge": self._judge,
            "add": self._add_shape,
            "place": self._place,
            "resize": self._resize,
            "remove": lambda asked: self.session.editor.remove(asked.whole("number")),
            "save": self._save,
            "design": self._design,
            "run": self._run,
            "identify": self._identify,
            "answer": self._answer,
            "stop": lambda _: self.session.job and self.session.job.stop(),
            "results": lambda _: self._results(None),
            "report": lambda _: self._results(
                self.session.folder / free_name(self.session.folder, "report.html")
            ),
            "export": self._export,
        }

    def _open(self, opened: Opened) -> None:
        session = Session(opened)
        self.notes = [f"{name}: {why}" for name, why in opened.skipped]
        self.meshes = solids.robot_meshes(opened.robot, self.notes)
        # Last: reading meshes takes long, and who asks meanwhile asks for the one before.
        self.session = session
        self._results_known: list[dict[str, Any]] = []
        self._asked_changes = 0
        self._seen_changes, self._quiet_since = -1, 0.0
        self._certifier: threading.Thread | None = None

    def run(self, stop: threading.Event) -> None:
        """Keep the news up to date until `stop` is set."""
        while not stop.is_set():
            busy = self.step(time.monotonic())
            stop.wait(_TICK_WHILE_RUNNING_S if busy else _TICK_S)

    def close(self) -> None:
        """Stop what still runs; a robot comes to rest first."""
        self.session.close()

    def step(self, clock: float) -> bool:
        """Follow the job and tell what is new; whether one runs. The clock is `time.monotonic`."""
        job = self.session.job
        # Whoever comes second need not wait: the first one tells.
        if job is not None and self._following.acquire(blocking=False):
            try:
                if job is not self._done:
                    self._follow(job, job.state, clock)
            finally:
                self._following.release()
        with contextlib.suppress(DynidError):
            # A scene without room is said in the state.
            self.session.judge()
        busy = job is not None and job is not self._done
        self._certify(clock, busy)
        self._tell()
        return busy

    def _certify(self, clock: float, busy: bool) -> None:
        """Judge the motion anew once the scene has been left alone for a while."""
        changes = self.session.editor.changes
        if changes != self._seen_changes:
            self._seen_changes, self._quiet_since = changes, clock
        waits = clock - self._quiet_since < _QUIET_S
        judging = self._certifier is not None and self._certifier.is_alive()
        if busy or waits or judging or not self.session.unjudged:
            return
        # The first certificate compiles for seconds on a new machine: visitors need not wait.
        self._certifier = threading.Thread(target=self.session.certify, daemon=True)
        self._certifier.start()

    def _tell(self) -> None:
        # One thread at a time: a state that was read earlier is never told later.
        with self._changed:
            if json.dumps(self.state()) == self._told:
                return
            self._version += 1
            self._told = json.dumps(self.state())
            self._changed.notify_all()

    def news(self, seen: int, patience: float) -> tuple[str, int]:
        """The state once it is not that of the version `seen`, or nothing after a while [s]."""
        with self._changed:
            self._changed.wait_for(lambda: self._version != seen, patience)
            return ("" if self._version == seen else self._told), self._version

    def look_up(self, what: str, query: Callable[[str], str]) -> dict[str, Any]:
        """Facts: `state`, `robot`, `scene`, or `curves` of the motion that `name` names."""
        session = self.session
        if what == "state":
            self._tell()
            return self.state()
        if what == "robot":
            judge = session.constraints
            carried = () if judge is None else solids.carried_meshes(judge)
            return facts.robot(session.robot, self.meshes, carried) | {"notes": self.notes}
        if what == "scene":
            with session.lock:
                return facts.scene_shapes(session.editor)
        if what == "curves":
            if query("opened") not in ("", str(session.number)):
                return {}
            found = facts.curves(session, query("name"))
            for item in self._results_known:
                if item["record"] == query("name") and "prediction" in item:
                    predicted = item["prediction"]
                    # The torque measured, if it is among the curves, is that of the prediction.
                    others = [one for one in found["groups"] if one["title"] != predicted["title"]]
                    found["groups"] = [predicted, *others]
                    break
            return found
        raise InputError("there are no such facts", value=what)

    def do(self, action: str, asked: JsonFields) -> dict[str, Any]:
        """Do what a visitor asks for, and tell everybody."""
        if action not in self._actions:
            raise InputError("this cannot be done", value=action)
        found = self._actions[action](asked)
        if action != "judge":
            self.step(time.monotonic())
        return found or {}

    def state(self) -> dict[str, Any]:
        """All that changes while the page is open; its version counts what was told."""
        session = self.session
        with session.lock:
            editor = session.editor
            return {
                "version": self._version,
                "opened": session.number,
                "robot": printable(session.robot.name),
                "folder": printable(session.folder.resolve().name),
                "motions": [
                    {"name": name, "design": item.trajectory is not None, "duration": item.duration}
                    for name, item in session.motions.items()
                ],
                "motion": session.motion.name if session.motion.name in session.motions else "",
                "design": session.design,
                "verdict": facts.verdict(session),
                "scene": {
                    "changes": editor.changes,
                    "error": session.scene_error,
                    "file": session.scene_name,
                    "kinds": scene_editing.KINDS,
                },
                "files": {kind: free_name(session.folder, name) for kind, name in FILES.items()},
                "criteria": list(excitation.CRITERIA),
                "estimates": [path.name for path in session.estimates],
                "results": [
                    {key: value for key, value in item.items() if key != "prediction"}
                    for item in self._results_known
                ],
                "job": self._job_state(),
                "tail": self._tail,
            }

    def take_file(self, name: str, stream: BufferedIOBase, length: int) -> dict[str, Any]:
        """Take a file that was dropped onto the page, and open it.

        Robots, designs, estimates and scenes are known by what they hold; all else is a log.
        """
        session = self.session
        session.check_idle()
        suffix = Path(name).suffix.lower()
        path = file_in(session.folder, name, suffix)
        # Two visitors may drop files of one name: who arrives first gets it.
        partial = path.with_name(f"{path.name}.{threading.get_native_id()}.partial")
        try:
            with partial.open("wb") as file:
                _copy(stream, file, length)
            with session.lock:
                path = partial.rename(session.folder / free_name(session.folder, path.name))
        except OSError as error:
            raise JobError(
                "the file cannot be kept", where=path.name, value=error.strerror
            ) from error
        finally:
            partial.unlink(missing_ok=True)
        try:
            words = self._take(path, suffix)
        except DynidError:
            path.unlink(missing_ok=True)
            raise
        self.step(time.monotonic())
        return {"words": words}

    def _take(self, path: Path, suffix: str) -> str:
        session = self.session
        if suffix in ROBOT_FILES:
            opened = open_path(str(path))
            with self._starting:
                # A run may have begun while the file arrived, and STOP has to reach it.
                self.session.check_idle()
                self._open(opened)
            return f"{self.session.robot.name} is shown"
        kind = kind_of(path) if suffix == ".json" else ""
        if kind == "design":
            session.open(path)
            self.session.certify()
            return f"{path.name} is open"
        if kind == "estimate":
            found = facts.judged_estimates(session.folder, None)
            if printable(path.name, 120) not in [item["name"] for item in found]:
                raise InputError("this estimate cannot be evaluated", where=path.name)
            session.estimates.append(path)
            self._results_known = found
            return f"{path.name} is judged"
        if kind == "scene":
            with session.lock:
                given, changes = load_object(path).values, session.editor.changes + 1
                session.editor = scene_editing.SceneEditor(given, changes)
            return f"the scene of {path.name} is taken"
        if suffix == ".parquet":
            with contextlib.suppress(DynidError):
                return f"{session.open(path)} is open"
        name = free_name(session.folder, f"{recording.recording_name(path)}.parquet")
        self._start("import", path, name, {"robot": session.reference})
        return f"{path.name} is read"

    def _start(
        self, kind: str, source: object, name: str, options: dict[str, Any], target: str = "sim"
    ) -> Path:
        """Start a job that makes a file of the studio's folder; where it is."""
        output = file_in(self.session.folder, name, Path(FILES[kind]).suffix)
        job = Job(kind=kind, source=str(source), output=str(output), options=options, target=target)
        with self._starting:
            self.session.start(job)
        return output

    def _choose(self, asked: JsonFields) -> None:
        self.session.choose(asked.text("name"))
        self.session.certify()

    def _judge(self, asked: JsonFields) -> dict[str, Any]:
        """Limits and nearest bodies at a time of the motion, or at a pose that the page shows.

        Nothing for the robot of a page that does not show another one yet.
        """
        session = self.session
        if asked.get("opened") not in (None, session.number):
            return {}
        if asked.get("t") is not None:
            q, dq, ddq = session.motion.at(asked.number("t"))
        else:
            q = asked.vector("q")
            dq = asked.vector("dq") if asked.get("dq") is not None else np.zeros(len(q))
            ddq = np.zeros(len(q))
        return facts.instant_facts(*session.look(q, dq, ddq), facts.sliding_joints(session.robot))

    def _add_shape(self, asked: JsonFields) -> dict[str, Any]:
        with self.session.lock:
            return {"number": self.session.editor.add(asked.text("kind"))}

    def _place(self, asked: JsonFields) -> None:
        session, number = self.session, asked.whole("number")
        with session.lock:
            pose = session.editor.pose(number)
            place, turned = pose[:3, 3], np.degrees(export.roll_pitch_yaw(pose[:3, :3]))
            if asked.get("position") is not None:
                place = asked.vector("position")
            if asked.get("rpy_deg") is not None:
                turned = asked.vector("rpy_deg")
            if len(place) != 3 or len(turned) != 3:
                raise InputError("this is no pose", value=[*map(float, (*place, *turned))])
            pose = robot.from_xyz_rpy(place.tolist(), np.radians(turned).tolist())
            session.editor.place(number, pose)

    def _resize(self, asked: JsonFields) -> None:
        with self.session.lock:
            self.session.editor.resize(
                asked.whole("number"), asked.text("name"), asked.number("value")
            )

    def _save(self, asked: JsonFields) -> dict[str, Any]:
        with self.session.lock:
            self.session.scene_name = self.session.save_scene(asked.text("file")).name
        return {"words": f"saved: {self.session.scene_name}"}

    def _design(self, asked: JsonFields) -> None:
        session = self.session
        session.check_idle()
        options: dict[str, Any] = {
            "criterion": asked.text("criterion"),
            "period_s": asked.number("period_s"),
            "harmonics": None if asked.get("harmonics") is None else asked.whole("harmonics"),
            "budget_s": asked.number("budget_s"),
            "seed": asked.whole("seed"),
            "mount": None if session.robot.mount == "file" else session.robot.mount,
            **session.surroundings_for_jobs(),
        }
        self._start("design", session.reference, asked.text("file"), options)

    def _run(self, asked: JsonFields) -> None:
        session = self.session
        chosen = session.motions.get(session.design)
        if chosen is None:
            raise InputError("choose a design first", value=session.motion.name)
        session.check_idle()
        # What is measured is shown beside what the design expects.
        session.choose(chosen.name)
        session.certify()
        self._asked_changes = session.editor.changes
        options = {
            "repeat": asked.whole("repeat"),
            "slow": 0.2 if asked.get("slow") is True else None,
            **session.surroundings_for_jobs(),
        }
        target = asked.text("target").strip()
        output = self._start("run", chosen.path, asked.text("file"), options, target)
        self._reader, self._tail = TailReader(output), None

    def _identify(self, asked: JsonFields) -> None:
        session = self.session
        chosen = session.motions.get(asked.text("record"))
        if chosen is None or chosen.record is None:
            raise InputError("choose a recording; make one in the step Run, or drop a log here")
        other = session.motions.get(asked.text("validate"))
        options = {
            "preset": asked.text("preset"),
            "robot": session.reference,
            "validate": None if other is None else str(other.path),
        }
        self._start("identify", chosen.path, asked.text("file"), options)

    def _answer(self, asked: JsonFields) -> None:
        session, job = self.session, self.session.job
        if job is None or job.pid != asked.whole("id") or job.state.ask is None:
            raise InputError(
                "what was confirmed is not asked any more: nothing moves",
                next_step="Read what is asked now.",
            )
        if job.job.kind == "run" and session.editor.changes != self._asked_changes:
            job.stop()
            raise InputError(
                "the scene has changed since the run was asked for: nothing moves",
                next_step="Run again.",
            )
        job.answer(asked.text("word").strip())

    def _results(self, output: Path | None) -> dict[str, Any]:
        self.session.check_idle()
        self._results_known = facts.judged_estimates(self.session.folder, output)
        return {"words": "" if output is None else f"written: {output.name}"}

    def _export(self, asked: JsonFields) -> dict[str, Any]:
        session, to = self.session, asked.text("to")
        path = next((p for p in session.estimates if p.name == asked.text("estimate")), None)
        if path is None or to not in EXPORTS:
            raise InputError("choose an estimate and a format", value=to, limit=", ".join(EXPORTS))
        name = free_name(session.folder, f"{path.stem}{EXPORTS[to]}")
        made = export.write_model(path, session.folder / name, to)
        notes = [printable(item.message, 300) for item in made.warnings]
        return {"words": ". ".join([f"written: {name}", *notes])}

    def _follow(self, job: Supervisor, state: JobState, clock: float) -> None:
        record = None if self._reader is None else self._reader.read(clock)
        if record is not None:
            self._tail = facts.tail_facts(record, self.session.robot)
        if not state.ended:
            return
        ending: dict[str, Any] = {
            "words": state.error or "",
            "level": "bad" if state.error else "good",
        }
        if (result := state.result) is not None:
            ending = {"words": result["words"], "level": result["level"]}
            # Its words are told before its file is opened, which may take long.
            self._tell()
            try:
                self._take_result(job.job, result)
            except (DynidError, OSError) as error:
                said = error.line if isinstance(error, DynidError) else str(error)
                ending = {"words": said, "level": "bad"}
        # Told when its result is there: what comes next is asked for at once.
        self._ending, self._reader, self._tail = ending, None, None
        self._done = job

    def _take_result(self, job: Job, result: dict[str, Any]) -> None:
        session = self.session
        if job.kind == "identify":
            session.estimates.append(Path(job.output))
            self._results(None)
            return
        made = result.get("record") if job.kind == "run" else job.output
        if isinstance(made, str):
            session.open(Path(made))
            self.session.certify()

    def _job_state(self) -> dict[str, Any] | None:
        job = self.session.job
        if job is None:
            return None
        state, ended = job.state, job is self._done
        return {
            "id": job.pid,
            "kind": job.job.kind,
            "source": printable(Path(job.job.source).name, 120),
            "made": printable(Path(job.job.output).name, 120),
            "target": printable(job.job.target),
            "repeat": job.job.options.get("repeat", 1),
            **{key: getattr(state, key) for key in TOLD},
            "ended": ended,
            **(self._ending if ended else {}),
        }


def _copy(stream: BufferedIOBase, file: IO[bytes], length: int) -> None:
    while length > 0:
        part = stream.read(min(length, 1 << 20))
        if not part:
            raise InputError("the file did not arrive whole", value=length)
        file.write(part)
        length -= len(part)
