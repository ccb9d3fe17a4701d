"""One self-contained page that says what was found, whether to trust it, and what to do next."""

from dynid.report.contents import (
    Events,
    JudgedMotion,
    KnownTruth,
    ReportContents,
    ReportedDesign,
    ReportedEstimate,
)
from dynid.report.page import render, write_figures, write_fleet_page, write_report

__all__ = [
    "Events",
    "JudgedMotion",
    "KnownTruth",
    "ReportContents",
    "ReportedDesign",
    "ReportedEstimate",
    "render",
    "write_figures",
    "write_fleet_page",
    "write_report",
]
