"""Commands about recordings: `dynid run`, `dynid import`, `dynid controller`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynid.cli.options import (
    FloorOption,
    ForceFlag,
    GainsOption,
    JsonFlag,
    MeshDirOption,
    PayloadOption,
    SeedOption,
    ToolOption,
    command,
    parse_gains,
)
from dynid.core import InputError, MissingExtraError

if TYPE_CHECKING:
    from dynid.workflow import Run, RunUntil


@command(
    "dynid run design.json --on sim -o run.parquet",
    "dynid run design.json --on sim -o warm.parquet --thermal warm --seed 1",
    "dynid run design.json --on sim -o run.parquet --until 2",
    "dynid run design.json --on ur://192.168.0.10 -o run.parquet --slow 0.2",
)
def run_command(
    design: Annotated[Path, typer.Argument(metavar="DESIGN.json", help="A design or trajectory.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="RECORD.parquet", help="The recording.")
    ],
    on: Annotated[
        str, typer.Option(metavar="sim|ur://HOST", help="The robot that executes it.")
    ] = "sim",
    repeat: Annotated[int, typer.Option(metavar="N", min=1, help="Periods to record.")] = 3,
    thermal: Annotated[
        str,
        typer.Option(
            metavar="cold|warm|DEGC", help="Set in the simulation; of a real robot, recorded only."
        ),
    ] = "cold",
    yes: Annotated[bool, typer.Option("--yes", help="Move without confirmation.")] = False,
    slow: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="First pass at a share of the speed, such as 0.2."),
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
    mesh_dir: MeshDirOption = None,
    floor: FloorOption = None,
    tool: ToolOption = None,
    payload: PayloadOption = None,
    accept_unjudged: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND",
            help="Move although this limit cannot be checked, such as self-collision.",
        ),
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            metavar="PERCENT",
            help="Design, run and identify in turn, until this torque error is reached.",
        ),
    ] = None,
    force: ForceFlag = False,
    seed: SeedOption = 0,
    json: JsonFlag = False,
) -> None:
    """Execute a design and record it (paper 2.2, 3)."""
    from dynid.cli.output import check_output, print_json, progress_bar
    from dynid.experiment import stop_on_signals
    from dynid.workflow import (
        RunSettings,
        mesh_folders,
        parse_floor,
        parse_payload,
        parse_thermal,
        parse_tool,
        run_design,
        run_until,
    )

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
        mesh_dirs=mesh_folders(mesh_dir),
        floor=parse_floor(floor),
        tool=parse_tool(tool),
        payload=parse_payload(payload),
        accept_unjudged=tuple(accept_unjudged or ()),
        force=force,
    )
    check_output(output, inputs=[design], suffix=".parquet")
    with stop_on_signals() as cancel, progress_bar("run") as progress:
        if until is not None:
            rounds = run_until(
                design,
                output,
                until,
                on=on,
                settings=settings,
                confirm=None if yes else _ask,
                cancel=cancel,
                progress=progress,
            )
            _told(rounds, json=json)
            return
        result = run_design(
            design,
            output,
            on=on,
            settings=settings,
            confirm=None if yes else _ask,
            cancel=cancel,
            progress=progress,
        )
    if (said := result.design.describe_digest()) is not None and result.design.changed:
        print(f"dynid: {design}: {said}", file=sys.stderr)
    if json:
        print_json(result.to_json())
    elif result.abort is None:
        _print(result)
    result.raise_if_aborted()


def _told(rounds: RunUntil, *, json: bool) -> None:
    from dynid.cli.output import console, print_json

    if json:
        print_json(rounds.to_json())
    else:
        console().print(rounds.describe(), soft_wrap=True)
    rounds.raise_if_missed()


def _ask(what: str, word: str) -> None:
    """Let a person type a word before anything moves.

    Raises:
        InputError: Nobody is there to ask, or another word was typed.
    """
    from dynid.cli.output import console
    from dynid.experiment import interruptible

    if not sys.stdin.isatty():
        raise InputError(
            "the motion needs confirmation, and there is no terminal", next_step="Pass --yes."
        )
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


FORMATS = "auto|ur-csv|ur-rtde-csv|csv|rosbag|mcap|mat|npz|hdf5|json|parquet"


@command(
    "dynid import run.csv --robot ur5 -o run.parquet",
    "dynid import log.txt --columns t=0,q=1:7,current=7:13 --robot ur5 -o log.parquet",
    "dynid import bag.db3 --robot ur10 -o bag.parquet",
)
def import_command(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE", help="One recording, or text files to be joined by columns."
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="RECORD.parquet", help="File to write.")
    ],
    robot: Annotated[
        str | None,
        typer.Option(metavar="ROBOT", help="Built-in name, URDF or robot file."),
    ] = None,
    format: Annotated[
        str, typer.Option(metavar=FORMATS, help="Format of the file; auto: by its content.")
    ] = "auto",
    columns: Annotated[
        str | None,
        typer.Option(
            metavar="t=0,q=1:7,...",
            help="Columns from 0, ranges exclude their end; header names; .mat paths (q=rec.pos).",
        ),
    ] = None,
    no_header: Annotated[
        bool, typer.Option("--no-header", help="The first line has numbers, no names.")
    ] = False,
    delimiter: Annotated[
        str | None, typer.Option(metavar=",", help="A character, or comma, semicolon, tab, space.")
    ] = None,
    gains: GainsOption = None,
    rate: Annotated[
        float | None, typer.Option(metavar="HZ", help="The clock of a file without time stamps.")
    ] = None,
    degrees: Annotated[
        bool, typer.Option("--degrees", help="Angles without a unit are in degrees.")
    ] = False,
    joint_order: Annotated[
        str | None,
        typer.Option(metavar="0,2,1,...", help="The file's joints base to tip: numbers or names."),
    ] = None,
    topic: Annotated[
        str | None, typer.Option(metavar="NAME", help="The bag's topic, of any type.")
    ] = None,
    force: ForceFlag = False,
    json: JsonFlag = False,
) -> None:
    """Convert a recording: checked and repaired."""
    from dynid.cli.output import check_output, print_json
    from dynid.workflow import ImportOptions, import_recording

    check_output(output, inputs=files, suffix=".parquet", force=force)
    imported = import_recording(
        files,
        output,
        robot=robot,
        options=ImportOptions(
            format=format,
            columns=columns,
            header=False if no_header else None,
            delimiter=delimiter,
            gains=parse_gains(gains),
            rate_hz=rate,
            degrees=degrees,
            joint_order=None if joint_order is None else tuple(joint_order.split(",")),
            topic=topic,
        ),
        force=force,
    )
    if json:
        print_json(imported.to_json())
    else:
        _show(imported.to_json())


def _show(data: Mapping[str, Any]) -> None:
    from dynid.cli.output import console, number, print_notices

    screen = console()
    screen.print(f"{data['record']}: {data['samples']} samples", style="bold")
    screen.print(
        f"{number(data['duration_s'])} s at {number(data['rate_hz'])} Hz, {data['joints']} joints, "
        f"read as {data['format']}, robot {data['robot'] or 'not given'}"
    )
    screen.print(f"signals: {', '.join(data['signals'])}")
    if data["dropped_rows"]:
        screen.print(f"dropped rows: {data['dropped_rows']}")
    if data["notes"]:
        screen.print(f"notes: {data['notes']}")
    print_notices(screen, "Problems found", data["findings"])
    if not data["problems"]:
        screen.print("no problems found")
    for need in data["needs"]:
        screen.print(f"dynid identify needs more: {need}", style="bold")


def register_controller(app: typer.Typer) -> None:
    """Add the command: it starts urtwin, the simulated UR controller, which has the options."""
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
