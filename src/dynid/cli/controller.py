"""`dynid controller`."""

from __future__ import annotations

import ipaddress
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from dynid.cli.options import JsonFlag, SeedOption, examples
from dynid.core import InputError

_FOREIGN = "--expose"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "controller",
        epilog=examples(
            "dynid controller --robot ur5",
            "dynid controller --robot ur5e --host 127.0.0.2 --thermal warm",
            "dynid controller --robot ur5 --virtual-time --json",
        ),
    )(_controller)


def _controller(
    robot: Annotated[
        str, typer.Option("--robot", metavar="ROBOT", help="Built-in name, URDF or robot file.")
    ] = "ur5",
    host: Annotated[
        str,
        typer.Option(
            "--host",
            metavar="ADDRESS",
            help="Where to listen; each controller needs an address of its own, "
            "127.0.0.1 to 127.255.255.254.",
        ),
    ] = "127.0.0.1",
    thermal: Annotated[
        str,
        typer.Option(
            "--thermal", metavar="STATE", help="cold, warm, or joint temperatures in degC."
        ),
    ] = "cold",
    virtual_time: Annotated[
        bool, typer.Option("--virtual-time", help="Time goes as fast as the clients read.")
    ] = False,
    hold: Annotated[
        bool,
        typer.Option("--hold", help="Time stands still until the first client has started RTDE."),
    ] = False,
    seed: SeedOption = 0,
    rate: Annotated[
        float | None,
        typer.Option(
            "--rate",
            metavar="HZ",
            help="125 (CB-Series) or 500 (e-Series). [default: by the robot's name]",
        ),
    ] = None,
    software: Annotated[
        str | None,
        typer.Option(
            "--software", metavar="VERSION", help="Version to announce, like 3.15.8 or 5.12.0."
        ),
    ] = None,
    programs: Annotated[
        Path | None,
        typer.Option(
            "--programs",
            metavar="DIR",
            help="Programs for the dashboard's load: work.script for `load work.urp`.",
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option("--truth", metavar="FILE", help="Write the simulated arm's true parameters."),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="FILE", help="Write, at the end, how time was kept."),
    ] = None,
    expose: Annotated[
        bool,
        typer.Option(_FOREIGN, help="Allow a --host that other machines can reach."),
    ] = False,
    parent: Annotated[int | None, typer.Option("--parent", hidden=True)] = None,
    json: JsonFlag = False,
) -> None:
    """A simulated UR controller: RTDE, script ports, dashboard.

    It has a real arm's dynamics behind it and listens on UR's own ports 29999 and 30001 to 30004
    until Ctrl-C. With --json, one object on stdout tells when clients can connect.
    """
    address = _address(host, expose=expose)
    announced = None if software is None else _version(software)

    from dynid.cli.output import check_output, print_json
    from dynid.workflow import parse_thermal

    state = parse_thermal(thermal)
    for where, path in (("--truth", truth), ("--report", report)):
        if path is not None:
            check_output(path, where=where)

    from dynid.simulation import ControllerOptions, serve

    options = ControllerOptions(
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
        if json:
            print_json(about)
            sys.stdout.flush()
        pace = "virtual time" if virtual_time else "real time"
        ports = ", ".join(f"{name} {port}" for name, port in about["ports"].items())
        print(
            f"dynid controller: {about['robot']}, software {about['version']}, "
            f"{about['rate_hz']:g} Hz, {pace}, at {address}: {ports}. Ctrl-C ends it.",
            file=sys.stderr,
            flush=True,
        )

    serve(options, sys.stderr, ready)


def _address(host: str, *, expose: bool) -> str:
    """The address to listen on.

    Raises:
        InputError: It is no IPv4 address, or other machines can reach it.
    """
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
                next_step=f"Use 127.0.0.x, or add {_FOREIGN} if you mean it",
            )
        print(
            f"dynid controller: warning: {address} can be reached from other machines; "
            "the protocols know no password",
            file=sys.stderr,
        )
    return str(address)


def _version(text: str) -> tuple[int, int, int]:
    """The numbers of a version.

    Raises:
        InputError: It is none.
    """
    parts = text.split(".")
    if not 2 <= len(parts) <= 3 or not all(part.isdigit() and len(part) < 4 for part in parts):
        raise InputError(
            "this is no software version", where="--software", value=text, limit="like 3.15.8"
        )
    major, minor, bugfix, *_ = (*map(int, parts), 0)
    return major, minor, bugfix
