"""`dynid payload`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from dynid.cli.options import JsonFlag, RobotOption, examples


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "payload",
        epilog=examples(
            "dynid payload empty.parquet gripper.parquet",
            "dynid payload empty.parquet gripper.parquet --robot ur5 --json",
        ),
    )(_payload)


def _payload(
    unloaded: Annotated[
        Path, typer.Argument(metavar="UNLOADED", help="A recording without the payload.")
    ],
    loaded: Annotated[
        Path, typer.Argument(metavar="LOADED", help="One with it, best of the same motion.")
    ],
    robot: RobotOption = None,
    cutoff: Annotated[
        float | None, typer.Option(metavar="HZ", help="Low-pass cut-off; default: chosen.")
    ] = None,
    json: JsonFlag = False,
) -> None:
    """Mass, centre and inertia of a payload, with intervals."""
    from dynid.cli.output import console, number, print_json, print_notices, print_table
    from dynid.workflow import identify_payload, open_records

    (empty, carrying), model = open_records([unloaded, loaded], robot)
    found = identify_payload(empty, carrying, model, cutoff_hz=cutoff)
    data: dict[str, Any] = {"robot": model.name, **found.to_json()}
    if json:
        print_json(data)
        return
    screen = console()
    rows = [("mass", "kg", number(found.mass), number(found.mass_std))]
    rows += [
        (f"centre {axis}", "m", number(float(place)), number(float(std)))
        for axis, place, std in zip("xyz", found.centre, found.centre_std, strict=True)
    ]
    rows += [
        (row["name"], row["unit"], number(row["value"]), number(row["std"]))
        for row in data["parameters"][4:]
    ]
    columns = ("quantity", "unit", "value", "std")
    print_table(screen, "Payload, in the flange frame", columns, rows, words=(0, 1))
    print_notices(screen, "Warnings", data["findings"])
