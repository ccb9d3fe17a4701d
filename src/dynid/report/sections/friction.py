"""Friction over velocity."""

from __future__ import annotations

from dynid.figures.friction import friction_figure
from dynid.report.contents import ReportContents
from dynid.report.section import Part, Section


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
