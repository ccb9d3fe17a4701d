"""Options that several commands share, and errors as one line and an exit code."""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer
import typer.core

from dynid.core import DynidError, InputError

ForceFlag = Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")]
JsonFlag = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
RobotOption = Annotated[
    str | None,
    typer.Option(
        "--robot",
        metavar="ROBOT",
        help="Built-in name, URDF or robot file; default: that of the recording.",
    ),
]
StartOption = Annotated[
    float | None,
    typer.Option("--from", metavar="S", help="Start of the window, from the record's start."),
]
StopOption = Annotated[
    float | None, typer.Option("--to", metavar="S", help="End of the window, same clock.")
]
SeedOption = Annotated[
    int, typer.Option("--seed", metavar="N", min=0, help="Seed of the random numbers.")
]
GainsOption = Annotated[
    str | None,
    typer.Option(
        "--gains",
        metavar="g1,..,gn",
        help="Drive gains [N.m/A], one a joint; default: those of the recording or the robot.",
    ),
]
JobsOption = Annotated[
    int, typer.Option("--jobs", metavar="N", min=1, help="Processes on this machine.")
]
DaskOption = Annotated[
    str | None,
    typer.Option("--dask", metavar="ADDRESS", help="A Dask scheduler, instead of --jobs."),
]
TemperatureOption = Annotated[
    float | None,
    typer.Option(
        "--at", metavar="DEGC", help="Temperature of the joints, of a file with temperature laws."
    ),
]


def parse_gains(text: str | None) -> tuple[float, ...] | None:
    """Drive gains from `13.6,13.7,...`.

    Raises:
        InputError: Not numbers with commas between.
    """
    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(
            "must be numbers with commas between", where="--gains", value=text
        ) from error


MeshDirOption = Annotated[
    list[Path] | None,
    typer.Option("--mesh-dir", metavar="DIR", help="Where meshes of a URDF are; may be repeated."),
]
FloorOption = Annotated[
    str | None,
    typer.Option(
        metavar="HEIGHT|none",
        help="Floor, wall or ceiling, in the base frame [m]. [default: the mounting plane]",
    ),
]
ToolOption = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="Tool point in the flange's frame [m].")
]
PayloadOption = Annotated[
    str | None, typer.Option(metavar="KG[,X,Y,Z]", help="Mass at the flange [kg], its centre [m].")
]
MarginOption = Annotated[
    float | None,
    typer.Option(
        metavar="PERCENT", help="Margin to limits of speed, torque and power. [default: 5]"
    ),
]
ClearanceOption = Annotated[
    float | None, typer.Option(metavar="M", help="Smallest distance of bodies [m]. [default: 0.01]")
]


GROUPS: Mapping[str, tuple[str, ...]] = {
    "Purpose": ("criterion", "purpose", "motion", "accuracy", "accept_weak", "noise", "previous"),
    "Motion": ("trajectory", "harmonics", "period", "start_pose"),
    "Search": ("method", "population", "generations", "starts", "budget", "seed", "jobs", "dask"),
    "Limits and surroundings": ("limits", "scene", "no_collision", "mesh_dir", "floor", "tool",
                                "payload", "margin", "clearance", "mount", "accept_unjudged"),
    "Model": ("frames", "terms", "estimator", "preset", "cutoff", "weighting"),
    "Validation": ("validation", "validation_start", "validation_stop"),
    "Motion of the robot": ("repeat", "thermal", "slow", "settle", "warm_up"),
    "Columns and units": ("columns", "no_header", "delimiter", "rate", "degrees", "joint_order",
                          "topic", "gains"),
    "Other files": ("csv", "urscript", "ros", "movej", "waypoints", "krl", "rapid"),
}  # fmt: skip
"""Headings of help pages, and the parameters that stand below them."""
MANY_OPTIONS = 11
"""A help page with fewer needs no headings."""


