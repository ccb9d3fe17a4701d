"""`dynid import`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from dynid.cli.options import JsonFlag, examples
from dynid.core import InputError

FORMATS = "auto|ur-csv|ur-rtde-csv|csv|rosbag|mcap|mat|npz|hdf5|json|parquet"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "import",
        epilog=examples(
            "dynid import run.csv --robot ur5 -o run.parquet",
            "dynid import log.txt --columns t=0,q=1:7,current=7:13 --robot ur5 -o log.parquet",
            "dynid import bag.db3 --robot ur10 -o bag.parquet",
        ),
    )(_import)


def _import(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="One recording, or text files side by side."),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="RECORD.parquet", help="What to write.")
    ],
    robot: Annotated[
        str | None,
        typer.Option(metavar="ROBOT", help="Built-in name, URDF or robot file."),
    ] = None,
    format: Annotated[
        str, typer.Option(metavar=FORMATS, help="What the file is; auto goes by its content.")
    ] = "auto",
    columns: Annotated[
        str | None,
        typer.Option(
            metavar="t=0,q=1:7,...",
            help="Columns from 0, ranges exclude their end; header names; .mat paths (q=rec.pos).",
        ),
    ] = None,
    no_header: Annotated[
        bool, typer.Option("--no-header", help="The first line is numbers.")
    ] = False,
    delimiter: Annotated[
        str | None, typer.Option(metavar=",", help="A character, or comma, semicolon, tab, space.")
    ] = None,
    gains: Annotated[
        str | None, typer.Option(metavar="g1,..,gn", help="Drive gains of this recording [N.m/A].")
    ] = None,
    rate: Annotated[
        float | None, typer.Option(metavar="HZ", help="The clock of a file without time stamps.")
    ] = None,
    degrees: Annotated[
        bool, typer.Option("--degrees", help="Angles are in degrees, where the file does not say.")
    ] = False,
    joint_order: Annotated[
        str | None,
        typer.Option(metavar="0,2,1,...", help="The file's joints base to tip: numbers or names."),
    ] = None,
    topic: Annotated[
        str | None, typer.Option(metavar="NAME", help="The bag's topic, of any type.")
    ] = None,
    json: JsonFlag = False,
) -> None:
    """A foreign recording becomes ours: checked and repaired."""
    from dynid.cli.output import check_output, print_json
    from dynid.workflow import ImportOptions, import_recording

    check_output(output, inputs=files, suffix=".parquet")
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
    )
    if json:
        print_json(imported.to_json())
    else:
        _show(imported.to_json())


def parse_gains(text: str | None) -> tuple[float, ...] | None:
    """Drive gains from `13.6,13.7,...`.

    Raises:
        InputError: Not numbers with commas between.
    """
    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(
            "must be numbers with commas between", where="--gains", value=text
        ) from error


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
