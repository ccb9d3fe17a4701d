"""Lists what release 0.1 can do, as rows of `inventory.json`; run it with that release on the path.

    PYTHONPATH=V010/src python tests/frozen/list_features.py tests/frozen/inventory.json

Formats and repairs have no table in release 0.1: their rows are the names of what
`recorded_files.py` writes. The table `left` of an existing file is kept.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from typing import Any

import recorded_files
import typer


def table(module: str, name: str) -> Any:
    """A table of a module of release 0.1."""
    return getattr(importlib.import_module(f"dynid.{module}"), name)


def command_line() -> dict[str, list[str]]:
    """Commands and their options, with a number of values that each takes."""
    commands: dict[str, Any] = {}

    def walk(prefix: str, group: Any) -> None:
        for name, command in group.commands.items():
            commands[f"{prefix}{name}"] = command
            if hasattr(command, "commands"):
                walk(f"{prefix}{name} ", command)

    walk("", typer.main.get_command(table("cli.app", "build")()))
    options = [
        f"{name} {word}{'' if option.is_flag else ' VALUE'}"
        for name, command in commands.items()
        for option in command.params
        if option.param_type_name == "option"
        for word in option.opts
        if word not in ("--help", "-h")
    ]
    return {"command": list(commands), "option": options}


def ur_interface() -> dict[str, list[str]]:
    """Variables of RTDE with their types, dashboard commands, functions of URScript."""
    session = table("simulation.controller.dashboard", "DashboardSession")
    machine = table("simulation.controller.machine", "ControllerMachine")(
        table("simulation.library", "simulated_arm")(table("robot.load", "load_robot")("ur5e")),
        rate_hz=500.0,
        version=(5, 25, 0, 0),
    )
    dashboard = session(machine, "UR5", "0", lambda _: None)
    builtins = table("simulation.controller.machine_builtins", "BUILTINS")
    fields = {side: table("protocol.fields", side) for side in ("OUTPUTS", "INPUTS")}
    return {
        "rtde output": [f"{f.name} {f.type.name}" for f in fields["OUTPUTS"].values()],
        "rtde input": [f"{f.name} {f.type.name}" for f in fields["INPUTS"].values()],
        "dashboard": [*dashboard._answers, *(f"{word} x" for word in dashboard._with_text)],
        "script line": [*table("simulation.controller.commands", "_COMMANDS"), "set speed 0.5"],
        "urscript": [f"{b.name}({', '.join(['0'] * b.required)})" for b in builtins.values()],
        "urscript method": [
            f"{name}({', '.join(['0'] * count)})"
            for name, (_, count) in table(
                "simulation.controller.urscript.methods", "METHODS"
            ).items()
        ],
    }


def main(path: Path) -> None:
    """Write the rows."""
    api = importlib.import_module("dynid")
    left = json.loads(path.read_text())["left"] if path.exists() else {}
    rows = {
        **command_line(),
        "name": list(api.__all__),
        "robot": [robot.name for robot in api.robots()],
        "format word": list(table("recording.detect", "FORMATS")),
        "format": list(recorded_files.FORMATS),
        "repair": list(recorded_files.REPAIRS),
        "code": sorted(table("core.notices", "CODES")),
        "export": list(table("export.writing", "FORMATS")),
        "criterion": list(table("excitation.criteria", "CRITERIA")),
        "trajectory": list(table("trajectory.families", "FAMILY_NAMES")),
        "trajectory file": [
            "fourier",
            "fourier-quintic",
            "bspline",
            "quintic",
            "sequence",
            "repetition",
        ],
        "motion export": ["--csv", "--urscript", "--ros"],
        "estimator": list(table("identification.registry", "ESTIMATORS")),
        "term": list(table("regressor.terms", "TERMS")),
        **ur_interface(),
    }
    text = ",\n".join(f" {json.dumps(kind)}: {json.dumps(found)}" for kind, found in rows.items())
    path.write_text(
        f'{{"version": "{api.__version__}",\n"rows": {{\n{text}\n}},\n'
        f'"left": {json.dumps(left, indent=1)}}}\n'
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
