"""One self-contained page that says what was found, whether to trust it, and what to do next."""

from dynid.report.contents import Events as Events
from dynid.report.contents import JudgedMotion as JudgedMotion
from dynid.report.contents import KnownTruth as KnownTruth
from dynid.report.contents import ReportContents as ReportContents
from dynid.report.contents import ReportedDesign as ReportedDesign
from dynid.report.contents import ReportedEstimate as ReportedEstimate
from dynid.report.page import render as render
from dynid.report.page import write_figures as write_figures
from dynid.report.page import write_fleet_page as write_fleet_page
from dynid.report.page import write_report as write_report
