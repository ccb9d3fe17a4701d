"""Long jobs as values, the process of each, and the lines in which it talks with the page.

A job's process reads its job from the first line of its stdin. What it has to say goes to its
stdout, one JSON object a line: what changes of `JobState`, or the `criterion` of a search. Further
lines on its stdin are `answer` and `stop`; the end of its stdin is a stop too, so that no robot
goes on moving for a page that is gone.
"""

import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

from dynid.core import JobError


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
                [sys.executable, "-m", "dynid.studio.child"],
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
            # There may be a line that it no longer wanted to hear.
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