class GroupedCommand(typer.core.TyperCommand):
    """A command whose help shows many options below headings."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options, as click asks for them."""
        shown = [(p, p.get_help_record(ctx)) for p in self.get_params(ctx)]
        options = [p for p, record in shown if record and p.param_type_name == "option"]
        titles = {name: title for title, names in GROUPS.items() for name in names}
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter, record in shown:
            if record is None:
                continue
            title = "Arguments"
            if parameter.param_type_name == "option":
                grouped = len(options) > MANY_OPTIONS
                title = titles.get(parameter.name or "", "Options") if grouped else "Options"
            sections.setdefault(title, []).append(record)
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


class Commands(typer.Typer):
    """An application whose commands group their options."""

    def command(self, name: str | None = None, **settings: Any) -> Any:
        """As `typer.Typer.command`."""
        settings.setdefault("cls", GroupedCommand)
        return super().command(name, **settings)


def examples(*lines: str) -> str:
    """The end of a help page: command lines to copy."""
    return "\b\nExample:\n" + "\n".join(f"  {line}" for line in lines)


@dataclass(frozen=True, slots=True)
class Command:
    """A command: what runs, and the end of its help page."""

    run: Callable[..., object]
    epilog: str


def command(*lines: str) -> Callable[[Callable[..., object]], Command]:
    """Make a command of a function, with command lines to copy on its help page."""
    return lambda run: Command(run, examples(*lines))


TRACEBACK = "DYNID_TRACEBACK"
"""Set in the environment, this shows the traceback of any error."""
BAD_INPUT, JOB_FAILED, INTERRUPTED, BROKEN_PIPE = 2, 1, 130, 1


class Interrupted(DynidError):
    """Ctrl-C ended a job that keeps what it has."""

    exit_code = INTERRUPTED


def exit_code_of(job: Callable[[], int]) -> int:
    """Run a job; whatever it raises becomes one line on stderr and an exit code."""
    try:
        code = job()
    except DynidError as error:
        return _say(str(error), error.exit_code)
    except typer.TyperException as error:
        return _say(_usage(error), BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has left: nothing to say, and nobody to say it to.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except OSError as error:
        # A full disk, a vanished folder: the machine's fault, not a bug.
        place = f": {error.filename}" if error.filename else ""
        wrong = BAD_INPUT if error.errno == errno.ENAMETOOLONG else JOB_FAILED
        return _say(f"{error.strerror or error}{place}", wrong)
    except MemoryError:
        return _say("not enough memory for this job; use a shorter record", JOB_FAILED)
    except Exception as error:
        # The last resort: a person must never meet a bare traceback. Every error that is
        # foreseen is a DynidError; what arrives here is a bug and is called one.
        return _say(
            f"internal error, a bug in dynid: {type(error).__name__}: {error}. "
            f"Run again with {TRACEBACK}=1 to see the traceback, and report it",
            JOB_FAILED,
        )
    # typer turns Ctrl-C into this code.
    if code == INTERRUPTED:
        return _say("interrupted; no file was left half-written", INTERRUPTED)
    return code


def guard_streams() -> None:
    """Make streams take any text, and SIGTERM clean up as Ctrl-C does."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _terminate)


def _terminate(number: int, frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


def _usage(error: typer.TyperException) -> str:
    """What was wrong with the command line, and where its help is."""
    context = getattr(error, "ctx", None)
    command = getattr(context, "command_path", "dynid")
    text = error.format_message().strip()
    if isinstance(error.__cause__, ValueError) and "value for" in text:
        found: list[Any] = getattr(error.__cause__, "errors", list)()
        text += "".join(f"; got {fault['input']}" for fault in found[:1])
    return f"{text if text.endswith(('.', '?')) else text + '.'} See: {command} --help"


def _say(message: str, code: int) -> int:
    if os.environ.get(TRACEBACK):
        traceback.print_exc()
    line = " ".join(part.strip() for part in message.splitlines() if part.strip())
    print(f"dynid: {line}", file=sys.stderr)
    return code
