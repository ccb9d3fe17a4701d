"""`dynid`: the commands, and the one place where an error becomes an exit code."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from dynid import __version__
from dynid.cli import (
    analyze,
    bench,
    check,
    compare,
    controller,
    demo,
    design,
    export,
    gains,
    identify,
    importing,
    payload,
    report,
    robots,
    run,
    studio,
    validate,
)
from dynid.cli.failures import exit_code_of, guard_streams

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
    app = typer.Typer(
        help=SUMMARY,
        add_completion=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
        pretty_exceptions_enable=False,
        invoke_without_command=True,
        epilog="\b\nExample:\n  dynid analyze ur5\n  dynid demo -o runs/demo",
    )
    app.callback()(_root)
    for module in (
        robots,
        analyze,
        design,
        check,
        controller,
        run,
        importing,
        identify,
        validate,
        compare,
        gains,
        payload,
        bench,
        export,
        report,
        studio,
        demo,
    ):
        module.register(app)
    return app


def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        typer.echo(f"dynid {__version__}")
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())
