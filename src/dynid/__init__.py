"""dynid identifies the dynamics of a robot arm.

The verbs of the command line, in the order of a job; robots are names, files or `RobotModel`s:

    load_robot, robots          the arm: built in, URDF or robot file
    analyze                     how many parameters motion can show, and which
    design, check               an excitation trajectory, and its certificate
    run_design                  execute it: simulated, or on a UR robot
    simulate_recording          a recording of the simulated arm, in memory
    import_recording            a foreign recording becomes ours
    identify, verdict           parameters with uncertainty, and whether to use them
    validate, compare           errors on another recording; what moved between two estimates
    identify_shared, identify_temperature, identify_gains, identify_payload
    write_model                 URDF, MJCF, JSON, C, Python

`read_X` and `write_X` take paths as text or `pathlib.Path`. SI units; joint quantities have shape
(N, n), samples by joints. What goes wrong raises `InputError` (usage or input) or `JobError` (the
job itself), both `DynidError`, with what, where, value, limit and next step as attributes.

    >>> import dynid
    >>> dynid.analyze("ur5").base.rank
    52

Every name below is loaded when it is first used, so `import dynid` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from dynid.core.errors import (
        DynidError,
        InputError,
        JobError,
        MissingExtraError,
        RecordError,
        RobotError,
    )
    from dynid.core.notices import Notice
    from dynid.excitation.design import ExcitationDesign
    from dynid.export.writing import ExportedFile, write_model
    from dynid.identification.drive_gains import DriveGains
    from dynid.identification.estimate import Estimate
    from dynid.identification.estimate_file import read_estimate, write_estimate
    from dynid.identification.payload import Payload
    from dynid.recording.files import read_recording
    from dynid.recording.parquet import read_record, write_record
    from dynid.recording.record import ExperimentRecord, RecordMetadata
    from dynid.recording.writer import RecordWriter
    from dynid.reduction.base import BaseParametrization, reduce_model
    from dynid.regressor.model import InverseDynamicModel
    from dynid.regressor.terms import FrictionTerms, parse_terms
    from dynid.robot.load import load_robot, robots
    from dynid.robot.model import RobotModel
    from dynid.signals.process import process
    from dynid.signals.samples import ProcessingSettings, Samples
    from dynid.trajectory.files import read_trajectory, write_trajectory
    from dynid.trajectory.fourier import FourierSeries
    from dynid.trajectory.random_excitation import random_excitation
    from dynid.validation.comparison import ParameterComparison, compare
    from dynid.validation.observer import MomentumObserver, contact_thresholds
    from dynid.validation.prediction import ValidationResult, validate
    from dynid.workflow.analyze import Analysis, analyze
    from dynid.workflow.checking import Check, check
    from dynid.workflow.design_files import read_design, write_design
    from dynid.workflow.design_settings import DesignSettings
    from dynid.workflow.designing import design
    from dynid.workflow.gains import identify_gains
    from dynid.workflow.gains_payload import identify_gains_from_payload
    from dynid.workflow.identify import Identification, identify
    from dynid.workflow.identify_settings import IdentifySettings
    from dynid.workflow.importing import ImportOptions, import_recording
    from dynid.workflow.payload import identify_payload
    from dynid.workflow.run_settings import RunSettings
    from dynid.workflow.running import Run, run_design
    from dynid.workflow.shared_inertias import SharedIdentification, identify_shared
    from dynid.workflow.simulating import simulate_recording
    from dynid.workflow.temperature import TemperatureIdentification, identify_temperature
    from dynid.workflow.temperature_file import read_temperature, write_temperature
    from dynid.workflow.temperature_model import TemperatureModel
    from dynid.workflow.verdict import Verdict, verdict

__all__ = [
    "Analysis",
    "BaseParametrization",
    "Check",
    "DesignSettings",
    "DriveGains",
    "DynidError",
    "Estimate",
    "ExcitationDesign",
    "ExperimentRecord",
    "ExportedFile",
    "FourierSeries",
    "FrictionTerms",
    "Identification",
    "IdentifySettings",
    "ImportOptions",
    "InputError",
    "InverseDynamicModel",
    "JobError",
    "MissingExtraError",
    "MomentumObserver",
    "Notice",
    "ParameterComparison",
    "Payload",
    "ProcessingSettings",
    "RecordError",
    "RecordMetadata",
    "RecordWriter",
    "RobotError",
    "RobotModel",
    "Run",
    "RunSettings",
    "Samples",
    "SharedIdentification",
    "TemperatureIdentification",
    "TemperatureModel",
    "ValidationResult",
    "Verdict",
    "__version__",
    "analyze",
    "check",
    "compare",
    "contact_thresholds",
    "design",
    "identify",
    "identify_gains",
    "identify_gains_from_payload",
    "identify_payload",
    "identify_shared",
    "identify_temperature",
    "import_recording",
    "load_robot",
    "parse_terms",
    "process",
    "random_excitation",
    "read_design",
    "read_estimate",
    "read_record",
    "read_recording",
    "read_temperature",
    "read_trajectory",
    "reduce_model",
    "robots",
    "run_design",
    "simulate_recording",
    "validate",
    "verdict",
    "write_design",
    "write_estimate",
    "write_model",
    "write_record",
    "write_temperature",
    "write_trajectory",
]

_HOME = {
    "core.errors": (
        "DynidError",
        "InputError",
        "JobError",
        "MissingExtraError",
        "RecordError",
        "RobotError",
    ),
    "core.notices": ("Notice",),
    "excitation.design": ("ExcitationDesign",),
    "export.writing": ("ExportedFile", "write_model"),
    "identification.drive_gains": ("DriveGains",),
    "identification.estimate": ("Estimate",),
    "identification.estimate_file": ("read_estimate", "write_estimate"),
    "identification.payload": ("Payload",),
    "recording.files": ("read_recording",),
    "recording.parquet": ("read_record", "write_record"),
    "recording.record": ("ExperimentRecord", "RecordMetadata"),
    "recording.writer": ("RecordWriter",),
    "reduction.base": ("BaseParametrization", "reduce_model"),
    "regressor.model": ("InverseDynamicModel",),
    "regressor.terms": ("FrictionTerms", "parse_terms"),
    "robot.load": ("load_robot", "robots"),
    "robot.model": ("RobotModel",),
    "signals.process": ("process",),
    "signals.samples": ("ProcessingSettings", "Samples"),
    "trajectory.files": ("read_trajectory", "write_trajectory"),
    "trajectory.fourier": ("FourierSeries",),
    "trajectory.random_excitation": ("random_excitation",),
    "validation.comparison": ("ParameterComparison", "compare"),
    "validation.observer": ("MomentumObserver", "contact_thresholds"),
    "validation.prediction": ("ValidationResult", "validate"),
    "workflow.analyze": ("Analysis", "analyze"),
    "workflow.checking": ("Check", "check"),
    "workflow.design_files": ("read_design", "write_design"),
    "workflow.design_settings": ("DesignSettings",),
    "workflow.designing": ("design",),
    "workflow.gains": ("identify_gains",),
    "workflow.gains_payload": ("identify_gains_from_payload",),
    "workflow.identify": ("Identification", "identify"),
    "workflow.identify_settings": ("IdentifySettings",),
    "workflow.importing": ("ImportOptions", "import_recording"),
    "workflow.payload": ("identify_payload",),
    "workflow.run_settings": ("RunSettings",),
    "workflow.running": ("Run", "run_design"),
    "workflow.shared_inertias": ("SharedIdentification", "identify_shared"),
    "workflow.simulating": ("simulate_recording",),
    "workflow.temperature": ("TemperatureIdentification", "identify_temperature"),
    "workflow.temperature_file": ("read_temperature", "write_temperature"),
    "workflow.temperature_model": ("TemperatureModel",),
    "workflow.verdict": ("Verdict", "verdict"),
}
_MODULE_OF = {name: f"dynid.{module}" for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'dynid' has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
