"""dynid identifies the dynamics of a robot arm.

The verbs of the command line, in the order of a job:

    load_robot, robots          the arm: built in, URDF or robot file
    analyze                     how many parameters motion can show, and which
    design, check               an excitation trajectory, and its certificate
    run_design                  execute it: simulated, or on a UR robot
    simulate_recording          a recording of the simulated arm, in memory
    fit                         logs at hand to verdict, models and report
    import_recording            convert a recording
    identify, verdict           parameters with uncertainty, and whether to use them
    validate, compare           errors on another recording; what moved between two estimates
    identify_shared, identify_temperature, identify_gains, identify_payload, identify_gravity
    fleet                       many robots and days: shared inertias, friction trends, alarms
    write_model                 URDF, MJCF, JSON, C, Python

Robots, recordings, estimates, temperature models, designs and trajectories are given as objects or
as paths of their files, `str` or `pathlib.Path`; robots by built-in names, too. `read_X(path)` and
`write_X(value, path)` read and write the files; settings name files. SI units; joint quantities
have shape (N, n), samples by joints. What goes wrong raises `InputError` (usage or input) or
`JobError` (the job itself), both `DynidError`, with what, where, value, limit and next step as
attributes.

    >>> import dynid
    >>> dynid.analyze("ur5").base.rank
    52

Every name below is loaded when it is first used, so `import dynid` costs nothing.
"""

from __future__ import annotations

import importlib
import warnings
from types import FunctionType, ModuleType
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
        GravityEstimate,
        IdentificationProblem,
        Payload,
        TemperatureModel,
        identify_gravity,
        read_estimate,
        read_temperature,
        write_estimate,
        write_temperature,
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
    from dynid.robot import BuiltinRobot, RobotModel, load_robot, robots
    from dynid.signals import ProcessingSettings, Samples, process
    from dynid.trajectory import (
        FourierSeries,
        StoredTrajectory,
        random_excitation,
        read_trajectory,
        write_trajectory,
    )
    from dynid.validation import (
        ContactThresholds,
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
        GainsFromPayload,
        Identification,
        IdentifySettings,
        Imported,
        ImportOptions,
        LimitSettings,
        LogFit,
        Run,
        RunSettings,
        RunUntil,
        SharedIdentification,
        StoredDesign,
        TemperatureIdentification,
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
        run_design,
        run_until,
        simulate_recording,
        verdict,
        write_design,
    )

__all__ = [
    "Analysis",
    "BaseParametrization",
    "BuiltinRobot",
    "Check",
    "ContactThresholds",
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
    "GainsFromPayload",
    "GravityEstimate",
    "Identification",
    "IdentificationProblem",
    "IdentifySettings",
    "ImportOptions",
    "Imported",
    "InputError",
    "InverseDynamicModel",
    "JobError",
    "LimitSettings",
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
    "RunUntil",
    "Samples",
    "SharedIdentification",
    "StoredDesign",
    "StoredTrajectory",
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
    "identify_gravity",
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

_FACES = (
    "core",
    "robot",
    "trajectory",
    "recording",
    "signals",
    "regressor",
    "reduction",
    "identification",
    "validation",
    "export",
    "excitation",
    "workflow",
)
"""Packages in which a name is looked for, what stands on others after them."""

_RENAMED = {"Notice": "Finding"}
"""Names of release 0.1, for one release."""


def __getattr__(name: str) -> Any:
    if name in _RENAMED:
        new = _RENAMED[name]
        warnings.warn(f"dynid.{name} is now dynid.{new}", DeprecationWarning, stacklevel=2)
        return __getattr__(new)
    if name not in __all__:
        raise AttributeError(f"module 'dynid' has no attribute {name!r}")
    faces = (importlib.import_module(f"dynid.{face}") for face in _FACES)
    found = (getattr(face, name, None) for face in faces)
    # A module of a package may be called as what another package offers.
    value = next(item for item in found if not isinstance(item, ModuleType | None))
    if isinstance(value, FunctionType):
        value = importlib.import_module("dynid.core").checked(value)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
