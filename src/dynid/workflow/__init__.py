"""The verbs of the command line, as functions."""

from dynid.settings import DesignSettings as DesignSettings
from dynid.settings import FleetSettings as FleetSettings
from dynid.settings import IdentifySettings as IdentifySettings
from dynid.settings import ImportOptions as ImportOptions
from dynid.settings import LimitSettings as LimitSettings
from dynid.settings import RunSettings as RunSettings
from dynid.workflow.analyze import Analysis as Analysis
from dynid.workflow.analyze import analyze as analyze
from dynid.workflow.demo import run_demo as run_demo
from dynid.workflow.design_files import Check as Check
from dynid.workflow.design_files import StoredDesign as StoredDesign
from dynid.workflow.design_files import check as check
from dynid.workflow.design_files import judge_of as judge_of
from dynid.workflow.design_files import read_design as read_design
from dynid.workflow.design_files import write_design as write_design
from dynid.workflow.design_limits import DesignLimits as DesignLimits
from dynid.workflow.design_limits import given_limits as given_limits
from dynid.workflow.designing import DEFAULT_STARTS as DEFAULT_STARTS
from dynid.workflow.designing import check_export as check_export
from dynid.workflow.designing import design as design
from dynid.workflow.designing import export_motion as export_motion
from dynid.workflow.designing import unfinished_path as unfinished_path
from dynid.workflow.files import LogFit as LogFit
from dynid.workflow.files import fit as fit
from dynid.workflow.files import identify_files as identify_files
from dynid.workflow.files import validate_files as validate_files
from dynid.workflow.fleet import Fleet as Fleet
from dynid.workflow.fleet import fleet as fleet
from dynid.workflow.identify import Identification as Identification
from dynid.workflow.identify import Verdict as Verdict
from dynid.workflow.identify import identify as identify
from dynid.workflow.identify import verdict as verdict
from dynid.workflow.recordings import Imported as Imported
from dynid.workflow.recordings import import_recording as import_recording
from dynid.workflow.recordings import open_records as open_records
from dynid.workflow.reporting import report as report
from dynid.workflow.running import Run as Run
from dynid.workflow.running import run_design as run_design
from dynid.workflow.running import simulate_recording as simulate_recording
from dynid.workflow.running import truth_path as truth_path
from dynid.workflow.shared_inertias import SharedIdentification as SharedIdentification
from dynid.workflow.shared_inertias import TemperatureIdentification as TemperatureIdentification
from dynid.workflow.shared_inertias import identify_gains as identify_gains
from dynid.workflow.shared_inertias import (
    identify_gains_from_payload as identify_gains_from_payload,
)
from dynid.workflow.shared_inertias import identify_payload as identify_payload
from dynid.workflow.shared_inertias import identify_shared as identify_shared
from dynid.workflow.shared_inertias import identify_temperature as identify_temperature
from dynid.workflow.until import RunUntil as RunUntil
from dynid.workflow.until import run_until as run_until
