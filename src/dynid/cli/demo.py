"""`dynid demo`."""

from __future__ import annotations

from typing import Annotated

import typer

from dynid.cli.options import JsonFlag, examples


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "demo", epilog=examples("dynid demo -o runs/demo", "dynid demo -o runs/demo --quick --json")
    )(_demo)


def _demo(
    output: Annotated[
        str, typer.Option("-o", "--output", metavar="DIR", help="Where the files go.")
    ] = "runs/demo",
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="One repetition of each motion, not three, and a shorter search for them.",
        ),
    ] = False,
    json: JsonFlag = False,
) -> None:
    """The whole paper on the simulated UR5, cold and warm."""
    from dynid.cli.output import console, number, print_json, print_notices, print_table
    from dynid.cli.progress import progress_bar
    from dynid.workflow import run_demo, verdict

    with progress_bar("demo") as progress:
        demo = run_demo(output, quick=quick, progress=progress)
    if json:
        print_json(demo.to_json())
        return
    screen = console()
    screen.print(verdict(demo.best).headline, style="bold")
    print_table(
        screen,
        "The paper's UR5 beside the simulated UR5",
        ("quantity", "unit", "paper", "preset paper", "preset best"),
        [
            (
                row.quantity,
                row.unit,
                number(row.paper),
                number(row.preset_paper),
                number(row.preset_best),
            )
            for row in demo.table
        ],
        words=(0, 1),
    )
    for row in demo.table:
        if row.note:
            screen.print(f"- {row.quantity}: {row.note}")
    screen.print("\nChoices of preset best", style="bold")
    for choice in demo.best.estimate.choices:
        screen.print(f"- {choice}")
    print_notices(
        screen, "Warnings of preset best", [notice.to_json() for notice in demo.best.warnings]
    )
    screen.print(f"\nFiles, after {demo.wall_s:.0f} s", style="bold")
    for path in demo.files:
        screen.print(f"- {path}", soft_wrap=True)
