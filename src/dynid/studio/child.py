"""The process of a long job: `python -m dynid.studio.child`, started by `supervisor`.

Designs and runs live here and not in the page's process: a page that draws, or hangs, takes no
time from a recording.
"""

from __future__ import annotations

import json
import math
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from dynid.core import DynidError, InputError
from dynid.studio.jobs import LEVELS, Job, line

if TYPE_CHECKING:
    from dynid.excitation import HistoryEntry

_TELL_S = 0.1
"""Progress is told at most this often [s]."""


class ParentTalk:
    """What the process says and hears.

    Args:
        out: Where messages go.
        heard: Where messages come from, the job's line already read.
    """

    def __init__(self, out: TextIO, heard: TextIO) -> None:
        self._out, self._heard = out, heard
        self._lock = threading.Lock()
        self._answers: queue.Queue[str | None] = queue.Queue()
        self._told = 0.0

    def listen(self) -> None:
        """Hear answers and stops from now on, in a thread of its own."""
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
        if answer != word:
            raise InputError("the motion was not confirmed", value=answer or "", limit=word)

    def _listen(self) -> None:
        # What cannot be understood, as of a page that died, may have been a stop.
        with suppress(ValueError):
            for text in self._heard:
                message = json.loads(text)
                if "answer" not in message:
                    break
                self._answers.put(str(message["answer"]))
        self._answers.put(None)
        # The same wish as Ctrl-C: drivers and searches know how to end in good order.
        os.kill(os.getpid(), signal.SIGINT)


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
        talk.say({"error": str(error)})
        return error.exit_code
    except KeyboardInterrupt:
        talk.say({"error": "stopped before there was a result"})
        return 130
    talk.say({"result": result, "share": 1.0, "what": "done"})
    return 0


# Each result has `words` and `level` (`good`, `warn`, `bad`) for the page.


def _design(job: Job, talk: ParentTalk) -> dict[str, Any]:
    from dynid.workflow import DesignSettings, design

    settings = DesignSettings(**job.options)
    found = design(job.source, settings, output=job.output, progress=talk.progress, watch=talk.best)
    result = found.to_json()
    early = ", stopped early" if result["interrupted"] else ""
    words = f"Condition number {result['condition_number']:.4g}, {result['certificate']}{early}"
    return result | {"words": words, "level": "good" if result["feasible"] else "warn"}


def _run(job: Job, talk: ParentTalk) -> dict[str, Any]:
    from dynid.experiment import stop_on_signals
    from dynid.workflow import RunSettings, run_design

    settings = RunSettings(**job.options)
    with stop_on_signals() as cancel:
        result = run_design(
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
    problems = [str(item) for item in result["problems"]]
    words = ". ".join([f"{result['samples']} samples at {result['rate_hz']:.4g} Hz", *problems])
    return result | {"words": words, "level": "warn" if problems else "good"}


_DO: dict[str, Callable[[Job, ParentTalk], dict[str, Any]]] = {
    "design": _design,
    "run": _run,
    "identify": _identify,
    "import": _import,
}


if __name__ == "__main__":
    sys.exit(main())
