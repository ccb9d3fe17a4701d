"""`dynid run`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynid.cli.options import JsonFlag, SeedOption, examples

if TYPE_CHECKING:
    from dynid.workflow import Run


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "run",
        epilog=examples(
            "dynid run design.json --on sim -o run.parquet",
            "dynid run design.json --on sim -o warm.parquet --thermal warm --seed 1",
            "dynid run design.json --on ur://192.168.0.10 -o run.parquet --slow 0.2",
        ),
    )(_run)


def _run(
    design: Annotated[Path, typer.Argument(metavar="DESIGN.json", help="A design or trajectory.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="RECORD.parquet", help="The recording.")
    ],
    on: Annotated[str, typer.Option(metavar="sim|ur://HOST", help="What moves.")] = "sim",
    repeat: Annotated[int, typer.Option(metavar="N", min=1, help="Periods to record.")] = 3,
    thermal: Annotated[
        str, typer.Option(metavar="cold|warm|DEGC", help="Set if simulated, else noted down.")
    ] = "cold",
    yes: Annotated[bool, typer.Option("--yes", help="Move without asking.")] = False,
    slow: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="First pass at a share of the speed, as 0.2."),
    ] = None,
    settle: Annotated[
        bool, typer.Option("--settle", help="Move one period first that is not recorded.")
    ] = False,
    warm_up: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.0, help="Repeat the motion first.")
    ] = 0.0,
    method: Annotated[
        str,
        typer.Option(metavar="program|servoj", help="With ur://: on the controller, or streamed."),
    ] = "program",
    robot: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="If the design's robot file has moved.")
    ] = None,
    mount: Annotated[
        str | None, typer.Option(metavar="floor|wall|ceiling|tilt:DEG", help="If not the design's.")
    ] = None,
    scene: Annotated[
        str | None, typer.Option(metavar="SCENE.json", help="Surroundings, if not the design's.")
    ] = None,
    payload: Annotated[
        str | None, typer.Option(metavar="KG[,X,Y,Z]", help="Mass [kg] and its centre [m].")
    ] = None,
    seed: SeedOption = 0,
    json: JsonFlag = False,
) -> None:
    """Execute a design and record it (paper 2.2, 3)."""
    from dynid.cli.output import check_output, print_json
    from dynid.cli.progress import progress_bar
    from dynid.experiment import stop_on_signals
    from dynid.workflow import RunSettings, parse_payload, parse_thermal, run_design

    settings = RunSettings(
        repeat=repeat,
        settle=settle,
        slow=slow,
        warm_up_s=warm_up,
        thermal=parse_thermal(thermal),
        seed=seed,
        method=method,
        robot=robot,
        mount=mount,
        scene=scene,
        payload=parse_payload(payload),
    )
    check_output(output, inputs=[design], suffix=".parquet")
    with stop_on_signals() as cancel, progress_bar("run") as progress:
        result = run_design(
            design,
            output,
            on=on,
            settings=settings,
            confirm=None if yes else _ask,
            cancel=cancel,
            progress=progress,
        )
    if json:
        print_json(result.to_json())
    elif result.abort is None:
        _print(result)
    result.raise_if_aborted()


def _ask(what: str, word: str) -> None:
    """Let a person type a word before anything moves.

    Raises:
        InputError: Nobody is there to ask, or another word was typed.
    """
    from dynid.cli.output import console
    from dynid.core import InputError
    from dynid.experiment import interruptible

    if not sys.stdin.isatty():
        raise InputError("nobody is there to confirm the motion", next_step="Pass --yes.")
    console(stderr=True).print(what)
    with interruptible():
        typed = typer.prompt(f"Type {word} to move the robot", default="", err=True)
    if typed.strip() != word:
        raise InputError("the motion was not confirmed", value=typed.strip(), limit=word)


def _print(result: Run) -> None:
    from dynid.cli.output import console, count

    outcome = result.result.outcome
    parts = ((outcome.samples, "sample"), (outcome.periods, "whole period"), (outcome.gaps, "gap"))
    console().print(", ".join(count(number, noun) for number, noun in parts))
    console().print(f"Recording: {result.record}", soft_wrap=True)
