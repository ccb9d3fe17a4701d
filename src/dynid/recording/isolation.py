"""Recordings are read in a process of their own, whose memory and time the system limits.

One bound for all formats: whatever a file claims or a library does with it, the reader ends and the
caller gets one message. The process is started once (0.4 s of CPU) and reads one file after the
other; what it found comes back as JSON and raw numbers.
"""

import atexit
import json
import math
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, fields
from pathlib import Path
from typing import IO, Any

import numpy as np

from dynid import core
from dynid.recording import content, records, table

Read = table.RawTable | records.ExperimentRecord
"""What files hold: a table to be repaired, or an own recording, which is complete."""
Reader = Callable[[list[Path], table.ReadOptions, content.Budget], Read]
_ERRORS: dict[str, type[core.DynidError]] = {
    kind.__name__: kind
    for kind in (
        core.InputError,
        core.JobError,
        core.MissingExtraError,
        core.RecordError,
        core.UnclearRecordError,
    )
}
_LOOK_S = 0.25
"""Between two looks at the CPU time."""
_TICKS = 1.5
"""The limit of the kernel's own, rougher count."""
_ARRAYS = ("rows", "t", "reported")
_SMALLER = "Save only the signals of the joints, or split the recording into shorter ones."
_REPORT = "Try another export of it; if that fails too, report this with the file."


class _Worker:
    """The reading process, as its parent sees it."""

    def __init__(self) -> None:
        self.pid = os.getpid()
        code = (
            f"import sys; sys.path[:] = {sys.path!r}; "
            "from dynid.recording.reading import serve_requests; serve_requests()"
        )
        # One thread, and no reserve of address space, so that the limit is one of true memory.
        calm = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "1"}
        self.process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **calm, "ARROW_DEFAULT_MEMORY_POOL": "system"},
            # Ctrl-C is the parent's to handle.
            start_new_session=True,
        )

    def ask(self, request: dict[str, Any]) -> Read | None:
        """The answer to one request; None where the process ended before it."""
        stdin, stdout = self.process.stdin, self.process.stdout
        if stdin is None or stdout is None:
            return None
        try:
            stdin.write(json.dumps(request).encode() + b"\n")
            stdin.flush()
            head = stdout.readline()
        except OSError:
            return None
        if not head.endswith(b"\n"):
            return None
        answer = json.loads(head)
        if "error" in answer:
            kind = _ERRORS.get(answer.pop("error"), core.RecordError)
            raise kind(answer.pop("what"), **answer)
        return _unpack(answer, stdout)

    def end(self) -> int:
        """End the process and tell how it ended."""
        for pipe in filter(None, (self.process.stdin, self.process.stdout)):
            with suppress(OSError):
                pipe.close()
        try:
            return self.process.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


_lock = threading.Lock()
_worker: list[_Worker] = []


def read_isolated(files: Sequence[Path], options: table.ReadOptions) -> Read:
    """Read the files of one recording within their budget.

    Raises:
        RecordError: Not a recording, or one that needs more than its budget.
        MissingExtraError: A format whose extra is not installed.
    """
    budget, where = content.Budget.of(files), ", ".join(file.name for file in files)
    with tempfile.TemporaryDirectory(prefix="dynid-") as folder, _lock:
        request = {
            # A link has the name that says what is in the file, not what it points to.
            "files": [str(file.absolute()) for file in files],
            "options": asdict(options),
            "budget": asdict(budget),
            "folder": folder,
        }
        worker = _current()
        try:
            answer = worker.ask(request)
        except core.DynidError:
            raise
        except BaseException:
            # Half an answer may be in the pipe.
            _drop()
            raise
        if answer is not None:
            return answer
        status = _drop()
    if status == -signal.SIGXCPU:
        raise core.RecordError(
            "reading takes too long for a file of this size",
            where=where,
            limit=f"{budget.cpu_s:.0f} s of CPU time",
            next_step=_SMALLER,
        )
    raise core.RecordError(
        "the file is damaged, or needs more memory than one of its size may",
        where=where,
        limit=f"{budget.memory_bytes >> 20} MB",
        next_step=_SMALLER,
    )


