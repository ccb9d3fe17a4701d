"""Options that several commands share, and errors as one line and an exit code."""

import errno
import functools
import inspect
import io
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer.core

from dynid import core, settings

_NUMBERS: tuple[Any, ...] = (int, float, int | None, float | None)


def option(metavar: str, help: str, *names: str, **bounds: Any) -> Any:
    """An option with a value; without names, it is called as the parameter."""
    return typer.Option(*names, metavar=metavar, help=help, **bounds)


def flag(name: str, help: str) -> Any:
    """An option without a value."""
    return typer.Option(name, help=help)


def argument(metavar: str, help: str) -> Any:
    """A word that is no option."""
    return typer.Argument(metavar=metavar, help=help)


def _shown(asked: settings.Option) -> Any:
    """The option of a field, as typer takes it."""
    if not asked.metavar:
        return flag(asked.name, asked.help)
    shown = option(asked.metavar, asked.help, asked.name)
    if asked.kind in _NUMBERS:
        shown.min = None if asked.least == -settings.FINITE else asked.least
        shown.max = None if asked.most == settings.FINITE else asked.most
    return shown


def declared(kind: type, field: str) -> Any:
    """The option of a field of settings, for a command that takes it by itself."""
    return _shown(settings.options_of(kind)[field])


ForceFlag = Annotated[bool, flag("--force", "Replace the file if it exists.")]
JsonFlag = Annotated[bool, flag("--json", "Print one JSON object on stdout.")]
RobotOption = Annotated[str | None, declared(settings.FleetSettings, "robot")]
StartOption = Annotated[float | None, declared(settings.IdentifySettings, "start_s")]
StopOption = Annotated[float | None, declared(settings.IdentifySettings, "stop_s")]
MountOption = Annotated[str | None, declared(settings.IdentifySettings, "mount")]
SeedOption = Annotated[int, declared(settings.DesignSettings, "seed")]
GainsOption = Annotated[str | None, declared(settings.ImportOptions, "gains")]
JobsOption = Annotated[int, declared(settings.FleetSettings, "jobs")]
DaskOption = Annotated[str | None, declared(settings.FleetSettings, "dask")]
TemperatureOption = Annotated[
    float | None,
    option("DEGC", "Temperature of the joints, of a file with temperature laws.", "--at"),
]


RobotArgument = Annotated[str, argument("ROBOT", "Built-in name, URDF or robot file.")]
DesignArgument = Annotated[Path, argument("DESIGN.json", "A design or trajectory.")]
EstimateArgument = Annotated[Path, argument("ESTIMATE.json", "What dynid identify wrote.")]
RecordOutput = Annotated[Path, option("RECORD.parquet", "The recording.", "-o", "--output")]


def drive_gains(text: str | None) -> tuple[float, ...] | None:
    """The value of `--gains`; None where it is not given."""
    return None if text is None else settings.numbers(text, "--gains")


GROUPS: Mapping[str, tuple[str, ...]] = {
    "Purpose": ("criterion", "purpose", "motions", "accuracy_percent", "accept_weak", "noise",
                "previous"),
    "Motion": ("trajectory", "harmonics", "period_s", "start_pose"),
    "Motion of the robot": ("repeat", "thermal", "slow", "settle", "warm_up_s"),
    "Method": ("method", "population", "generations", "starts", "budget_s", "seed"),
    "Limits and surroundings": ("limits", "scene", "collision", "mesh_dirs", "floor", "tool",
                                "payload", "margin_percent", "clearance", "mount",
                                "accept_unjudged"),
    "Model": ("frames", "terms", "estimator", "preset", "cutoff_hz", "weighting"),
    "Validation": ("validation", "validation_start", "validation_stop"),
    "Columns and units": ("columns", "header", "delimiter", "rate_hz", "degrees", "joint_order",
                          "topic", "gains"),
    "Other files": ("csv", "urscript", "ros", "movej", "waypoints", "krl", "rapid"),
}  # fmt: skip
"""Headings of help pages, in their order, and the parameters that stand below them."""
MANY_OPTIONS = 11
"""A help page with fewer needs no headings."""


