"""The parameters and how well they are known."""

from __future__ import annotations

from dynid.figures.parameters import parameter_intervals
from dynid.figures.structure import singular_values
from dynid.report.contents import ReportContents, ReportedEstimate
from dynid.report.section import Part, Section, Table, number


class ParametersSection(Section):
    """The base parameters with their intervals."""

    anchor = "parameters"
    title = "The parameters"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate."""
        return tuple(_part(item) for item in contents.estimates)


def _part(item: ReportedEstimate) -> Part:
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
