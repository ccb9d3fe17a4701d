"""Options that several commands share, each defined once."""

from __future__ import annotations

from typing import Annotated

import typer

JsonFlag = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
RobotOption = Annotated[
    str | None,
    typer.Option(
        "--robot",
        metavar="ROBOT",
        help="Built-in name, URDF or robot file; default: what the recording says.",
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
TemperatureOption = Annotated[
    float | None,
    typer.Option(
        "--at", metavar="DEGC", help="Temperature of the joints, of a file with temperature laws."
    ),
]


def examples(*lines: str) -> str:
    """The end of a help page: command lines to copy."""
    return "\b\nExample:\n" + "\n".join(f"  {line}" for line in lines)
