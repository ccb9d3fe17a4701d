"""`dynid check`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynid.cli.options import JsonFlag, examples

if TYPE_CHECKING:
    from dynid.workflow import Check


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "check",
        epilog=examples(
            "dynid check design.json",
            "dynid check design.json --scene cell.json --json",
        ),
    )(_check)


def _check(
    design: Annotated[Path, typer.Argument(metavar="DESIGN.json", help="A design or trajectory.")],
    limits: Annotated[
        str,
        typer.Option(
            metavar="safe|paper", help="safe: all that is known; paper: q, dq and ddq alone."
        ),
    ] = "safe",
    scene: Annotated[
        Path | None,
        typer.Option(metavar="SCENE.json", help="What stands around; default: the design's scene."),
    ] = None,
    no_collision: Annotated[
        bool, typer.Option("--no-collision", help="Do not look at collisions.")
    ] = False,
    robot: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="If the design's robot file has moved.")
    ] = None,
    mount: Annotated[
        str | None,
        typer.Option(
            metavar="floor|wall|ceiling|tilt:DEG", help="Mounting; default: the design's."
        ),
    ] = None,
    json: JsonFlag = False,
) -> int:
    """Certify limits and collisions, between samples too."""
    from dynid.cli.output import print_json
    from dynid.workflow import check

    result = check(
        design, limits=limits, scene=scene, collision=not no_collision, robot=robot, mount=mount
    )
    if json:
        print_json(result.to_json())
    else:
        _show(result)
    return 0 if result.feasible else 1


def _show(result: Check) -> None:
    from dynid.cli.certificate_table import print_certificate
    from dynid.cli.output import console

    data = result.to_json()
    screen = console()
    verdict = "feasible" if result.feasible else f"NOT feasible: {', '.join(data['broken'])}"
    screen.print(f"{data['robot']}, {data['duration_s']:g} s: {verdict}", style="bold")
    if data["designed_for"] not in (None, data["limits"]):
        screen.print(f"designed with --limits {data['designed_for']}, held to {data['limits']}")
    print_certificate(screen, data)
