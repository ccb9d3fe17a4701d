"""dynid identifies the dynamics of a robot arm.

The verbs of the command line, in the order of a job; robots are names, files or `RobotModel`s:

    load_robot, robots          the arm: built in, URDF or robot file
    analyze                     how many parameters motion can show, and which
    design, check               an excitation trajectory, and its certificate
    run_design                  execute it: simulated, or on a UR robot
    simulate_recording          a recording of the simulated arm, in memory
    fit                         logs at hand to verdict, models and report
    import_recording            convert a recording
    identify, verdict           parameters with uncertainty, and whether to use them
    validate, compare           errors on another recording; what moved between two estimates
    identify_shared, identify_temperature, identify_gains, identify_payload
    fleet                       many robots and days: shared inertias, friction trends, alarms
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
import warnings
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0.dev0"

if TYPE_CHECKING:
    from dynid.core import (
        DynidError,
        Finding,
        InputError,
        JobError,
        MissingExtraError,
        RecordError,
        RobotError,
    )
    from dynid.excitation import ExcitationDesign
    from dynid.export import ExportedFile, write_model
    from dynid.identification import (
        DriveGains,
        Estimate,
        Estimator,
        Fit,
        IdentificationProblem,
        Payload,
        read_estimate,
        write_estimate,
    )
    from dynid.recording import (
        ExperimentRecord,
        RecordMetadata,
        RecordWriter,
        read_record,
        read_recording,
        write_record,
    )
    from dynid.reduction import BaseParametrization, reduce_model
    from dynid.regressor import FrictionTerms, InverseDynamicModel, parse_terms
    from dynid.robot import RobotModel, load_robot, robots
    from dynid.signals import ProcessingSettings, Samples, process
    from dynid.trajectory import FourierSeries, random_excitation, read_trajectory, write_trajectory
    from dynid.validation import (
        MomentumObserver,
        ParameterComparison,
        ValidationResult,
        compare,
        contact_thresholds,
        validate,
    )
    from dynid.workflow import (
        Analysis,
        Check,
        DesignSettings,
        Fleet,
        FleetSettings,
        Identification,
        IdentifySettings,
        ImportOptions,
        LogFit,
        Run,
        RunSettings,
        SharedIdentification,
        TemperatureIdentification,
        TemperatureModel,
        Verdict,
        analyze,
        check,
        design,
        fit,
        fleet,
        identify,
        identify_gains,
        identify_gains_from_payload,
        identify_payload,
        identify_shared,
        identify_temperature,
        import_recording,
        read_design,
        read_temperature,
        run_design,
        run_until,
        simulate_recording,
        verdict,
        write_design,
        write_temperature,
    )

__all__ = [
    "Analysis",
    "BaseParametrization",
    "Check",
    "DesignSettings",
    "DriveGains",
    "DynidError",
    "Estimate",
    "Estimator",
    "ExcitationDesign",
    "ExperimentRecord",
    "ExportedFile",
    "Finding",
    "Fit",
    "Fleet",
    "FleetSettings",
    "FourierSeries",
    "FrictionTerms",
    "Identification",
    "IdentificationProblem",
    "IdentifySettings",
    "ImportOptions",
    "InputError",
    "InverseDynamicModel",
    "JobError",
    "LogFit",
    "MissingExtraError",
    "MomentumObserver",
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
    "fit",
    "fleet",
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
    "run_until",
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
    "core": (
        "DynidError",
        "InputError",
        "JobError",
        "MissingExtraError",
        "Finding",
        "RecordError",
        "RobotError",
    ),
    "excitation": ("ExcitationDesign",),
    "export": (
        "ExportedFile",
        "write_model",
    ),
    "identification": (
        "DriveGains",
        "Estimate",
        "Estimator",
        "Fit",
        "IdentificationProblem",
        "Payload",
        "read_estimate",
        "write_estimate",
    ),
    "recording": (
        "ExperimentRecord",
        "RecordMetadata",
        "RecordWriter",
        "read_record",
        "read_recording",
        "write_record",
    ),
    "reduction": (
        "BaseParametrization",
        "reduce_model",
    ),
    "regressor": (
        "FrictionTerms",
        "InverseDynamicModel",
        "parse_terms",
    ),
    "robot": (
        "RobotModel",
        "load_robot",
        "robots",
    ),
    "signals": (
        "ProcessingSettings",
        "Samples",
        "process",
    ),
    "trajectory": (
        "FourierSeries",
        "random_excitation",
        "read_trajectory",
        "write_trajectory",
    ),
    "validation": (
        "MomentumObserver",
        "ParameterComparison",
        "ValidationResult",
        "compare",
        "contact_thresholds",
        "validate",
    ),
    "workflow": (
        "Analysis",
        "Check",
        "DesignSettings",
        "Fleet",
        "FleetSettings",
        "LogFit",
        "Identification",
        "IdentifySettings",
        "ImportOptions",
        "Run",
        "RunSettings",
        "SharedIdentification",
        "TemperatureIdentification",
        "TemperatureModel",
        "Verdict",
        "analyze",
        "check",
        "design",
        "fit",
        "fleet",
        "identify",
        "identify_gains",
        "identify_gains_from_payload",
        "identify_payload",
        "identify_shared",
        "identify_temperature",
        "import_recording",
        "read_design",
        "read_temperature",
        "run_design",
        "run_until",
        "simulate_recording",
        "verdict",
        "write_design",
        "write_temperature",
    ),
}
_MODULE_OF = {name: f"dynid.{module}" for module, names in _HOME.items() for name in names}


_RENAMED = {"Notice": "Finding"}
"""Names of release 0.1, for one release."""


def __getattr__(name: str) -> Any:
    if name in _RENAMED:
        new = _RENAMED[name]
        warnings.warn(f"dynid.{name} is now dynid.{new}", DeprecationWarning, stacklevel=2)
        return getattr(importlib.import_module(_MODULE_OF[new]), new)
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'dynid' has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
