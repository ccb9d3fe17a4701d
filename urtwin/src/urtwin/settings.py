"""What to simulate and where: the settings of a controller, each declared once, and its ports.

The fields are the options of the command. Clients cannot be told other ports.
"""

import ipaddress
import os
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer

from dynid.core import InputError
from dynid.protocol import dashboard, rtde

PRIMARY, SECONDARY, REALTIME = 30001, 30002, 30003
INTERPRETER = 30020
"""Takes statements for the running program while it is in interpreter mode."""
PORTS = {
    "dashboard": dashboard.PORT,
    "primary": PRIMARY,
    "secondary": SECONDARY,
    "realtime": REALTIME,
    "rtde": rtde.PORT,
    "interpreter": INTERPRETER,
}
READ_ONLY = {30011: PRIMARY, 30012: SECONDARY, 30013: REALTIME}
"""Ports that send what another does, and do not listen."""
CB_HZ, E_SERIES_HZ = 125.0, 500.0
E_SERIES = 5
"""First major version of the e-Series' software: clients take their rate from it."""


def option(told: str, metavar: str, **more: Any) -> Any:
    """An option with a value."""
    return typer.Option(metavar=metavar, help=told, **more)


def flag(name: str, told: str) -> Any:
    """An option without a value."""
    return typer.Option(name, help=told)


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerSettings:
    """What to simulate, and where; an `InputError` names the option that cannot be."""

    robot: Annotated[str, option("Built-in name, URDF or robot file.", "ROBOT")] = "ur5"
    host: Annotated[
        str,
        option(
            "Where to listen; each controller needs an address of its own, 127.0.0.1 to "
            "127.255.255.254.",
            "ADDRESS",
        ),
    ] = "127.0.0.1"
    thermal: Annotated[str, option("cold, warm, or joint temperatures in degC.", "STATE")] = "cold"
    virtual_time: Annotated[
        bool, flag("--virtual-time", "Time advances as fast as the clients read.")
    ] = False
    hold: Annotated[bool, flag("--hold", "Time starts when the first client has started RTDE.")] = (
        False
    )
    seed: Annotated[int, option("Seed of the random numbers.", "N", min=0)] = 0
    rate: Annotated[
        float | None,
        option("125 (CB-Series) or 500 (e-Series). [default: by --software or the name]", "HZ"),
    ] = None
    """None: 500 for software of the e-Series, else for robots whose name ends in `e`."""
    software: Annotated[
        str | None, option("Version to announce, like 3.15.8 or 5.12.0.", "VERSION")
    ] = None
    """None: the one usual for the rate."""
    programs: Annotated[
        Path | None,
        option("Programs for the dashboard's load: work.script for `load work.urp`.", "DIR"),
    ] = None
    truth: Annotated[Path | None, option("Write the simulated arm's true parameters.", "FILE")] = (
        None
    )
    report: Annotated[
        Path | None, option("Write, at the end, the timing of the control cycles.", "FILE")
    ] = None
    expose: Annotated[bool, flag("--expose", "Allow a --host that other machines can reach.")] = (
        False
    )
    parent: Annotated[int | None, typer.Option(hidden=True)] = None
    """The process without which the controller ends; None: it stays."""
    start: str | float = field(init=False)
    """The thermal state: `cold`, `warm` or joint temperatures [degC]."""
    version: tuple[int, int, int] | None = field(init=False)
    """The numbers of `software`."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "host", _address(self.host, expose=self.expose))
        version = None if self.software is None else _version(self.software)
        object.__setattr__(self, "version", version)
        object.__setattr__(self, "start", _thermal(self.thermal))
        for where, path in (("--truth", self.truth), ("--report", self.report)):
            if path is not None and os.path.exists(path):
                raise InputError(
                    "the file exists, and nothing is replaced",
                    where=where,
                    value=str(path),
                    next_step="Name another file.",
                )
            if path is not None and not os.path.isdir(path.parent):
                raise InputError(
                    "the output's directory does not exist",
                    where=where,
                    value=str(path.parent),
                    next_step=f"Run: mkdir -p {path.parent}",
                )
        if self.rate is not None and self.rate not in (CB_HZ, E_SERIES_HZ):
            raise InputError(
                "no UR controller has this control rate",
                value=f"{self.rate:g} Hz",
                limit=f"{CB_HZ:g} Hz (CB-Series) or {E_SERIES_HZ:g} Hz (e-Series)",
            )


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
