"""Commands about recordings: `dynid run`, `dynid import`, `dynid controller`."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from dynid.cli import options as ask
from dynid.cli import output as show
from dynid.core import InputError, MissingExtraError
from dynid.settings import ImportOptions, RunSettings


@ask.command(
    "dynid run design.json --on sim -o run.parquet",
    "dynid run design.json --on sim -o warm.parquet --thermal warm --seed 1",
    "dynid run design.json --on sim -o run.parquet --until 2",
    "dynid run design.json --on ur://192.168.0.10 -o run.parquet --slow 0.2",
)
def run_command(
    design: ask.DesignArgument,
    output: ask.RecordOutput,
    settings: RunSettings,
    on: Annotated[str, ask.option("sim|ur://HOST", "The robot that executes it.")] = "sim",
    yes: Annotated[bool, ask.flag("--yes", "Move without confirmation.")] = False,
    until: Annotated[
        float | None,
        ask.option(
            "PERCENT", "Design, run and identify in turn, until this torque error is reached."
        ),
    ] = None,
    json: ask.JsonFlag = False,
) -> None:
    """Execute a design and record it (paper 2.2, 3)."""
    from dynid.experiment import stop_on_signals
    from dynid.workflow import run_design, run_until

    confirm = None if yes else _ask
    show.check_output(output, inputs=[design], suffix=".parquet")
    with stop_on_signals() as cancel, show.progress_bar("run") as progress:
        given: dict[str, Any] = {"on": on, "settings": settings, "confirm": confirm}
        given |= {"cancel": cancel, "progress": progress}
        if until is not None:
            rounds = run_until(design, output, until, **given)
            if json:
                show.print_json(rounds.to_json())
            else:
                show.console().print(rounds.describe(), soft_wrap=True)
            rounds.raise_if_missed()
            return
        result = run_design(design, output, **given)
    if (said := result.design.describe_digest()) is not None and result.design.changed:
        print(f"dynid: {design}: {said}", file=sys.stderr)
    if json:
        show.print_json(result.to_json())
    elif result.abort is None:
        outcome = result.result.outcome
        parts = zip(
            (outcome.samples, outcome.periods, outcome.gaps),
            ("sample", "whole period", "gap"),
            strict=True,
        )
        show.console().print(", ".join(show.count(many, noun) for many, noun in parts))
        show.console().print(f"Recording: {result.record}", soft_wrap=True)
    result.raise_if_aborted()


def _ask(what: str, word: str) -> None:
    """Let a person type a word before anything moves.

    Raises:
        InputError: Nobody is there to ask, or another word was typed.
    """
    from dynid.experiment import interruptible

    if not sys.stdin.isatty():
        raise InputError(
            "the motion needs confirmation, and there is no terminal", next_step="Pass --yes."
        )
    show.console(stderr=True).print(what)
    with interruptible():
        typed = typer.prompt(f"Type {word} to move the robot", default="", err=True)
    if typed.strip() != word:
        raise InputError("the motion was not confirmed", value=typed.strip(), limit=word)


@ask.command(
    "dynid import run.csv --robot ur5 -o run.parquet",
    "dynid import log.txt --columns t=0,q=1:7,current=7:13 --robot ur5 -o log.parquet",
    "dynid import bag.db3 --robot ur10 -o bag.parquet",
)
def import_command(
    files: Annotated[
        list[Path], ask.argument("FILE", "One recording, or text files to be joined by columns.")
    ],
    output: ask.RecordOutput,
    settings: ImportOptions,
    robot: Annotated[str | None, ask.option("ROBOT", "Built-in name, URDF or robot file.")] = None,
    force: ask.ForceFlag = False,
    json: ask.JsonFlag = False,
) -> None:
    """Convert a recording: checked and repaired."""
    from dynid.workflow import import_recording

    show.check_output(output, inputs=files, suffix=".parquet", force=force)
    imported = import_recording(files, output, robot=robot, options=settings, force=force)
    data, screen = imported.to_json(), show.console()
    if json:
        show.print_json(data)
        return
    screen.print(f"{data['record']}: {data['samples']} samples", style="bold")
    screen.print(
        f"{show.number(data['duration_s'])} s at {show.number(data['rate_hz'])} Hz, "
        f"{data['joints']} joints, read as {data['format']}, robot {data['robot'] or 'not given'}"
    )
    screen.print(f"signals: {', '.join(data['signals'])}")
    if data["dropped_rows"]:
        screen.print(f"dropped rows: {data['dropped_rows']}")
    if data["notes"]:
        screen.print(f"notes: {data['notes']}")
    show.print_notices(screen, "Problems found", data["findings"])
    if not data["problems"]:
        screen.print("no problems found")
    for need in data["needs"]:
        screen.print(f"dynid identify needs more: {need}", style="bold")


def register_controller(app: typer.Typer) -> None:
    """Add the command: it starts urtwin, the simulated UR controller, which has the options."""
    passed_on: dict[str, Any] = {
        "help_option_names": [],
        "ignore_unknown_options": True,
        "allow_extra_args": True,
    }
    told = "A simulated UR controller: RTDE, script ports, dashboard."
    app.command("controller", help=told, context_settings=passed_on)(_controller)


def _controller(context: typer.Context) -> None:
    try:
        from urtwin.command import run_command
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            "the simulated controller is a distribution of its own, urtwin, which is not installed",
            next_step="In dynid's repository: pip install ./urtwin",
        ) from error

    run_command(context.args, "dynid controller")
