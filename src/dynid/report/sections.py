"""The sections of a report: each only shows what was computed before."""

from __future__ import annotations

import numpy as np

from dynid.report.contents import (
    Part,
    ReportContents,
    ReportedDesign,
    ReportedEstimate,
    Section,
    Table,
    number,
)
from dynid.report.figures import (
    friction_figure,
    parameter_changes,
    parameter_intervals,
    side_by_side,
    singular_values,
    spectrum,
)
from dynid.report.theme import Canvas, joint_unit
from dynid.report.time_figures import (
    autocorrelations,
    convergence,
    distances,
    limit_usage,
    moving_and_at_rest,
    prediction,
    residuals,
    safety_usage,
    trajectory,
)
from dynid.validation import Metrics, ParameterComparison, ValidationResult

MEANING = {
    "usable": "The numbers below can be used for motions like those that were recorded.",
    "care": "Read the reasons before using the numbers below.",
    "do_not_use": "Do not use the numbers below. The reasons say what to record or to set right.",
}


class VerdictSection(Section):
    """The verdict of each estimate, with its reasons and warnings."""

    anchor = "verdict"
    title = "Can this be trusted?"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate."""
        return tuple(_part(item, len(contents.estimates) > 1) for item in contents.estimates)


def _part(item: ReportedEstimate, named: bool) -> Part:
    return Part(
        heading=item.name if named else "",
        mark=item.level,
        words=(item.headline, MEANING[item.level]),
        tables=(_facts(item), *_warnings(item)),
    )


def _facts(item: ReportedEstimate) -> Table:
    estimate = item.estimate
    rows = [
        ("robot", estimate.model.robot.name),
        ("parameters identified", f"{len(estimate.values)} of {len(estimate.model.columns)}"),
        ("samples in the fit", str(estimate.samples)),
        ("condition number", number(estimate.condition_number)),
        ("condition of the motion", number(estimate.motion_condition_number)),
    ]
    shown = item.shown
    if shown is not None:
        what = item.validation_name or f"{item.training_name} (its own record)"
        moving = shown.moving.relative_error_overall_percent
        rows += [
            ("predicted record", what),
            ("relative error of moving joints", f"{number(moving)} %"),
            ("e_N (N)", f"{number(shown.metrics.normalized_error)} ({shown.metrics.samples})"),
        ]
    return Table(columns=("", ""), rows=tuple(rows))


def _warnings(item: ReportedEstimate) -> tuple[Table, ...]:
    if not item.warnings:
        return ()
    rows = tuple((notice.code, notice.message) for notice in item.warnings)
    return (Table(columns=("warning", "what it says"), rows=rows),)


class PredictionSection(Section):
    """How well each estimate predicts torques, joint by joint."""

    anchor = "prediction"
    title = "Does it predict?"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate that has a record to predict."""
        return tuple(
            _prediction_part(item, item.shown)
            for item in contents.estimates
            if item.shown is not None
        )


def _prediction_part(item: ReportedEstimate, shown: ValidationResult) -> Part:
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


class ResidualSection(Section):
    """Residuals over time, speed and temperature, their correlation, and the filter."""

    anchor = "residuals"
    title = "What is left"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate that has a record to predict."""
        return tuple(
            _residuals_part(item, item.shown)
            for item in contents.estimates
            if item.shown is not None
        )


def _residuals_part(item: ReportedEstimate, shown: ValidationResult) -> Part:
    robot = item.estimate.model.robot
    names, slides = robot.joint_names, robot.prismatic
    drawn: list[Canvas] = [
        residuals(shown, names, prismatic=slides),
        residuals(shown, names, against=shown.t, what="time [s]", prismatic=slides),
    ]
    if item.temperature is not None and len(item.temperature) == len(shown.t):
        drawn.append(
            residuals(
                shown,
                names,
                against=item.temperature,
                what="temperature [\N{DEGREE SIGN}C]",
                prismatic=slides,
            )
        )
    drawn.append(autocorrelations(shown, names))
    if item.positions is not None:
        what = f"positions [{joint_unit('rad', slides)}]"
        drawn.append(spectrum(item.positions, item.rate_hz, item.cutoff_hz, names, what))
    return Part(
        heading=item.name,
        words=(
            "A shape in these clouds is something that the model lacks: a step at zero speed is "
            "friction, a drift over time is temperature.",
        ),
        figures=tuple(drawn),
    )


class FrictionSection(Section):
    """What is left of the torques when the rigid body is taken off."""

    anchor = "friction"
    title = "Friction"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate that has a record to predict."""
        return tuple(
            Part(
                heading=item.name,
                words=(
                    "Measured torque less inertia and gravity of the model. Points along the line: "
                    "the friction model fits. Loops near zero speed: the joint sticks and creeps.",
                ),
                figures=(friction_figure(item.estimate, item.shown),),
            )
            for item in contents.estimates
            if item.shown is not None
        )


