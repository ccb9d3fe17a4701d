"""Commands about robots: `dynid robots`, `dynid analyze`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import typer

from dynid.cli.options import JsonFlag, SeedOption, examples


def register_robots(app: typer.Typer) -> None:
    """Add the command."""
    app.command("robots", epilog=examples("dynid robots", "dynid robots --json"))(_robots)


def _robots(json: JsonFlag = False) -> None:
    """List the built-in robots."""
    from dynid.cli.output import console, print_json, print_table
    from dynid.robot import robots

    found = robots()
    if json:
        print_json({"robots": [robot._asdict() for robot in found]})
        return
    screen = console()
    print_table(
        screen,
        "Built-in robots",
        ("name", "joints", "arm"),
        [(robot.name, str(robot.joints), _arm(robot.source)) for robot in found],
        words=range(3),
    )
    screen.print("\nWhere each number is from: dynid robots --json")
    screen.print("Any other arm: give a URDF or a robot file (TOML) in the place of the name.")


def _arm(source: str) -> str:
    """The part of the source that names the arm: its first."""
    return source.split("; ", 1)[0]


MAX_SAMPLES = 10_000


def register_analyze(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "analyze",
        epilog=examples(
            "dynid analyze ur5",
            "dynid analyze ur5 --mount wall --terms fc,fv,im,fo",
            "dynid analyze arm.urdf --frames dh --json",
        ),
    )(_analyze)


def _analyze(
    robot: Annotated[
        str, typer.Argument(metavar="ROBOT", help="Built-in name, URDF or robot file.")
    ],
    frames: Annotated[
        str, typer.Option(metavar="dh|mdh|urdf", help="Frames of the parameters; default: its own.")
    ] = "",
    mount: Annotated[
        str | None,
        typer.Option(metavar="floor|wall|ceiling|tilt:DEG", help="Mounting; default: the file's."),
    ] = None,
    samples: Annotated[
        int,
        typer.Option(metavar="N", min=1, max=MAX_SAMPLES, help="Random points of the regressor."),
    ] = 25,
    seed: SeedOption = 0,
    terms: Annotated[
        str,
        typer.Option(
            metavar="fc,fv,im[,fo]", help="Also fca, fva, fs, fr; fo:1+3 is for joints 1 and 3."
        ),
    ] = "fc,fv,im",
    everything: Annotated[
        bool, typer.Option("--all", help="Print every base parameter with its unit.")
    ] = False,
    json: JsonFlag = False,
) -> None:
    """Rank and base parameters of a robot (paper 2.1)."""
    from dynid.cli.output import print_json
    from dynid.robot import load_robot
    from dynid.workflow import analyze

    model = load_robot(robot, mount=mount)
    result = analyze(model, frames=frames, samples=samples, seed=seed, terms=terms)
    if json:
        print_json(result.to_json())
    else:
        _show(result.to_json(), everything)


MOST_ROWS = 18
"""Combinations that are printed unasked."""


def _show(data: Mapping[str, Any], everything: bool) -> None:
    from dynid.cli.output import console, print_notices, print_table

    screen = console()
    screen.print(
        f"{data['robot']}: {data['standard_parameters']} standard parameters, "
        f"{data['base_parameters']} base parameters",
        style="bold",
    )
    before, after = data["gap"]
    screen.print(
        f"identifiable alone {data['identifiable_alone']}, in combination "
        f"{data['identifiable_combined']}, not at all {data['unidentifiable']}; "
        f"{data['frames']} frames, mounting {data['mount']}, terms {data['terms']}, "
        f"{data['samples']} random points"
    )
    screen.print(f"the rank is clear: singular values fall from {before:.1e} to {after:.1e}")
    rows = list(zip(data["expressions"], data["units"], strict=True))
    alone = [name for name, e in zip(data["names"], data["expressions"], strict=True) if name == e]
    if not everything:
        screen.print()
        screen.print(f"Identifiable alone ({len(alone)}): {', '.join(alone)}")
        rows = [row for row in rows if row[0] not in alone]
    shown = rows if everything else [(_shortened(e), unit) for e, unit in rows[:MOST_ROWS]]
    title = "Base parameters" if everything else f"Identifiable in combination ({len(rows)})"
    print_table(screen, title, ("combination", "unit"), shown, words=range(2))
    if not everything:
        screen.print("--all prints every combination in full")
    screen.print()
    screen.print("Not identifiable: " + (", ".join(data["unidentifiable_names"]) or "none"))
    for note in data["notes"]:
        screen.print(f"- {note}.")
    print_notices(screen, "Warnings", data["findings"])


def _shortened(expression: str, longest: int = 62) -> str:
    """As many terms of a combination as fit on a line."""
    if len(expression) <= longest:
        return expression
    return expression[: expression.rfind(" ", 0, longest - 4)] + " ..."