def serve(read: Reader) -> None:
    """Answer requests until the parent closes the pipe; runs in the reading process."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    source = sys.stdin.buffer
    answers = os.fdopen(os.dup(1), "wb")
    # What libraries print must not get among the answers.
    os.dup2(2, 1)
    clock = _CpuLimit()
    while line := source.readline():
        request = json.loads(line)
        budget = content.Budget(**request["budget"])
        tempfile.tempdir = request["folder"]
        _limit(budget)
        files = [Path(file) for file in request["files"]]
        clock.until_s = time.process_time() + budget.cpu_s
        try:
            options = core.JsonFields(request["options"]).made(table.ReadOptions)
            _send(read(files, options, budget), answers)
        except core.DynidError as error:
            _refuse(error, answers)
        except MemoryError:
            # The parent tells of a process that ended without an answer.
            return
        except Exception as error:
            # What a library makes of damage is not known, nor what it changes with its version.
            what = "the file is damaged, or dynid or a library has a bug"
            said = f"{type(error).__name__}: {error}"
            names = ", ".join(file.name for file in files)
            _refuse(core.RecordError(what, where=names, value=said, next_step=_REPORT), answers)
        finally:
            clock.until_s = math.inf


class _CpuLimit:
    """Ends the process once its CPU time is over.

    RLIMIT_CPU is counted in ticks, which beside threads that wake with them may be half or twice
    the time: a wider limit of that kind is for code that never lets go of the interpreter.
    """

    def __init__(self) -> None:
        self.until_s = math.inf
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while time.process_time() < self.until_s:
            time.sleep(_LOOK_S)
        os.kill(os.getpid(), signal.SIGXCPU)


def _limit(budget: content.Budget) -> None:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    space = pages * resource.getpagesize() + budget.memory_bytes
    used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    cpu_s = int(used + _TICKS * budget.cpu_s) + 1
    for kind, most in ((resource.RLIMIT_AS, space), (resource.RLIMIT_CPU, cpu_s)):
        # A batch system may have set a hard limit, which nobody but root may raise.
        hard = resource.getrlimit(kind)[1]
        limit = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (limit, hard))


def _refuse(error: core.DynidError, answers: IO[bytes]) -> None:
    # Values of other types are shown as they would be in the message.
    shown = {k: None if v is None else core.in_words(v) for k, v in error.facts.items()}
    kind = next(k.__name__ for k in type(error).__mro__ if k.__name__ in _ERRORS)
    answers.write(json.dumps({"error": kind, **shown}).encode() + b"\n")
    answers.flush()


def _send(found: Read, answers: IO[bytes]) -> None:
    own = isinstance(found, records.ExperimentRecord)
    arrays = {"t": found.t} if own else {name: getattr(found, name) for name in _ARRAYS}
    arrays |= {f"signals/{name}": value for name, value in found.signals.items()}
    arrays |= {f"channels/{name}": value for name, value in found.channels.items()}
    there = {name: np.ascontiguousarray(x) for name, x in arrays.items() if x is not None}
    facts: dict[str, Any]
    if own:
        facts = {"metadata": records.metadata_to_json(found.metadata)}
        facts["problems"] = [notice.to_json() for notice in found.problems]
    else:
        names = {item.name for item in fields(found)} - {*_ARRAYS, "index", "signals", "channels"}
        facts = {name: getattr(found, name) for name in names}
        facts["said"] = sorted(found.said)
        facts["notices"] = [notice.to_json() for notice in found.notices]
    listed = [[name, value.dtype.str, value.shape] for name, value in there.items()]
    head = {"own": own, "facts": facts, "arrays": listed}
    answers.write(json.dumps(head).encode() + b"\n")
    for value in there.values():
        answers.write(value.data)
    answers.flush()


def _unpack(answer: dict[str, Any], stream: IO[bytes]) -> Read | None:
    known: dict[str, Any] = {"signals": {}, "channels": {}}
    for name, kind, shape in answer["arrays"]:
        dtype: np.dtype[Any] = np.dtype(kind)
        size = math.prod(shape) * dtype.itemsize
        data = stream.read(size)
        if len(data) < size:
            return None
        value: core.Array = np.frombuffer(data, dtype=dtype)
        value = value.reshape(tuple[int, ...](shape))
        group, slash, key = name.partition("/")
        if slash:
            known[group][key] = value
        else:
            known[name] = value
    facts, told = answer["facts"], "problems" if answer["own"] else "notices"
    known[told] = tuple(map(core.finding_from_json, facts[told]))
    kind = records.ExperimentRecord if answer["own"] else table.RawTable
    return core.JsonFields(facts).made(kind, **known)


def _current() -> _Worker:
    """The running process, or a new one; a fork of the parent needs one of its own."""
    if _worker and (_worker[0].pid != os.getpid() or _worker[0].process.poll() is not None):
        _drop()
    if not _worker:
        _worker.append(_Worker())
    return _worker[0]


def _drop() -> int:
    """Forget the process and tell how it ended; only its own parent ends it."""
    worker = _worker.pop()
    return worker.end() if worker.pid == os.getpid() else 0


@atexit.register
def _end() -> None:
    if _worker:
        _drop()
