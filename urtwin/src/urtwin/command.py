"""The command line, `urtwin`, which is also `dynid controller`, and its process for clients.

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
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from dynid.core import DynidError, JobError
from urtwin import __version__
from urtwin.settings import ControllerSettings, flag

_EXAMPLES = (
    "--robot ur5",
    "--robot ur5e --host 127.0.0.2 --thermal warm",
    "--robot ur5 --virtual-time --json",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command `urtwin` with the words after it; None for those of the process.

    Returns:
        0 on success, 2 on bad usage or input, 1 when the job failed, 130 on Ctrl-C.
    """
    try:
        run_command(sys.argv[1:] if arguments is None else arguments, "urtwin")
    except DynidError as error:
        print(f"urtwin: {error.line}", file=sys.stderr)
        return error.exit_code
    except typer.TyperException as error:
        print(f"urtwin: {error.format_message()} See: urtwin --help", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, typer.Abort):
        return 130
    return 0


def run_command(arguments: Sequence[str], name: str) -> None:
    """Simulate a controller until Ctrl-C, as the command line says.

    `name` is what the user called: `urtwin` or `dynid controller`.

    Raises:
        DynidError: Bad input, a taken port, an extra that is not installed.
        typer.TyperException: Bad usage.
    """
    app = typer.Typer(
        add_completion=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    )
    lines = "\n".join(f"  {name} {words}" for words in _EXAMPLES)
    app.command(epilog=f"\b\nExample:\n{lines}")(_with_options(_controller))
    typer.main.get_command(app)(list(arguments), prog_name=name, standalone_mode=False)


def _controller(*, as_json: bool, version: bool, **options: Any) -> None:
    """A simulated UR controller: RTDE, script ports, dashboard.

    It simulates the dynamics of a real arm and listens on UR's own ports 29999 and 30001 to 30004
    until Ctrl-C. With --json, one object is printed on stdout when clients can connect.
    """
    if version:
        print(f"urtwin {__version__}")
        return
    settings = ControllerSettings(**options)

    # Late, so that --help and bad usage are answered without physics and compilers.
    from urtwin.server import serve

    def ready(about: dict[str, Any]) -> None:
        if as_json:
            print(json.dumps(about, allow_nan=False), flush=True)
        pace = "virtual time" if settings.virtual_time else "real time"
        ports = ", ".join(f"{name} {port}" for name, port in about["ports"].items())
        print(
            f"urtwin: {about['robot']}, software {about['version']}, "
            f"{about['rate_hz']:g} Hz, {pace}, at {settings.host}: {ports}. Ctrl-C ends it.",
            file=sys.stderr,
            flush=True,
        )

    serve(settings, sys.stderr, ready)


def _with_options(run: Callable[..., None]) -> Callable[..., None]:
    """A command whose options are the fields of the settings, and those of what it prints."""
    found = list(signature(ControllerSettings).parameters.values())
    for name, option in (
        ("as_json", flag("--json", "Print one JSON object on stdout.")),
        ("version", flag("--version", "Print the version.")),
    ):
        annotation = Annotated[bool, option]
        found.append(Parameter(name, Parameter.KEYWORD_ONLY, default=False, annotation=annotation))
    setattr(run, "__signature__", Signature(found))  # noqa: B010
    setattr(run, "__annotations__", {each.name: each.annotation for each in found})  # noqa: B010
    return run


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
