"""Commands about recordings: `dynid run`, `dynid import`, `dynid controller`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from dynid.cli.options import (
    DesignArgument,
    FloorOption,
    ForceFlag,
    GainsOption,
    JsonFlag,
    MeshDirOption,
    MountOption,
    MovedRobotOption,
    PayloadOption,
    RecordOutput,
    SceneOption,
    SeedOption,
    ToolOption,
    argument,
    carried,
    command,
    flag,
    numbers,
    option,
)
from dynid.cli.output import (
    check_output,
    console,
    count,
    number,
    print_json,
    print_notices,
    progress_bar,
)
from dynid.core import InputError, MissingExtraError


@command(
    "dynid run design.json --on sim -o run.parquet",
    "dynid run design.json --on sim -o warm.parquet --thermal warm --seed 1",
    "dynid run design.json --on sim -o run.parquet --until 2",
    "dynid run design.json --on ur://192.168.0.10 -o run.parquet --slow 0.2",
)
def run_command(
    design: DesignArgument,
    output: RecordOutput,
    on: Annotated[str, option("sim|ur://HOST", "The robot that executes it.")] = "sim",
    repeat: Annotated[int, option("N", "Periods to record.", min=1)] = 3,
    thermal: Annotated[
        str, option("cold|warm|DEGC", "Set in the simulation; of a real robot, recorded only.")
    ] = "cold",
    yes: Annotated[bool, flag("--yes", "Move without confirmation.")] = False,
    slow: Annotated[
        float | None, option("SHARE", "First pass at a share of the speed, such as 0.2.")
    ] = None,
    settle: Annotated[
        bool, flag("--settle", "Move one period first that is not recorded.")
    ] = False,
    warm_up: Annotated[float, option("SECONDS", "Repeat the motion first.", min=0.0)] = 0.0,
    method: Annotated[
        str, option("program|servoj", "With ur://: on the controller, or streamed.")
    ] = "program",
    robot: MovedRobotOption = None,
    mount: MountOption = None,
    scene: SceneOption = None,
    mesh_dir: MeshDirOption = None,
    floor: FloorOption = None,
    tool: ToolOption = None,
    payload: PayloadOption = None,
    accept_unjudged: Annotated[
        list[str] | None,
        option("KIND", "Move although this limit cannot be checked, such as self-collision."),
    ] = None,
    until: Annotated[
        float | None,
        option("PERCENT", "Design, run and identify in turn, until this torque error is reached."),
    ] = None,
    force: ForceFlag = False,
    seed: SeedOption = 0,
    json: JsonFlag = False,
) -> None:
    """Execute a design and record it (paper 2.2, 3)."""
    from dynid.experiment import stop_on_signals
    from dynid.workflow import RunSettings, parse_thermal, run_design, run_until

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
        accept_unjudged=tuple(accept_unjudged or ()),
        force=force,
        **carried(floor, tool, payload, mesh_dir),
    )
    confirm = None if yes else _ask
    check_output(output, inputs=[design], suffix=".parquet")
    with stop_on_signals() as cancel, progress_bar("run") as progress:
        if until is not None:
            rounds = run_until(
                design,
                output,
                until,
                on=on,
                settings=settings,
                confirm=confirm,
                cancel=cancel,
                progress=progress,
            )
            if json:
                print_json(rounds.to_json())
            else:
                console().print(rounds.describe(), soft_wrap=True)
            rounds.raise_if_missed()
            return
        result = run_design(
            design,
            output,
            on=on,
            settings=settings,
            confirm=confirm,
            cancel=cancel,
            progress=progress,
        )
    if (said := result.design.describe_digest()) is not None and result.design.changed:
        print(f"dynid: {design}: {said}", file=sys.stderr)
    if json:
        print_json(result.to_json())
    elif result.abort is None:
        outcome = result.result.outcome
        parts = zip(
            (outcome.samples, outcome.periods, outcome.gaps),
            ("sample", "whole period", "gap"),
            strict=True,
        )
        console().print(", ".join(count(number, noun) for number, noun in parts))
        console().print(f"Recording: {result.record}", soft_wrap=True)
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
    console(stderr=True).print(what)
    with interruptible():
        typed = typer.prompt(f"Type {word} to move the robot", default="", err=True)
    if typed.strip() != word:
        raise InputError("the motion was not confirmed", value=typed.strip(), limit=word)


FORMATS = "auto|ur-csv|ur-rtde-csv|csv|rosbag|mcap|mat|npz|hdf5|json|parquet"


@command(
    "dynid import run.csv --robot ur5 -o run.parquet",
    "dynid import log.txt --columns t=0,q=1:7,current=7:13 --robot ur5 -o log.parquet",
    "dynid import bag.db3 --robot ur10 -o bag.parquet",
)
def import_command(
    files: Annotated[
        list[Path], argument("FILE", "One recording, or text files to be joined by columns.")
    ],
    output: RecordOutput,
    robot: Annotated[str | None, option("ROBOT", "Built-in name, URDF or robot file.")] = None,
    format: Annotated[str, option(FORMATS, "Format of the file; auto: by its content.")] = "auto",
    columns: Annotated[
        str | None,
        option(
            "t=0,q=1:7,...",
            "Columns from 0, ranges exclude their end; header names; .mat paths (q=rec.pos).",
        ),
    ] = None,
    no_header: Annotated[
        bool, flag("--no-header", "The first line has numbers, no names.")
    ] = False,
    delimiter: Annotated[
        str | None, option(",", "A character, or comma, semicolon, tab, space.")
    ] = None,
    gains: GainsOption = None,
    rate: Annotated[float | None, option("HZ", "The clock of a file without time stamps.")] = None,
    degrees: Annotated[bool, flag("--degrees", "Angles without a unit are in degrees.")] = False,
    joint_order: Annotated[
        str | None, option("0,2,1,...", "The file's joints base to tip: numbers or names.")
    ] = None,
    topic: Annotated[str | None, option("NAME", "The bag's topic, of any type.")] = None,
    force: ForceFlag = False,
    json: JsonFlag = False,
) -> None:
    """Convert a recording: checked and repaired."""
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
            gains=numbers(gains, "--gains"),
            rate_hz=rate,
            degrees=degrees,
            joint_order=None if joint_order is None else tuple(joint_order.split(",")),
            topic=topic,
        ),
        force=force,
    )
    data, screen = imported.to_json(), console()
    if json:
        print_json(data)
        return
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
