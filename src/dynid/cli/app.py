"""`dynid`: the commands, and the one place where an error becomes an exit code."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from dynid import __version__
from dynid.cli.design_commands import register_check, register_design
from dynid.cli.estimate_commands import register_fit, register_identify, register_validate
from dynid.cli.options import Commands, exit_code_of, guard_streams
from dynid.cli.record_commands import register_controller, register_import, register_run
from dynid.cli.result_commands import (
    register_bench,
    register_demo,
    register_export,
    register_fleet,
    register_report,
    register_studio,
)
from dynid.cli.robot_commands import (
    register_analyze,
    register_compare,
    register_gains,
    register_payload,
    register_robots,
)

SUMMARY = "Identify the dynamics of a robot arm: inertias, friction, motor inertia, uncertainty."


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
    for register in (
        register_robots,
        register_analyze,
        register_fit,
        register_design,
        register_check,
        register_controller,
        register_run,
        register_import,
        register_identify,
        register_validate,
        register_compare,
        register_gains,
        register_payload,
        register_export,
        register_report,
        register_fleet,
        register_studio,
        register_demo,
        register_bench,
    ):
        register(app)
    return app


def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        typer.echo(f"dynid {__version__}")
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())
