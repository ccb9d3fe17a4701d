"""`dynid export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dynid.cli.options import JsonFlag, TemperatureOption, examples


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "export",
        epilog=examples(
            "dynid export ur5.json --to urdf -o ur5.urdf",
            "dynid export ur5.json --to c -o ur5_dynamics.h --json",
        ),
    )(_export)


def _export(
    estimate: Annotated[
        Path, typer.Argument(metavar="ESTIMATE.json", help="What dynid identify wrote.")
    ],
    to: Annotated[
        str,
        typer.Option(
            metavar="urdf|mjcf|json|c|python",
            help="c: one C99 header; python: one file that needs NumPy alone.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="Where the model goes.")
    ],
    at: TemperatureOption = None,
    json: JsonFlag = False,
) -> None:
    """A model that other programs load, checked by loading it."""
    from dynid.cli.output import check_output, console, number, print_json, print_notices
    from dynid.workflow import check_suffix, export_file

    check_output(output, [estimate])
    check_suffix(to, output)
    result = export_file(estimate, to, output, at_degC=at)
    if json:
        print_json(result.to_json())
        return
    screen, verified = console(), result.written.verified
    screen.print(f"{to} model written to {output}", soft_wrap=True)
    if verified.max_torque_difference is None:
        screen.print(f"Not verified: {verified.loaded_with}.")
    else:
        screen.print(
            f"Verified with {verified.loaded_with}: torques differ by "
            f"{number(verified.max_torque_difference)} at most in {verified.states} random states."
        )
    screen.print(f"Standard parameters: {result.written.model.origin}.")
    if result.written.left_out:
        screen.print(f"Without a place in {to}: {', '.join(result.written.left_out)}.")
    print_notices(screen, "Warnings", [notice.to_json() for notice in result.warnings])
