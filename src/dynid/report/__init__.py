"""One self-contained page that says what was done and whether to trust it."""

from dynid.report.contents import (
    JudgedMotion,
    ReportContents,
    ReportedDesign,
    ReportedEstimate,
)
from dynid.report.fleet_page import write_fleet_page
from dynid.report.page import write_report
from dynid.report.theme import (
    Canvas,
    colour,
    joint_unit,
    paint,
)

__all__ = [
    "Canvas",
    "JudgedMotion",
    "ReportContents",
    "ReportedDesign",
    "ReportedEstimate",
    "colour",
    "joint_unit",
    "paint",
    "write_fleet_page",
    "write_report",
]
