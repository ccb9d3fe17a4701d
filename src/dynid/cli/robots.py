"""`dynid robots`."""

from __future__ import annotations

import typer

from dynid.cli.options import JsonFlag, examples


def register(app: typer.Typer) -> None:
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
