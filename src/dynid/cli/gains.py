"""`dynid gains`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from dynid.cli.options import JsonFlag, RobotOption, examples


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "gains",
        epilog=examples("dynid gains run.parquet", "dynid gains log.csv --robot ur10 --json"),
    )(_gains)


def _gains(
    record: Annotated[
        Path,
        typer.Argument(metavar="RECORD", help="A recording with target currents and moments."),
    ],
    robot: RobotOption = None,
    json: JsonFlag = False,
) -> None:
    """Drive gains, from the controller's own targets (UR)."""
    from dynid.cli.output import console, number, print_json, print_notices, print_table
    from dynid.workflow import identify_gains, open_records

    (opened,), model = open_records([record], robot)
    found = identify_gains(opened, model)
    data: dict[str, Any] = {"robot": model.name, **found.to_json(model.joint_names)}
    if json:
        print_json(data)
        return
    screen = console()
    rows = [
        (
            row["joint"],
            *(number(row[key]) for key in ("gain", "std")),
            number(float(model.drives.gain[j])),
            number(row["r2"], 6),
        )
        for j, row in enumerate(data["gains"])
    ]
    columns = ("joint", "gain", "std", "robot's", "r2")
    print_table(screen, "Drive gains [N.m/A]", columns, rows)
    if all(row["gain"] is not None for row in data["gains"]):
        screen.print()
        screen.print("--gains " + ",".join(f"{row['gain']:.4f}" for row in data["gains"]))
    print_notices(screen, "Warnings", data["findings"])
