"""`dynid`: the commands, and the one place where an error becomes an exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated

import typer

from dynid import __version__
from dynid.cli.design_commands import check_command, design_command
from dynid.cli.estimate_commands import fit_command, identify_command, validate_command
from dynid.cli.options import Command, Commands, exit_code_of, flag, guard_streams
from dynid.cli.record_commands import import_command, register_controller, run_command
from dynid.cli.result_commands import (
    demo_command,
    export_command,
    fleet_command,
    register_bench,
    report_command,
    studio_command,
)
from dynid.cli.robot_commands import (
    analyze_command,
    compare_command,
    gains_command,
    payload_command,
    robots_command,
)

SUMMARY = "Identify the dynamics of a robot arm: inertias, friction, motor inertia, uncertainty."


_COMMANDS: Mapping[str, Command | Callable[[typer.Typer], None]] = {
    "robots": robots_command,
    "analyze": analyze_command,
    "fit": fit_command,
    "design": design_command,
    "check": check_command,
    "controller": register_controller,
    "run": run_command,
    "import": import_command,
    "identify": identify_command,
    "validate": validate_command,
    "compare": compare_command,
    "gains": gains_command,
    "payload": payload_command,
    "export": export_command,
    "report": report_command,
    "fleet": fleet_command,
    "studio": studio_command,
    "demo": demo_command,
    "bench": register_bench,
}
"""In the order of a job, as the help page lists them."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: The words after `dynid`; None for those of the process.

    Returns:
        0 on success, 2 on bad usage or input, 1 when the job failed, 130 on Ctrl-C.
    """
    guard_streams()
    words = list(sys.argv[1:] if arguments is None else arguments)
    return exit_code_of(lambda: _run(words))


def _run(words: list[str]) -> int:
    outcome = typer.main.get_command(build())(words, prog_name="dynid", standalone_mode=False)
    sys.stdout.flush()
    return outcome if isinstance(outcome, int) else 0


def build() -> typer.Typer:
    """The application with all its commands."""
    app = Commands(
        help=SUMMARY,
        add_completion=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
        pretty_exceptions_enable=False,
        invoke_without_command=True,
        epilog="\b\nExample:\n  dynid analyze ur5\n  dynid demo -o runs/demo",
    )
    app.callback()(_root)
    for name, item in _COMMANDS.items():
        if isinstance(item, Command):
            app.command(name, epilog=item.epilog)(item.run)
        else:
            item(app)
    return app


def _root(
    context: typer.Context,
    version: Annotated[bool, flag("--version", "Print the version.")] = False,
) -> None:
    if version:
        typer.echo(f"dynid {__version__}")
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())
