"""Long jobs as values, the process of each, and the lines in which it talks with the page.

A job's process reads its job from the first line of its stdin. What it has to say goes to its
stdout, one JSON object a line: what changes of `JobState`, or the `criterion` of a search. Further
lines on its stdin are `answer` and `stop`; the end of its stdin is a stop too, so that no robot
goes on moving for a page that is gone. A page that draws, or hangs, takes no time from a recording.

The page reads the file that a crash would leave behind, so the recorder neither knows of the page
nor waits for it.
"""

from __future__ import annotations

import json
import math
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from dynid.core import DynidError, InputError, JobError, RecordError
from dynid.recording import ExperimentRecord, partial_path, recover

if TYPE_CHECKING:
    from dynid.excitation import HistoryEntry


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What another process shall do."""

    kind: str
    """`design`, `run`, `identify` or `import`."""
    source: str
    """What it starts from: the robot, the design, or the recording."""
    output: str
    """The file it makes."""
    options: dict[str, Any]
    """Keyword arguments of the settings."""
    target: str = "sim"
    """What moves: `sim` or `ur://HOST`."""


def line(message: dict[str, Any]) -> str:
    """A message as a line."""
    return json.dumps(message) + "\n"


LEVELS = {"usable": "good", "care": "warn", "do_not_use": "bad"}
"""Levels of verdicts as the page colours them."""
_CHILD = "import sys; from dynid.studio.jobs import main; sys.exit(main())"
_LAST = 4_000
"""Characters of a dead process's stderr that are looked at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobState:
    """What is known of a job."""

    what: str = "starting"
    """What it is doing, in its own words."""
    share: float = 0.0
    """How far it is, 0 to 1."""
    ask: str | None = None
    """What it wants to be confirmed before anything moves."""
    word: str = ""
    """The word that agrees to it."""
    stopping: bool = False
    """Whether it was told to stop."""
    result: dict[str, Any] | None = None
    error: str | None = None
    ended: bool = False
    """Whether its process is gone."""
    history: tuple[tuple[float, float], ...] = ()
    """Seconds since the start, and the criterion of the best motion of a search."""

    @property
    def over(self) -> bool:
        """Whether all is done but the end of its process."""
        return self.result is not None or self.error is not None


class Supervisor:
    """One job in a process of its own.

    Raises:
        JobError: The process cannot be started.
    """

    def __init__(self, job: Job) -> None:
        self.job = job
        self._state = JobState()
        self._lock = threading.Lock()
        self._began = time.monotonic()
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115
        try:
            # A session of its own: Ctrl-C in the terminal of the studio reaches the job only
            # through `stop`, once.
            self._process = subprocess.Popen(
                [sys.executable, "-c", _CHILD],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                text=True,
                encoding="utf-8",
                start_new_session=True,
            )
        except OSError as error:
            self._errors.close()
            raise JobError("the job's process cannot be started", value=error.strerror) from error
        self._send(line(asdict(job)))
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def state(self) -> JobState:
        """What is known now."""
        with self._lock:
            return self._state

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def answer(self, word: str) -> None:
        """Answer what it asked."""
        self._change(ask=None)
        self._send(line({"answer": word}))

    def stop(self) -> None:
        """Tell it to stop: a robot comes to rest, a search keeps its best motion."""
        if self.state.ended or self.state.stopping:
            return
        self._change(stopping=True, ask=None)
        self._send(line({"stop": True}))

    def wait(self, timeout: float | None = None) -> JobState:
        """Wait for the end of the process, at most `timeout` [s]."""
        self._reader.join(timeout)
        return self.state

    def close(self, patience: float = 10.0) -> None:
        """Stop it; a process that does not end in time [s] is interrupted again, then killed."""
        self.stop()
        for number in (signal.SIGINT, signal.SIGKILL):
            if self.wait(patience).ended:
                return
            self._process.send_signal(number)
        self.wait(patience)

    def _read(self) -> None:
        stream = self._process.stdout
        for text in stream or ():
            try:
                message = json.loads(text)
            except ValueError:
                # Half a line of a process that was killed.
                continue
            if "criterion" in message:
                now = time.monotonic() - self._began
                message = {"history": (*self.state.history, (now, message["criterion"]))}
            self._change(**message)
        code = self._process.wait()
        for end in (self._process.stdin, stream):
            # There may be a line that it did not read.
            with suppress(BrokenPipeError):
                if end is not None:
                    end.close()
        state = self.state
        if state.result is None and state.error is None:
            self._change(error=f"its process ended with code {code}: {self._last_words()}")
        self._errors.close()
        self._change(ended=True, ask=None)

    def _change(self, **values: Any) -> None:
        with self._lock:
            self._state = replace(self._state, **values)

    def _send(self, text: str) -> None:
        stream = self._process.stdin
        # Where it has ended already, the reader finds out why.
        with suppress(BrokenPipeError, ValueError):
            if stream is not None:
                stream.write(text)
                stream.flush()

    def _last_words(self) -> str:
        self._errors.seek(0)
        lines = self._errors.read()[-_LAST:].strip().splitlines()
        return lines[-1] if lines else "no message"