class ParametersSection(Section):
    """The base parameters with their intervals."""

    anchor = "parameters"
    title = "The parameters"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate."""
        return tuple(_parameters_part(item) for item in contents.estimates)


def _parameters_part(item: ReportedEstimate) -> Part:
    estimate = item.estimate
    relative = estimate.relative_std_percent
    rows = tuple(
        (
            name,
            number(float(estimate.values[k]), 4),
            estimate.units[k],
            number(float(estimate.std[k]), 2),
            number(float(relative[k]), 2),
            "yes" if k in estimate.essential else "hardly",
            estimate.expressions[k],
        )
        for k, name in enumerate(estimate.names)
    )
    return Part(
        heading=item.name,
        words=(
            f"Motion shows {len(estimate.values)} combinations of the "
            f"{len(estimate.model.columns)} standard parameters, never each alone. A name stands "
            "for its combination (last column of the table). Hollow marks are parameters of which "
            "this record hardly speaks. Standard deviations allow for residuals that hang together "
            "in time.",
        ),
        figures=(
            parameter_intervals(estimate),
            *((singular_values(item.base),) if item.base is not None else ()),
        ),
        tables=(
            Table(
                columns=(
                    "parameter",
                    "value",
                    "unit",
                    "std",
                    "std [%]",
                    "essential",
                    "combination",
                ),
                rows=rows,
                caption="All parameters",
                folded=True,
            ),
        ),
    )


class ComparisonSection(Section):
    """What changed between estimates."""

    anchor = "comparison"
    title = "What changed"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part a pair of estimates."""
        known = {item.name: item for item in contents.estimates}
        return tuple(
            _comparison_part(known[first], known[second], compared)
            for first, second, compared in contents.comparisons
        )


def _comparison_part(
    first: ReportedEstimate, second: ReportedEstimate, compared: ParameterComparison
) -> Part:
    friction = [k for k, name in enumerate(compared.names) if name.startswith(("Fc", "Fv"))]
    with np.errstate(divide="ignore", invalid="ignore"):
        std = np.abs(compared.change_percent / compared.z)
    rows = tuple(
        (
            group.name,
            "moved" if group.moved else "did not move",
            number(group.median_change_percent),
            "-" if group.largest is None else compared.names[group.largest],
            f"{number(group.largest_z)} (limit {number(group.limit_z)})",
        )
        for group in compared.groups
    )
    changes = tuple(
        (
            name,
            number(float(compared.a[k]), 4),
            number(float(compared.b[k]), 4),
            compared.units[k],
            number(float(compared.change_percent[k])),
            number(float(compared.z[k])),
        )
        for k, name in enumerate(compared.names)
    )
    return Part(
        heading=f"{first.name} and {second.name}",
        words=(
            "Inertias do not change with temperature: they are the control group. If they moved, "
            "something else than friction differs between the two runs.",
        ),
        tables=(
            Table(columns=("group", "", "median change [%]", "largest", "z"), rows=rows),
            Table(
                columns=("parameter", first.name, second.name, "unit", "change [%]", "z"),
                rows=changes,
                caption="All parameters",
                folded=True,
            ),
        ),
        figures=(
            side_by_side(first.estimate, second.estimate, (first.name, second.name)),
            parameter_changes(
                [compared.names[k] for k in friction],
                [float(compared.change_percent[k]) for k in friction],
                [float(std[k]) for k in friction],
                first=first.name,
                second=second.name,
            ),
        ),
    )


SAMPLES = 600


