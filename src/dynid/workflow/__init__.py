"""The verbs of the command line, as functions."""

from dynid.settings import (
    DesignSettings,
    FleetSettings,
    IdentifySettings,
    ImportOptions,
    LimitSettings,
    RunSettings,
)
from dynid.workflow.analyze import Analysis, analyze
from dynid.workflow.demo import run_demo
from dynid.workflow.design_files import (
    Check,
    StoredDesign,
    check,
    export_motion,
    judge_of,
    read_design,
    write_design,
)
from dynid.workflow.design_limits import DesignLimits, given_limits
from dynid.workflow.designing import DEFAULT_STARTS, design
from dynid.workflow.fitting import LogFit, check_suffix, export_file, fit
from dynid.workflow.fleet import Fleet, fleet
from dynid.workflow.identify import Identification, identify
from dynid.workflow.recordings import Imported, import_recording, open_records
from dynid.workflow.reporting import report
from dynid.workflow.running import Run, run_design, simulate_recording, truth_path
from dynid.workflow.shared_inertias import (
    GainsFromPayload,
    SharedIdentification,
    identify_gains,
    identify_gains_from_payload,
    identify_payload,
    identify_shared,
)
from dynid.workflow.temperature import TemperatureIdentification, identify_temperature
from dynid.workflow.until import RunUntil, run_until
from dynid.workflow.validating import Verdict, identify_files, validate_files, verdict

__all__ = [
    "DEFAULT_STARTS",
    "Analysis",
    "Check",
    "DesignLimits",
    "DesignSettings",
    "Fleet",
    "FleetSettings",
    "GainsFromPayload",
    "Identification",
    "IdentifySettings",
    "ImportOptions",
    "Imported",
    "LimitSettings",
    "LogFit",
    "Run",
    "RunSettings",
    "RunUntil",
    "SharedIdentification",
    "StoredDesign",
    "TemperatureIdentification",
    "Verdict",
    "analyze",
    "check",
    "check_suffix",
    "design",
    "export_file",
    "export_motion",
    "fit",
    "fleet",
    "given_limits",
    "identify",
    "identify_files",
    "identify_gains",
    "identify_gains_from_payload",
    "identify_payload",
    "identify_shared",
    "identify_temperature",
    "import_recording",
    "judge_of",
    "open_records",
    "read_design",
    "report",
    "run_demo",
    "run_design",
    "run_until",
    "simulate_recording",
    "truth_path",
    "validate_files",
    "verdict",
    "write_design",
]