_EVERY_S = 0.3
_BUSY = 20.0
"""Reading takes one part in so many of the time at most."""


class TailReader:
    """Reads now and then the recording that is going to be a Parquet file at a path."""

    def __init__(self, path: Path) -> None:
        self._path = partial_path(path)
        self._next = 0.0
        self._size = 0

    def read(self, now: float) -> ExperimentRecord | None:
        """What there is at a time of a clock that only goes forward [s].

        None where there is nothing new, or it is too early to look.
        """
        if now < self._next:
            return None
        self._next = now + _EVERY_S
        try:
            size = self._path.stat().st_size
            if size == self._size:
                return None
            began = time.perf_counter()
            record = recover(self._path, finished=True)
        except (OSError, RecordError):
            # Not begun, two rows too few, or finished between two looks.
            return None
        self._size = size
        self._next = now + max(_EVERY_S, _BUSY * (time.perf_counter() - began))
        return record


_TELL_S = 0.1
"""Progress is told at most this often [s]."""


class ParentTalk:
    """What the process says and hears.

    Args:
        out: Where messages go.
        source: Where messages come from, the job's line already read.
    """

    def __init__(self, out: TextIO, source: TextIO) -> None:
        self._out, self._source = out, source
        self._lock = threading.Lock()
        self._answers: queue.Queue[str | None] = queue.Queue()
        self._told = 0.0

    def listen(self) -> None:
        """Read answers and stops from now on, in a thread of its own."""
        threading.Thread(target=self._listen, daemon=True).start()

    def say(self, message: dict[str, Any]) -> None:
        """Send a message; a page that is gone hears nothing."""
        # The end of stdin stops the job; here there is nobody to tell.
        with self._lock, suppress(BrokenPipeError, ValueError):
            self._out.write(line(message))
            self._out.flush()

    def progress(self, what: str, share: float) -> None:
        """Tell how far the job is, not more often than a page can show."""
        now = time.monotonic()
        if now - self._told >= _TELL_S or share >= 1.0:
            self._told = now
            self.say({"what": what, "share": min(max(share, 0.0), 1.0)})

    def best(self, entry: HistoryEntry) -> None:
        """Tell the criterion of the best motion so far; JSON of pages holds no infinity."""
        if math.isfinite(entry.value):
            self.say({"criterion": entry.value})

    def ask(self, what: str, word: str) -> None:
        """Let the person at the page type a word before anything moves."""
        self.say({"ask": what, "word": word})
        answer = self._answers.get()
        if answer is None:
            raise KeyboardInterrupt  # where SIGINT is handled otherwise
        if answer != word:
            raise InputError("the motion was not confirmed", value=answer, limit=word)

    def _listen(self) -> None:
        # What cannot be understood, as of a page that died, may have been a stop.
        with suppress(ValueError):
            for text in self._source:
                message = json.loads(text)
                if "answer" not in message:
                    break
                self._answers.put(str(message["answer"]))
        # The same wish as Ctrl-C: drivers and searches know how to end in good order.
        os.kill(os.getpid(), signal.SIGINT)
        # Who waits for an answer is awake then, and meets the interrupt.
        self._answers.put(None)