class DesignSection(Section):
    """How the arm was moved, and how much of its limits that used."""

    anchor = "design"
    title = "The motion"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part a trajectory."""
        return tuple(_design_part(item) for item in contents.designs)


def _design_part(item: ReportedDesign) -> Part:
    names = item.robot.joint_names
    motion = item.trajectory.evaluate(np.linspace(0.0, item.trajectory.duration, SAMPLES))
    criterion = dict(item.facts).get("criterion", "criterion")
    facts = (Table(columns=("", ""), rows=item.facts),) if item.facts else ()
    return Part(
        heading=item.name,
        words=(
            "The arm has to move so that every parameter leaves a trace in the torques: fast and "
            "slow, both ways, in many poses. Dashed lines are the limits.",
        ),
        tables=facts,
        figures=(
            trajectory(item.trajectory, names, item.robot.prismatic),
            limit_usage(motion, item.bounds, names),
            *_judged(item),
            *((convergence(*item.search, f"{criterion}, best so far"),) if item.search else ()),
        ),
    )


def _judged(item: ReportedDesign) -> tuple[Canvas, ...]:
    judged = item.judged
    if judged is None:
        return ()
    drawn = [safety_usage(judged.t, judged.shares, judged.kinds)]
    known = [
        k for k in range(len(judged.distance_kinds)) if np.isfinite(judged.distances[:, k]).all()
    ]
    if known:
        kinds = [judged.distance_kinds[k] for k in known]
        drawn.append(distances(judged.t, judged.distances[:, known], kinds, judged.clearance))
    return tuple(drawn)


ADVICE = {
    "ill_conditioned": "Design a motion with `dynid design`, record it, identify again.",
    "low_excitation": "Move every joint, fast and slow, both ways, for 20 s or more.",
    "over_fitted": "Use fewer friction terms, or record more.",
    "not_physical": "Use it to predict torques only; `--estimator sdp` gives a consistent model.",
    "unit_suspect": "Check the units of the recording and the drive gains.",
    "saturated": "Record again with less speed or load.",
    "extrapolated": "Identify from motions as fast and as wide as those to be predicted.",
    "at_rest": "Leave standstill out with `--from` and `--to`.",
    "clock_mismatch": "Check the time column, or give `--rate`.",
}


class NextSection(Section):
    """Advice, from the verdict and the warnings."""

    anchor = "next"
    title = "What to do next"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate."""
        return tuple(
            _next_steps_part(item, len(contents.estimates) > 1) for item in contents.estimates
        )


def _next_steps_part(item: ReportedEstimate, named: bool) -> Part:
    steps = [
        (finding.next_step or ADVICE[finding.code], finding.code)
        for finding in item.warnings
        if finding.severity != "info" and (finding.next_step or finding.code in ADVICE)
    ]
    steps = list(dict.fromkeys(steps))
    if item.validation is None:
        steps.insert(0, ("Predict another motion: `dynid validate`.", "nothing confirms it yet"))
    if item.level == "usable" and not steps:
        steps = [("Use it: `dynid export` writes it for other programs.", "it is confirmed")]
    return Part(
        heading=item.name if named else "",
        tables=(Table(columns=("do", "why"), rows=tuple(steps)),) if steps else (),
        words=() if steps else ("Nothing is left to do.",),
    )


class ReproduceSection(Section):
    """Settings, versions, hashes and seeds."""

    anchor = "reproduce"
    title = "How it was made"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate, and one for files that were left out."""
        parts = [_reproduce_part(item) for item in contents.estimates]
        if contents.skipped:
            table = Table(columns=("file", "why"), rows=contents.skipped)
            parts.append(Part(heading="Files left out", tables=(table,)))
        return tuple(parts)


def _reproduce_part(item: ReportedEstimate) -> Part:
    made = item.estimate.provenance
    rows = [
        ("made", made.created),
        ("estimator", f"{item.estimate.estimator}, preset {item.estimate.preset}"),
        *((f"version of {name}", value) for name, value in made.versions.items()),
        *((f"input {name}", f"SHA-256 {value}") for name, value in made.inputs.items()),
        *(
            (f"setting {name}", str(value))
            for name, value in made.settings.items()
            if value not in (None, "")
        ),
        *((("seed", str(made.seed)),) if made.seed is not None else ()),
    ]
    choices = tuple((choice,) for choice in item.estimate.choices)
    tables = [Table(columns=("", ""), rows=tuple(rows))]
    if choices:
        tables.append(Table(columns=("chosen by cross-validation",), rows=choices))
    return Part(heading=item.name, tables=tuple(tables))
