"""METRICS as a table, one row a joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dynid.cli.output import number, print_table

if TYPE_CHECKING:
    from rich.console import Console

    from dynid.validation import ValidationResult

COLUMNS = ("joint", "RMS", "moving", "at rest", "rel. %", "moving %", "R2")


def print_metrics(
    screen: Console, title: str, result: ValidationResult, prismatic: Sequence[bool]
) -> None:
    """Print the errors of a prediction, joint by joint and overall.

    Args:
        screen: Where to.
        title: What was predicted.
        result: The prediction and its errors.
        prismatic: (n) which joints slide.
    """
    from dynid.report import joint_unit

    unit = joint_unit("N.m", prismatic)
    whole, moving, rest = result.metrics, result.moving, result.at_rest
    rows = [
        (
            str(j + 1),
            number(float(whole.rmse[j]), 3),
            number(float(moving.rmse[j]), 3),
            number(float(rest.rmse[j]), 3),
            number(float(whole.relative_error_percent[j]), 3),
            number(float(moving.relative_error_percent[j]), 3),
            number(float(whole.r2[j]), 3),
        )
        for j in range(len(whole.rmse))
    ]
    print_table(screen, f"{title}: RMS errors in {unit}", COLUMNS, rows)
    screen.print(
        f"all joints: {number(whole.relative_error_overall_percent, 3)} % of the torque, "
        f"{number(moving.relative_error_overall_percent, 3)} % while moving; "
        f"e_N {number(whole.normalized_error, 3)} {unit} with N = {whole.samples}"
    )
