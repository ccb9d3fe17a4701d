"""`dynid validate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dynid.cli.options import JsonFlag, StartOption, StopOption, TemperatureOption, examples


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "validate",
        epilog=examples(
            "dynid validate ur5.json other_motion.parquet",
            "dynid validate ur5.json run.parquet --from 10 --to 20 --json",
        ),
    )(_validate)


def _validate(
    estimate: Annotated[
        Path, typer.Argument(metavar="ESTIMATE.json", help="What dynid identify wrote.")
    ],
    record: Annotated[
        Path, typer.Argument(metavar="RECORD", help="A recording that was not identified from.")
    ],
    start: StartOption = None,
    stop: StopOption = None,
    at: TemperatureOption = None,
    json: JsonFlag = False,
) -> None:
    """Prediction error on another recording (paper 3.1)."""
    from dynid.cli.metrics_table import print_metrics
    from dynid.cli.output import console, print_json, print_notices
    from dynid.workflow import estimate_at, validate_files

    result = validate_files(estimate, record, start_s=start, stop_s=stop, at_degC=at)
    if json:
        print_json(result.to_json())
        return
    screen = console()
    slides = estimate_at(estimate, at).model.robot.prismatic
    print_metrics(screen, "Prediction", result, slides)
    print_notices(screen, "Warnings", [notice.to_json() for notice in result.warnings])
