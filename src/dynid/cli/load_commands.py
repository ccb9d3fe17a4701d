"""Commands about loads and changes: `dynid gains`, `dynid payload`, `dynid compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynid.cli.options import GainsOption, JsonFlag, RobotOption, examples, parse_gains

if TYPE_CHECKING:
    from rich.console import Console

    from dynid.validation import ParameterComparison


def register_gains(app: typer.Typer) -> None:
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


def register_payload(app: typer.Typer) -> None:
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
    gains: GainsOption = None,
    json: JsonFlag = False,
) -> None:
    """Mass, centre and inertia of a payload, with intervals."""
    from dynid.cli.output import console, number, print_json, print_notices, print_table
    from dynid.workflow import identify_payload, open_records

    (empty, carrying), model = open_records([unloaded, loaded], robot, parse_gains(gains))
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


def register_compare(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "compare",
        epilog=examples("dynid compare cold.json warm.json", "dynid compare a.json b.json --json"),
    )(_compare)


def _compare(
    a: Annotated[Path, typer.Argument(metavar="A.json", help="An estimate, such as the cold.")],
    b: Annotated[Path, typer.Argument(metavar="B.json", help="Another, such as the warm.")],
    json: JsonFlag = False,
) -> None:
    """Which parameters moved between two estimates (paper 3.2)."""
    from dynid.cli.output import console, print_json
    from dynid.workflow import compare_files

    comparison = compare_files(a, b)
    if json:
        print_json(comparison.to_json())
    else:
        _print_comparison(console(), comparison)


def _print_comparison(screen: Console, comparison: ParameterComparison) -> None:
    from dynid.cli.output import number, print_notices, print_table

    rows = [
        (
            comparison.names[k],
            comparison.units[k],
            number(float(comparison.a[k])),
            number(float(comparison.b[k])),
            number(float(comparison.change_percent[k]), 3),
            number(float(comparison.z[k]), 3),
        )
        for k in range(len(comparison.names))
    ]
    columns = ("parameter", "unit", "A", "B", "change %", "z")
    print_table(screen, "Base parameters, z = change in sigmas", columns, rows, words=(0, 1))
    groups = [
        (
            group.name,
            "moved" if group.moved else "did not move",
            str(len(group.members)),
            number(group.median_change_percent, 3),
            "-" if group.largest is None else comparison.names[group.largest],
            number(group.largest_z, 3),
            number(group.limit_z, 3),
        )
        for group in comparison.groups
    ]
    columns = ("group", "", "number", "median %", "largest", "|z|", "limit")
    print_table(screen, "Groups", columns, groups, words=(0, 1, 4))
    print_notices(screen, "Warnings", [notice.to_json() for notice in comparison.warnings])
