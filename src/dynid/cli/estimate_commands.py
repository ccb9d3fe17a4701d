"""Commands about estimates: `dynid fit`, `dynid identify`, `dynid validate`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from dynid.cli import ask, show
from dynid.settings import IdentifySettings

if TYPE_CHECKING:
    from rich.console import Console

    from dynid import validation, workflow


def print_metrics(
    screen: Console, title: str, result: validation.ValidationResult, prismatic: Sequence[bool]
) -> None:
    """Print the errors of a prediction, joint by joint and overall."""
    from dynid import figures, validation

    unit = figures.joint_unit("N.m", prismatic)
    whole, moving, rest = result.metrics, result.moving, result.at_rest
    relative = (whole.relative_error_percent, moving.relative_error_percent)
    shown = (whole.rmse, moving.rmse, rest.rmse, *relative, whole.r2)
    names = ("RMS", "moving", "at rest", "rel. %", "moving %", "R2")
    rows = list(zip(range(1, len(whole.rmse) + 1), *shown, strict=True))
    columns = {"joint": None} | dict.fromkeys(names, 3)
    show.print_table(screen, f"{title}: RMS errors in {unit}", columns, rows)
    for kind, (every, swift) in validation.errors_by_kind(
        result.measured, result.predicted, result.moves, prismatic
    ).items():
        screen.print(
            f"{kind} joints: {_shares(every, swift)}; "
            f"e_N {show.number(every.normalized_error, 3)} "
            f"{figures.joint_unit('N.m', [kind == 'sliding'] if kind != 'all' else prismatic)} "
            f"with N = {every.samples}"
        )
    if result.covered is not None:
        held = " ".join(f"{100 * share:.0f}" for share in result.covered)
        screen.print(f"90 % intervals hold {held} % of the torques of joints 1 to {len(rows)}")


def _shares(every: validation.Metrics, moving: validation.Metrics) -> str:
    whole, swift = (show.number(e.relative_error_overall_percent, 3) for e in (every, moving))
    return f"{whole} % of the torque, {swift} % while moving"


COLOURS = {"usable": "bold green", "care": "bold yellow", "do_not_use": "bold red"}
FINDING_LINES = 12
"""Lines for findings that are printed unasked, strongest first, less one a joint."""


def print_identification(
    screen: Console, result: workflow.Identification, *, everything: bool
) -> None:
    """Print the verdict, the errors and the findings; all parameters and choices if asked to."""
    from dynid import identification, validation, workflow

    estimate, judged = result.estimate, workflow.verdict(result)
    screen.print(judged.headline, style=COLOURS[judged.level])
    screen.print()
    screen.print(
        f"{estimate.model.robot.name}: {len(estimate.values)} base parameters from "
        f"{estimate.samples} samples, estimator {estimate.estimator}, preset {estimate.preset}, "
        f"{estimate.model.frames} frames"
    )
    screen.print(
        f"condition number of the motion {show.number(estimate.motion_condition_number, 3)}: "
        "errors of torque grow at most by this factor on other motions at its speeds (good: "
        f"below {identification.ILL_CONDITIONED:.0f})"
    )
    if result.accuracy is not None:
        screen.print(result.accuracy.describe())
    if everything:
        for choice in estimate.choices:
            screen.print(f"- {choice}")
        _print_parameters(screen, result)
    slides = estimate.model.robot.prismatic
    if result.validation is None or everything:
        print_metrics(screen, "Training", result.training, slides)
    else:
        own = result.training
        known = own.measured, own.predicted, own.moves
        for kind, parts in validation.errors_by_kind(*known, slides).items():
            whose = "" if kind == "all" else f", {kind} joints"
            screen.print(f"its own recording{whose}: {_shares(*parts)}")
    if result.validation is not None:
        print_metrics(screen, "Validation", result.validation, slides)
    shown = list(result.warnings)
    if not everything:
        shown = [finding for finding in shown if finding.severity != "info"]
        shown = sorted(shown, key=lambda finding: finding.severity != "error")
    room = FINDING_LINES - len(slides)
    told = len(shown) if everything else show.fitting(screen, shown, room)
    show.print_findings(screen, "Findings", shown[:told])
    if not everything:
        screen.print()
        more = len(result.warnings) - told
        rest = f", {show.count(more, 'more finding')}" if more > 0 else ""
        if told < len(shown):
            rest += f", {len(shown) - told} to look at before use"
        screen.print(f"--all also prints parameters, deviations, choices{rest}")


def _print_parameters(screen: Console, result: workflow.Identification) -> None:
    """Base parameters, and consistent standard ones where the estimator finds them."""
    columns = {"combination": None, "value": 4, "std": 2, "std %": 3, "unit": None, "": None}
    keys = ("expression", "value", "std", "relative_std_percent", "unit")
    rows = [
        (*map(row.get, keys), "" if row["essential"] else "not essential")
        for row in result.estimate.parameter_table()
    ]
    show.print_table(screen, "Base parameters", columns, rows)
    table = result.estimate.standard_table()
    if table is None:
        return
    columns = {"name": None, "value": 4, "std": 2, "prior": 4, "unit": None, "from": None}
    rows = [
        (
            row["name"],
            row["value"],
            row["std"] if row["from"] == "data" else "",
            "" if row["prior"] is None else row["prior"],
            row["unit"],
            row["from"],
        )
        for row in table
    ]
    title = "Standard parameters, physically consistent (from: mostly data or mostly the prior)"
    show.print_table(screen, title, columns, rows)


AllFlag = Annotated[bool, ask.flag("--all", "Print all parameters, choices and findings.")]


@ask.command(
    "dynid fit arm.urdf log.csv -o fitted",
    "dynid fit ur5 monday.csv tuesday.csv --validate wednesday.csv -o fitted",
    "dynid fit ur10e log.csv --gains 11.2,11.4,9.8,10.1,10.2,9.9 -o fitted --json",
    only=("preset", "purpose", "mount"),
)
def fit_command(
    robot: ask.RobotArgument,
    logs: Annotated[
        list[Path],
        ask.argument("LOG", "Recordings of any format, or folders with the files of one run."),
    ],
    output: Annotated[Path, ask.option("DIR", "Folder for all results.", "-o", "--output")],
    settings: IdentifySettings,
    validation: Annotated[
        Path | None, ask.option("LOG", "Another log to predict.", "--validate")
    ] = None,
    gains: ask.GainsOption = None,
    everything: AllFlag = False,
    json: ask.JsonFlag = False,
) -> None:
    """From logs to verdict, models and report in one command."""
    from dynid.workflow import fit

    with show.progress_bar("fit") as progress:
        result = fit(
            robot,
            logs,
            output,
            validation=validation,
            gains=ask.drive_gains(gains),
            settings=settings,
            progress=progress,
        )
    if json:
        show.print_json(result.to_json())
        return
    screen = show.console()
    print_identification(screen, result.identification, everything=everything)
    if "targets" in result.gains_from:
        screen.print("Drive gains were found from the target currents and moments in the log.")
    for export in result.models:
        check = export.verified
        unchecked = "" if check.passed else f" (torques not compared: {check.loaded_with})"
        copied = "" if export.source is None else f", a copy of {export.source}"
        screen.print(f"{export.to}: {export.path}{copied}{unchecked}", soft_wrap=True)
    for to, reason in result.not_exported:
        screen.print(f"{to}: not written: {reason}", soft_wrap=True)
    screen.print(f"estimate: {result.estimate}", soft_wrap=True)
    screen.print(f"Next: open {result.report}", soft_wrap=True)


@ask.command(
    "dynid identify run.parquet -o ur5.json --validate other.parquet",
    "dynid identify run.parquet -o ur5.json --to 14 --validate-from 14",
    "dynid identify run.parquet -o paper.json --preset paper --json",
)
def identify_command(
    records: Annotated[
        list[str], ask.argument("RECORD", "Recordings of one robot: paths, or s3://...")
    ],
    settings: IdentifySettings,
    output: Annotated[
        Path | None, ask.option("ESTIMATE.json", "Where the estimate goes.", "-o", "--output")
    ] = None,
    robot: ask.RobotOption = None,
    validation: Annotated[
        str | None, ask.option("RECORD", "Another record to predict.", "--validate")
    ] = None,
    validation_start: Annotated[
        float | None, ask.option("S", "Start of its window.", "--validate-from")
    ] = None,
    validation_stop: Annotated[
        float | None, ask.option("S", "End of its window.", "--validate-to")
    ] = None,
    gains: ask.GainsOption = None,
    jobs: ask.JobsOption = 1,
    dask: ask.DaskOption = None,
    force: ask.ForceFlag = False,
    everything: AllFlag = False,
    json: ask.JsonFlag = False,
) -> None:
    """Parameters from recordings, with uncertainty (paper 3)."""
    from dynid.workflow import identify_files, verdict

    if output is not None:
        inputs = [*records, *([] if validation is None else [validation])]
        show.check_output(output, inputs=map(Path, inputs), suffix=".json", force=force)
    estimator = settings.estimator or ("ols" if settings.preset == "paper" else "wls")
    if settings.weighting != "joint" and estimator != "wls":
        print(f"dynid: --weighting is not used by --estimator {estimator}", file=sys.stderr)
    if settings.purpose != "anywhere" and settings.preset == "paper":
        print("dynid: --for is not used by --preset paper", file=sys.stderr)
    kept = None if output is None else Path(f"{output}.partial")
    with show.progress_bar("identify") as progress, ask.kept_in(kept):
        result = identify_files(
            records,
            output,
            robot=robot,
            settings=settings,
            validation=validation,
            validation_start_s=validation_start,
            validation_stop_s=validation_stop,
            gains=ask.drive_gains(gains),
            jobs=jobs,
            dask=dask,
            progress=progress,
        )
    if json:
        written = None if output is None else str(output)
        judged = verdict(result).to_json()
        show.print_json({**result.to_json(), "verdict": judged, "estimate": written})
    else:
        screen = show.console()
        print_identification(screen, result, everything=everything)
        if output is None:
            screen.print("Nothing was written; keep the estimate with -o ESTIMATE.json")
        else:
            screen.print(f"Estimate written to {output}", soft_wrap=True)


@ask.command(
    "dynid validate ur5.json other_motion.parquet",
    "dynid validate ur5.json run.parquet --from 10 --to 20 --json",
)
def validate_command(
    estimate: ask.EstimateArgument,
    record: Annotated[Path, ask.argument("RECORD", "A recording that was not identified from.")],
    start: ask.StartOption = None,
    stop: ask.StopOption = None,
    at: ask.TemperatureOption = None,
    gains: ask.GainsOption = None,
    refit: Annotated[
        str | None,
        ask.option("friction", "Identify friction again from this recording; inertias stay."),
    ] = None,
    output: Annotated[
        Path | None, ask.option("FILE", "Write the refitted estimate here.", "--output", "-o")
    ] = None,
    force: ask.ForceFlag = False,
    json: ask.JsonFlag = False,
) -> None:
    """Prediction error on another recording (paper 3.1)."""
    from dynid import diagnosis, figures, identification, validation, workflow

    if output is not None:
        show.check_output(output, inputs=[estimate, record], force=force)

    result = workflow.validate_files(
        estimate,
        record,
        start_s=start,
        stop_s=stop,
        at_degC=at,
        gains=ask.drive_gains(gains),
        refit=refit,
        output=output,
    )
    if json:
        show.print_json(result.to_json())
        return
    screen = show.console()
    slides = identification.open_estimate(estimate, at).model.robot.prismatic
    told: list[str] = []
    for kind, parts in validation.errors_by_kind(
        result.measured, result.predicted, result.moves, slides
    ).items():
        whole, moving = (f"{show.number(e.relative_error_overall_percent, 3)} %" for e in parts)
        before = " to " if kind == "all" else f", {kind} joints to "
        told.append(before + diagnosis.with_rests(moving, whole))
    screen.print(f"Predicts the torque of this recording{''.join(told)}", style="bold")
    print_metrics(screen, "Prediction", result, slides)
    if result.transfer is not None:
        split = result.transfer
        show.print_table(
            screen,
            f"Error by cause: RMS in {figures.joint_unit('N.m', slides)}",
            {"joint": None} | dict.fromkeys((*validation.CAUSES, "rest"), 3),
            [(j + 1, *split.rms[:, j], split.rest[j]) for j in range(len(split.rest))],
        )
    show.print_findings(screen, "Findings", result.warnings)
