"""`dynid controller`: starts urtwin, the simulated UR controller, which declares the options."""

from __future__ import annotations

import typer

from dynid.core import MissingExtraError


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "controller",
        help="A simulated UR controller: RTDE, script ports, dashboard.",
        context_settings={
            "help_option_names": [],
            "ignore_unknown_options": True,
            "allow_extra_args": True,
        },
    )(_controller)


def _controller(context: typer.Context) -> None:
    try:
        from urtwin.command import run_command
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            "the simulated controller is a distribution of its own, urtwin, which is not installed",
            next_step="In dynid's repository: pip install ./urtwin",
        ) from error

    run_command(context.args, "dynid controller")
