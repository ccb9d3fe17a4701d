"""`dynid report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dynid.cli.options import JsonFlag, examples


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("report", epilog=examples("dynid report runs/demo -o report.html"))(_report)


def _report(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="Estimates, recordings and designs.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE.html", help="The page to write.")
    ] = Path("report.html"),
    json: JsonFlag = False,
) -> None:
    """One self-contained page, with the verdict first."""
    from dynid.cli.output import check_output, console, print_json
    from dynid.cli.progress import progress_bar
    from dynid.workflow import report

    check_output(output, suffix=".html")
    with progress_bar("report") as progress:
        path, contents = report(directory, output, progress=progress)
    if json:
        print_json(
            {
                "file": str(path),
                "bytes": path.stat().st_size,
                "estimates": [item.name for item in contents.estimates],
                "skipped": [list(pair) for pair in contents.skipped],
            }
        )
        return
    screen = console()
    for item in contents.estimates:
        screen.print(f"{item.name}: {item.headline}", style="bold")
    for name, why in contents.skipped:
        screen.print(f"- left out: {name} ({why})", soft_wrap=True)
    screen.print(f"Written: {path}", soft_wrap=True)