class GroupedCommand(typer.core.TyperCommand):
    """A command whose help shows many options below headings."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options, as click asks for them."""
        shown = [(p, p.get_help_record(ctx)) for p in self.get_params(ctx)]
        options = [p for p, record in shown if record and p.param_type_name == "option"]
        titles = {name: title for title, names in GROUPS.items() for name in names}
        sections = {title: list[tuple[str, str]]() for title in ("Arguments", "Options", *GROUPS)}
        for parameter, record in shown:
            if record is None:
                continue
            title = "Arguments"
            if parameter.param_type_name == "option":
                grouped = len(options) > MANY_OPTIONS
                title = titles.get(parameter.name or "", "Options") if grouped else "Options"
            sections[title].append(record)
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def examples(*lines: str) -> str:
    """The end of a help page: command lines to copy."""
    return "\b\nExample:\n" + "\n".join(f"  {line}" for line in lines)


@dataclass(frozen=True, slots=True)
class Command:
    """A command: what runs, and the end of its help page."""

    run: Callable[..., object]
    epilog: str


def command(*lines: str, only: Sequence[str] = ()) -> Callable[[Callable[..., object]], Command]:
    """Make a command of a function, with command lines to copy on its help page.

    A parameter `settings` becomes the options that its class declares, or some of its fields
    `only`.
    """
    return lambda run: Command(_with_options(run, only), examples(*lines))


def _with_options(run: Callable[..., object], only: Sequence[str]) -> Callable[..., object]:
    signature = inspect.signature(run, eval_str=True)
    if "settings" not in signature.parameters:
        return run
    kind = signature.parameters["settings"].annotation
    declared = settings.options_of(kind)
    declared = {name: declared[name] for name in only or declared}
    parameters: list[inspect.Parameter] = []
    for name, parameter in signature.parameters.items():
        if name == "settings":
            parameters += [_parameter(field, asked) for field, asked in declared.items()]
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    @functools.wraps(run)
    def call(**words: Any) -> object:
        given = {name: words.pop(name) for name in declared}
        # typer gives an empty list where an option was not repeated even once.
        known = {name: value for name, value in given.items() if value not in (None, [])}
        read = {name: declared[name].read(value) for name, value in known.items()}
        return run(settings=kind(**read), **words)

    setattr(call, "__signature__", signature.replace(parameters=parameters))  # noqa: B010
    return call


def _parameter(name: str, asked: settings.Option) -> inspect.Parameter:
    """The parameter of a command that typer makes an option of."""
    default, kind = asked.default, asked.kind
    if not asked.metavar:
        kind, default = bool, False
    elif asked.many:
        kind, default = list[str] | None, None
    elif kind not in _NUMBERS:
        kind = str if isinstance(default, str) else str | None
    annotation = Annotated[kind, _shown(asked)]
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
    )


TRACEBACK = "DYNID_TRACEBACK"
"""Set in the environment, this shows the traceback of any error."""
BAD_INPUT, JOB_FAILED, INTERRUPTED, BROKEN_PIPE = 2, 1, 130, 1


class Interrupted(core.DynidError):
    """Ctrl-C ended a job that keeps what it has."""

    exit_code = INTERRUPTED


@contextmanager
def kept_in(path: Path | None) -> Generator[None]:
    """Say after Ctrl-C which file holds what a job, or one before it, has kept."""
    try:
        yield
    except KeyboardInterrupt:
        if path is None or not path.is_file():
            raise
        words = f"interrupted; a command with the settings of {path} goes on from it"
        raise Interrupted(words) from None


def exit_code_of(job: Callable[[], int]) -> int:
    """Run a job; whatever it raises becomes one line on stderr and an exit code."""
    try:
        code = job()
    except core.DynidError as error:
        return _say(error.line, error.exit_code)
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


class _Unread(io.FileIO):
    """A terminal, or stderr, that may close: what nobody can read any more does not end the job."""

    def write(self, data: Any, /) -> int | None:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in (errno.EIO, errno.EPIPE):
                raise
            return len(data)


def guard_streams() -> None:
    """Make streams take any text, also where a terminal has closed; SIGTERM cleans up as Ctrl-C."""
    for name in ("stdout", "stderr"):
        # None where the parent closed it; the next file opened would get its descriptor.
        stream = getattr(sys, name) or open(os.devnull, "w")  # noqa: SIM115
        setattr(sys, name, stream)
        if isinstance(stream, io.TextIOWrapper) and (stream is sys.__stderr__ or stream.isatty()):
            raw = io.BufferedWriter(_Unread(stream.fileno(), "w", closefd=False))
            stream = io.TextIOWrapper(raw, encoding=stream.encoding, line_buffering=True)
            setattr(sys, name, stream)
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))


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
