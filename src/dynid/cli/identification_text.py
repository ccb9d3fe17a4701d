"""An identification in words and tables: first whether to trust it, then the numbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dynid.cli.metrics_table import print_metrics
from dynid.cli.output import number, print_notices, print_table
from dynid.workflow import verdict

if TYPE_CHECKING:
    from rich.console import Console

    from dynid.workflow import Identification

COLOURS = {"usable": "bold green", "care": "bold yellow", "do_not_use": "bold red"}


def print_identification(screen: Console, result: Identification, output: Path | None) -> None:
    """Print an identification.

    Args:
        screen: Where to.
        result: The identification.
        output: Where the estimate was written, if it was.
    """
    estimate, judged = result.estimate, verdict(result)
    screen.print(judged.headline, style=COLOURS[judged.level])
    screen.print()
    screen.print(
        f"{estimate.model.robot.name}: {len(estimate.values)} base parameters from "
        f"{estimate.samples} samples, estimator {estimate.estimator}, preset {estimate.preset}, "
        f"{estimate.model.frames} frames"
    )
    screen.print(
        f"condition number {number(estimate.condition_number, 3)}; of the motion alone, columns "
        f"scaled, {number(estimate.motion_condition_number, 3)} (good: below 50)"
    )
    for choice in estimate.choices:
        screen.print(f"- {choice}")
    _print_parameters(screen, result)
    _print_standard(screen, result)
    slides = estimate.model.robot.prismatic
    print_metrics(screen, "Training", result.training, slides)
    if result.validation is not None:
        print_metrics(screen, "Validation", result.validation, slides)
    print_notices(screen, "Warnings", [notice.to_json() for notice in result.warnings])
    screen.print()
    if output is None:
        screen.print("Nothing was written; keep the estimate with -o ESTIMATE.json")
    else:
        screen.print(f"Estimate written to {output}", soft_wrap=True)


def _print_parameters(screen: Console, result: Identification) -> None:
    rows = [
        (
            row["name"],
            number(row["value"]),
            number(row["std"], 2),
            number(row["relative_std_percent"], 3),
            row["unit"],
            "" if row["essential"] else "weak",
        )
        for row in result.estimate.parameter_table()
    ]
    print_table(
        screen,
        "Base parameters (weak: the data hardly speak about it)",
        ("name", "value", "std", "std %", "unit", ""),
        rows,
        words=(0, 4, 5),
    )


def _print_standard(screen: Console, result: Identification) -> None:
    """Consistent standard parameters, where the estimator finds them."""
    table = result.estimate.standard_table()
    if table is None:
        return
    rows = [
        (
            row["name"],
            number(row["value"]),
            number(row["std"], 2) if row["from"] == "data" else "",
            "" if row["prior"] is None else number(row["prior"]),
            row["unit"],
            row["from"],
        )
        for row in table
    ]
    print_table(
        screen,
        "Standard parameters of bodies that can exist (from: the data's word or the prior's)",
        ("name", "value", "std", "prior", "unit", "from"),
        rows,
        words=(0, 4, 5),
    )
