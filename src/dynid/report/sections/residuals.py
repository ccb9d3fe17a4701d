"""What the model does not explain, and whether it hides something."""

from __future__ import annotations

from dynid.figures.canvas import Canvas
from dynid.figures.signals import spectrum
from dynid.figures.theme import joint_unit
from dynid.figures.torque import autocorrelations, residuals
from dynid.report.contents import ReportContents, ReportedEstimate
from dynid.report.section import Part, Section
from dynid.validation.prediction import ValidationResult


class ResidualSection(Section):
    """Residuals over time, speed and temperature, their correlation, and the filter."""

    anchor = "residuals"
    title = "What is left"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate that has a record to predict."""
        return tuple(
            _part(item, item.shown) for item in contents.estimates if item.shown is not None
        )


def _part(item: ReportedEstimate, shown: ValidationResult) -> Part:
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
