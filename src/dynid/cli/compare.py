"""`dynid compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynid.cli.options import JsonFlag, examples

if TYPE_CHECKING:
    from rich.console import Console

    from dynid.validation import ParameterComparison


def register(app: typer.Typer) -> None:
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
        _print(console(), comparison)


def _print(screen: Console, comparison: ParameterComparison) -> None:
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
