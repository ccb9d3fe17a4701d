"""One self-contained page that says what was found, whether to trust it, and what to do next."""

from dynid.report.appendix import design_figures
from dynid.report.contents import (
    Events,
    JudgedMotion,
    KnownTruth,
    ReportContents,
    ReportedDesign,
    ReportedEstimate,
    joint_labels,
)
from dynid.report.figures import friction_figure, links_figure, parameter_figure, torque_figure
from dynid.report.page import render, report_figures, write_figures, write_fleet_page, write_report

__all__ = [
    "Events",
    "JudgedMotion",
    "KnownTruth",
    "ReportContents",
    "ReportedDesign",
    "ReportedEstimate",
    "design_figures",
    "friction_figure",
    "joint_labels",
    "links_figure",
    "parameter_figure",
    "render",
    "report_figures",
    "torque_figure",
    "write_figures",
    "write_fleet_page",
    "write_report",
]
