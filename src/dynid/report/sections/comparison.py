"""Two estimates side by side, as the paper's cold and warm robot."""

from __future__ import annotations

import numpy as np

from dynid.figures.parameters import parameter_changes, side_by_side
from dynid.report.contents import ReportContents, ReportedEstimate
from dynid.report.section import Part, Section, Table, number
from dynid.validation.comparison import ParameterComparison


class ComparisonSection(Section):
    """What changed between estimates."""

    anchor = "comparison"
    title = "What changed"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part a pair of estimates."""
        known = {item.name: item for item in contents.estimates}
        return tuple(
            _part(known[first], known[second], compared)
            for first, second, compared in contents.comparisons
        )


def _part(first: ReportedEstimate, second: ReportedEstimate, compared: ParameterComparison) -> Part:
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
