"""A simulated controller as a process of its own, for tests, demos and drivers.

ur_rtde's constructors hold Python's global lock, so the controller cannot live in the process of
its client.
"""

import itertools
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from dynid.core import JobError

READY_S = 60.0
"""How long a controller may take until clients can connect [s]."""
_END_S = 5.0
_COUNT = itertools.count()


@dataclass(frozen=True, slots=True)
class RunningController:
    """A controller that clients can connect to."""

    host: str
    """Its address."""
    ports: Mapping[str, int]
    """`dashboard`, `primary`, `secondary`, `realtime`, `rtde`."""
    rate_hz: float
    """Control cycles a second."""
    version: str
    """Software version, dotted."""
    process: subprocess.Popen[bytes]
    """The process."""
    log: Path
    """What it tells people; gone when the context ends."""

    def said(self) -> str:
        """What it has told people so far."""
        return self.log.read_text(errors="replace")

    def end(self) -> int:
        """Ask it to stop, as Ctrl-C does; its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            return self.process.wait(_END_S)
        except subprocess.TimeoutExpired:
            return self.kill()

    def kill(self) -> int:
        """End it without asking, as a power cut does; its exit code."""
        self.process.kill()
        return self.process.wait()


def own_address() -> str:
    """A loopback address for one more controller of this process: UR's ports cannot be moved."""
    pid, count = os.getpid(), next(_COUNT)
    return f"127.{1 + (pid >> 8) % 250}.{pid % 256}.{1 + count % 250}"


@contextmanager
def controller_process(
    robot: str | Path = "ur5",
    *,
    host: str | None = None,
    thermal: str | float = "cold",
    virtual_time: bool = False,
    hold: bool = False,
    seed: int = 0,
    rate_hz: float | None = None,
    software: str | None = None,
    programs: Path | None = None,
    truth: Path | None = None,
    report: Path | None = None,
) -> Generator[RunningController]:
    """Start a controller, wait until clients can connect, and end it with the context.

    It also ends when this process does, however that happens. The arguments are the options of
    `urtwin` and the fields of `ControllerSettings`, but: `host` None is a loopback address that
    no other process of this kind uses, `thermal` may be a number [degC], and `software` is the
    version to announce, dotted; None: the one usual for the rate.

    Raises:
        JobError: It did not start; the message is its own.
    """
    options: dict[str, object | None] = {
        "--robot": robot,
        "--host": own_address() if host is None else host,
        "--thermal": thermal,
        "--seed": seed,
        "--rate": rate_hz,
        "--software": software,
        "--programs": programs,
        "--truth": truth,
        "--report": report,
        "--parent": os.getpid(),
    }
    words = [f"{name}={value}" for name, value in options.items() if value is not None]
    words += [flag for flag, on in (("--virtual-time", virtual_time), ("--hold", hold)) if on]
    command = [sys.executable, "-m", "urtwin", "--json", *words]
    with (
        tempfile.NamedTemporaryFile(prefix="urtwin-", suffix=".log") as file,
        subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=file
        ) as process,
    ):
        log = Path(file.name)
        try:
            about = _ready(process, log)
            names = ("host", "ports", "rate_hz", "version")
            running = RunningController(
                **{name: about[name] for name in names}, process=process, log=log
            )
            yield running
            running.end()
        finally:
            if process.poll() is None:
                process.kill()


def _ready(process: subprocess.Popen[bytes], log: Path) -> dict[str, Any]:
    """The line that a controller prints when it listens; `JobError` if it does not."""
    stream = process.stdout
    # The line comes at once, or never.
    ready = stream is not None and select.select([stream], [], [], READY_S)[0]
    line = stream.readline() if stream is not None and ready else b""
    if not line.endswith(b"\n"):
        raise JobError(
            "the simulated controller did not start",
            value=log.read_text(errors="replace").strip() or f"nothing within {READY_S:g} s",
        )
    return cast("dict[str, Any]", json.loads(line))
