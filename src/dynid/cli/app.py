"""`dynid`: the commands, and the one place where an error becomes an exit code."""

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Annotated

import typer

from dynid import __version__
from dynid.cli import ask, estimate_commands, motion_commands, result_commands, robot_commands

SUMMARY = "Identify the dynamics of a robot arm: inertias, friction, motor inertia, uncertainty."


_COMMANDS: Mapping[str, ask.Command | Callable[[typer.Typer], None]] = {
    "robots": robot_commands.robots_command,
    "analyze": robot_commands.analyze_command,
    "fit": estimate_commands.fit_command,
    "design": motion_commands.design_command,
    "check": motion_commands.check_command,
    "controller": motion_commands.register_controller,
    "run": motion_commands.run_command,
    "import": motion_commands.import_command,
    "identify": estimate_commands.identify_command,
    "validate": estimate_commands.validate_command,
    "compare": robot_commands.compare_command,
    "gains": robot_commands.gains_command,
    "payload": robot_commands.payload_command,
    "gravity": robot_commands.gravity_command,
    "export": result_commands.export_command,
    "report": result_commands.report_command,
    "fleet": result_commands.fleet_command,
    "studio": result_commands.studio_command,
    "demo": result_commands.demo_command,
    "bench": result_commands.register_bench,
}
"""In the order of a job, as the help page lists them."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: The words after `dynid`; None for those of the process.

    Returns:
        0 on success, 2 on bad usage or input, 1 when the job failed, 130 on Ctrl-C.
    """
    ask.guard_streams()
    words = list(sys.argv[1:] if arguments is None else arguments)
    return ask.exit_code_of(lambda: _run(words))


def _run(words: list[str]) -> int:
    outcome = _command()(words, prog_name="dynid", standalone_mode=False)
    sys.stdout.flush()
    return outcome if isinstance(outcome, int) else 0


@cache
def _command() -> Callable[..., object]:
    return typer.main.get_command(build())


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
    for name, item in _COMMANDS.items():
        if isinstance(item, ask.Command):
            app.command(name, cls=ask.GroupedCommand, epilog=item.epilog)(item.run)
        else:
            item(app)
    return app


def _root(
    context: typer.Context,
    version: Annotated[bool, ask.flag("--version", "Print the version.")] = False,
) -> None:
    if version:
        typer.echo(f"dynid {__version__}")
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())
