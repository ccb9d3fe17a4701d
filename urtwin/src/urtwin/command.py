"""The command line: `urtwin`, which is also `dynid controller`."""

import ipaddress
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from dynid.core import DynidError, InputError
from urtwin import __version__

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
        print(f"urtwin: {error}", file=sys.stderr)
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
    app.command(epilog=f"\b\nExample:\n{lines}")(_controller)
    typer.main.get_command(app)(list(arguments), prog_name=name, standalone_mode=False)


def _option(told: str, metavar: str, **more: Any) -> Any:
    return typer.Option(metavar=metavar, help=told, **more)


def _flag(name: str, told: str) -> Any:
    return typer.Option(name, help=told)


def _controller(
    robot: Annotated[str, _option("Built-in name, URDF or robot file.", "ROBOT")] = "ur5",
    host: Annotated[
        str,
        _option(
            "Where to listen; each controller needs an address of its own, 127.0.0.1 to "
            "127.255.255.254.",
            "ADDRESS",
        ),
    ] = "127.0.0.1",
    thermal: Annotated[
        str, _option("cold, warm, or joint temperatures in degC.", "STATE")
    ] = "cold",
    virtual_time: Annotated[
        bool, _flag("--virtual-time", "Time advances as fast as the clients read.")
    ] = False,
    hold: Annotated[
        bool, _flag("--hold", "Time starts when the first client has started RTDE.")
    ] = False,
    seed: Annotated[int, _option("Seed of the random numbers.", "N", min=0)] = 0,
    rate: Annotated[
        float | None,
        _option("125 (CB-Series) or 500 (e-Series). [default: by the robot's name]", "HZ"),
    ] = None,
    software: Annotated[
        str | None, _option("Version to announce, like 3.15.8 or 5.12.0.", "VERSION")
    ] = None,
    programs: Annotated[
        Path | None,
        _option("Programs for the dashboard's load: work.script for `load work.urp`.", "DIR"),
    ] = None,
    truth: Annotated[
        Path | None, _option("Write the simulated arm's true parameters.", "FILE")
    ] = None,
    report: Annotated[
        Path | None, _option("Write, at the end, the timing of the control cycles.", "FILE")
    ] = None,
    expose: Annotated[
        bool, _flag("--expose", "Allow a --host that other machines can reach.")
    ] = False,
    parent: Annotated[int | None, typer.Option(hidden=True)] = None,
    as_json: Annotated[bool, _flag("--json", "Print one JSON object on stdout.")] = False,
    version: Annotated[bool, _flag("--version", "Print the version.")] = False,
) -> None:
    """A simulated UR controller: RTDE, script ports, dashboard.

    It simulates the dynamics of a real arm and listens on UR's own ports 29999 and 30001 to 30004
    until Ctrl-C. With --json, one object is printed on stdout when clients can connect.
    """
    if version:
        print(f"urtwin {__version__}")
        return
    address = _address(host, expose=expose)
    announced = None if software is None else _version(software)
    state = _thermal(thermal)
    for where, path in (("--truth", truth), ("--report", report)):
        if path is not None and not os.path.isdir(path.parent):
            raise InputError(
                "the output's directory does not exist",
                where=where,
                value=str(path.parent),
                next_step=f"Run: mkdir -p {path.parent}",
            )

    # Late, so that --help and bad usage are answered without physics and compilers.
    from urtwin.server import ControllerSettings, serve

    settings = ControllerSettings(
        robot=robot,
        host=address,
        thermal=state,
        virtual_time=virtual_time,
        hold=hold,
        seed=seed,
        rate_hz=rate,
        version=announced,
        programs=programs,
        truth=truth,
        report=report,
        parent=parent,
    )

    def ready(about: dict[str, Any]) -> None:
        if as_json:
            print(json.dumps(about, allow_nan=False), flush=True)
        pace = "virtual time" if virtual_time else "real time"
        ports = ", ".join(f"{name} {port}" for name, port in about["ports"].items())
        print(
            f"urtwin: {about['robot']}, software {about['version']}, "
            f"{about['rate_hz']:g} Hz, {pace}, at {address}: {ports}. Ctrl-C ends it.",
            file=sys.stderr,
            flush=True,
        )

    serve(settings, sys.stderr, ready)


def _thermal(text: str) -> str | float:
    """`cold`, `warm` or degC, whose range the arm checks; else an `InputError`."""
    if text in ("cold", "warm"):
        return text
    try:
        return float(text)
    except ValueError as error:
        raise InputError(
            "unknown thermal state",
            where="--thermal",
            value=text,
            limit="cold, warm, or -40 to 120 degC",
        ) from error


def _address(host: str, *, expose: bool) -> str:
    """The address to listen on; `InputError` if it is none, or other machines can reach it."""
    try:
        address = ipaddress.IPv4Address("127.0.0.1" if host == "localhost" else host)
    except ValueError as error:
        raise InputError(
            "this is no IPv4 address", where="--host", value=host, limit="for example 127.0.0.2"
        ) from error
    if not address.is_loopback:
        if not expose:
            raise InputError(
                "other machines could reach the simulated controller there, and anybody could "
                "send it programs",
                where="--host",
                value=host,
                next_step="Use 127.0.0.x, or add --expose if you mean it",
            )
        print(
            f"urtwin: warning: {address} can be reached from other machines; "
            "the protocols know no password",
            file=sys.stderr,
        )
    return str(address)


def _version(text: str) -> tuple[int, int, int]:
    """The numbers of a version; `InputError` if it is none."""
    parts = text.split(".")
    if not 2 <= len(parts) <= 3 or not all(part.isdigit() and len(part) < 4 for part in parts):
        raise InputError(
            "this is no software version", where="--software", value=text, limit="like 3.15.8"
        )
    major, minor, bugfix, *_ = (*map(int, parts), 0)
    return major, minor, bugfix
