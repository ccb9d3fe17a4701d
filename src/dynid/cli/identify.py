"""`dynid identify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dynid.cli.options import JsonFlag, RobotOption, StartOption, StopOption, examples


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        "identify",
        epilog=examples(
            "dynid identify run.parquet -o ur5.json --validate other.parquet",
            "dynid identify run.parquet -o ur5.json --to 14 --validate-from 14",
            "dynid identify run.parquet -o paper.json --preset paper --json",
        ),
    )(_identify)


def _identify(
    records: Annotated[
        list[Path], typer.Argument(metavar="RECORD", help="Recordings of one robot.")
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="ESTIMATE.json", help="Where the estimate goes."),
    ] = None,
    robot: RobotOption = None,
    estimator: Annotated[
        str | None,
        typer.Option(
            metavar="ols|wls|irls|tls|iv|ml|didim|sdp|bayes|rls",
            help="Default: as the preset says. sdp: bodies that can exist.",
        ),
    ] = None,
    terms: Annotated[
        str | None,
        typer.Option(
            metavar="fc,fv,im[,..]",
            help="Friction terms, each for all joints or for some; default: as the preset says.",
        ),
    ] = None,
    preset: Annotated[
        str,
        typer.Option(
            metavar="paper|best",
            help="paper: to the letter; best: choose by cross-validation inside the record.",
        ),
    ] = "best",
    cutoff: Annotated[
        float | None, typer.Option(metavar="HZ", help="Low-pass cut-off; default: from the data.")
    ] = None,
    weighting: Annotated[
        str,
        typer.Option(metavar="joint|size", help="One noise a joint, or one for joints of a size."),
    ] = "joint",
    start: StartOption = None,
    stop: StopOption = None,
    validation: Annotated[
        Path | None, typer.Option("--validate", metavar="RECORD", help="Another record to predict.")
    ] = None,
    validation_start: Annotated[
        float | None, typer.Option("--validate-from", metavar="S", help="Start of its window.")
    ] = None,
    validation_stop: Annotated[
        float | None, typer.Option("--validate-to", metavar="S", help="End of its window.")
    ] = None,
    json: JsonFlag = False,
) -> None:
    """Parameters from recordings, with uncertainty (paper 3)."""
    from dynid.cli.identification_text import print_identification
    from dynid.cli.output import check_output, console, print_json
    from dynid.cli.progress import progress_bar
    from dynid.regressor import parse_terms
    from dynid.workflow import IdentifySettings, identify_files, verdict

    settings = IdentifySettings(
        preset=preset,
        estimator=estimator,
        terms=None if terms is None else parse_terms(terms),
        cutoff_hz=cutoff,
        start_s=start,
        stop_s=stop,
        weighting=weighting,
    )
    if output is not None:
        inputs = [*records, *([] if validation is None else [validation])]
        check_output(output, inputs=inputs, suffix=".json")
    with progress_bar("identify") as progress:
        result = identify_files(
            records,
            output,
            robot=robot,
            settings=settings,
            validation=validation,
            validation_start_s=validation_start,
            validation_stop_s=validation_stop,
            progress=progress,
        )
    if json:
        written = None if output is None else str(output)
        print_json({**result.to_json(), "verdict": verdict(result).to_json(), "estimate": written})
    else:
        print_identification(console(), result, output)
