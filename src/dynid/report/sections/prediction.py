"""Measured and predicted torques."""

from __future__ import annotations

from dynid.figures.theme import joint_unit
from dynid.figures.torque import moving_and_at_rest, prediction
from dynid.report.contents import ReportContents, ReportedEstimate
from dynid.report.section import Part, Section, Table, number
from dynid.validation.metrics import Metrics
from dynid.validation.prediction import ValidationResult


class PredictionSection(Section):
    """How well each estimate predicts torques, joint by joint."""

    anchor = "prediction"
    title = "Does it predict?"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate that has a record to predict."""
        return tuple(
            _part(item, item.shown) for item in contents.estimates if item.shown is not None
        )


def _part(item: ReportedEstimate, shown: ValidationResult) -> Part:
    robot = item.estimate.model.robot
    if item.validation is not None:
        words = (
            f"Torques of {item.validation_name}, a motion that the parameters were not identified "
            "from, beside what the model predicts for it."
        )
    else:
        words = (
            f"Torques of {item.training_name}, the very record that the parameters were "
            "identified from: that proves little. Validate on another motion."
        )
    return Part(
        heading=item.name,
        words=(
            words,
            "A joint at rest can hold any torque within its stiction, so judge by the moving "
            "ones; narrow peaks where a joint stops are friction whose direction is not known.",
        ),
        tables=(_errors(robot.joint_names, robot.prismatic, shown),),
        figures=(
            prediction(shown, robot.joint_names, robot.prismatic),
            moving_and_at_rest(shown, robot.joint_names, robot.prismatic),
        ),
    )


def _errors(names: tuple[str, ...], prismatic: tuple[bool, ...], shown: ValidationResult) -> Table:
    unit = joint_unit("N.m", prismatic)
    metrics, moving = shown.metrics, shown.moving
    rows = [_row(name, metrics, moving, j) for j, name in enumerate(names)]
    rows.append(
        (
            "all joints",
            "",
            "",
            number(metrics.relative_error_overall_percent),
            number(moving.relative_error_overall_percent),
            "",
        )
    )
    return Table(
        columns=(
            "joint",
            f"RMS error [{unit}]",
            f"RMS, moving [{unit}]",
            "relative [%]",
            "relative, moving [%]",
            "R2",
        ),
        rows=tuple(rows),
        caption=f"e_N = {number(metrics.normalized_error)} {unit} with N = {metrics.samples}",
    )


def _row(name: str, metrics: Metrics, moving: Metrics, j: int) -> tuple[str, ...]:
    return (
        name,
        number(metrics.rmse[j]),
        number(moving.rmse[j]),
        number(metrics.relative_error_percent[j]),
        number(moving.relative_error_percent[j]),
        number(metrics.r2[j]),
    )
