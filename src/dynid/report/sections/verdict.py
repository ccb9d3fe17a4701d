"""Whether the result can be trusted, first."""

from __future__ import annotations

from dynid.report.contents import ReportContents, ReportedEstimate
from dynid.report.section import Part, Section, Table, number

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