def main() -> int:
    """Do the job that stdin names; 0, or the exit code of its error."""
    # Libraries that print must not break into the lines of messages.
    out = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    talk = ParentTalk(out, sys.stdin)
    try:
        job = Job(**json.loads(sys.stdin.readline()))
        talk.listen()
        result = _DO[job.kind](job, talk)
    except DynidError as error:
        talk.say({"error": error.line, "what": error.line})
        return error.exit_code
    except KeyboardInterrupt:
        stopped = "stopped before there was a result"
        talk.say({"error": stopped, "what": stopped})
        return 130
    # A run that was stopped has a result too: its own words say how it ended.
    talk.say({"result": result, "what": result["words"]})
    return 0


# Each result has `words` and `level` (`good`, `warn`, `bad`) for the page.


def _design(job: Job, talk: ParentTalk) -> dict[str, Any]:
    from dynid.workflow import DesignSettings, design

    settings = DesignSettings(**job.options)
    found = design(job.source, settings, output=job.output, progress=talk.progress, watch=talk.best)
    result = found.to_json()
    early = ", stopped early" if result["interrupted"] else ""
    worth = f"condition number {result['condition_number']:.4g}"
    if (percent := result["predicted_torque_error_percent"]) is not None:
        worth = f"expected torque error {percent:.2g} %, {worth}"
    words = f"{worth[0].upper()}{worth[1:]}, {result['certificate']}{early}"
    return result | {"words": words, "level": "good" if result["feasible"] else "warn"}


def _run(job: Job, talk: ParentTalk) -> dict[str, Any]:
    from dynid import experiment, workflow

    settings = workflow.RunSettings(**job.options)
    with experiment.stop_on_signals() as cancel:
        result = workflow.run_design(
            job.source,
            job.output,
            on=job.target,
            settings=settings,
            confirm=talk.ask,
            cancel=cancel,
            progress=talk.progress,
        )
    outcome, abort = result.result.outcome, result.abort
    words = f"{outcome.samples} samples, {outcome.gaps} gaps"
    if abort is not None:
        words = f"{words}; stopped: {abort.message}"
    return result.to_json() | {"words": words, "level": "good" if abort is None else "warn"}


def _identify(job: Job, talk: ParentTalk) -> dict[str, Any]:
    from dynid.workflow import IdentifySettings, identify_files, verdict

    options = dict(job.options)
    validation, robot = options.pop("validate", None), options.pop("robot", None)
    result = identify_files(
        [job.source],
        job.output,
        robot=robot,
        settings=IdentifySettings(**options),
        validation=None if validation is None else Path(validation),
        progress=talk.progress,
    )
    judged = verdict(result)
    return {"words": judged.headline, "level": LEVELS[judged.level]}


def _import(job: Job, talk: ParentTalk) -> dict[str, Any]:
    from dynid.workflow import import_recording

    talk.progress("read the log", 0.1)
    result = import_recording([job.source], job.output, robot=job.options["robot"]).to_json()
    problems = [item["message"] for item in result["problems"]]
    words = ". ".join([f"{result['samples']} samples at {result['rate_hz']:.4g} Hz", *problems])
    return result | {"words": words, "level": "warn" if problems else "good"}


_DO: dict[str, Callable[[Job, ParentTalk], dict[str, Any]]] = {
    "design": _design,
    "run": _run,
    "identify": _identify,
    "import": _import,
}
