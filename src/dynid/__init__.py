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

import importlib
import warnings
from types import FunctionType
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0.dev0"

if TYPE_CHECKING:
    from dynid.core import DynidError as DynidError
    from dynid.core import Finding as Finding
    from dynid.core import InputError as InputError
    from dynid.core import JobError as JobError
    from dynid.core import MissingExtraError as MissingExtraError
    from dynid.core import RecordError as RecordError
    from dynid.core import RobotError as RobotError
    from dynid.excitation import DesignOptimiser as DesignOptimiser
    from dynid.excitation import ExcitationDesign as ExcitationDesign
    from dynid.excitation import MotionSearch as MotionSearch
    from dynid.export import ExportedFile as ExportedFile
    from dynid.export import write_model as write_model
    from dynid.identification import DriveGains as DriveGains
    from dynid.identification import Estimate as Estimate
    from dynid.identification import Estimator as Estimator
    from dynid.identification import Fit as Fit
    from dynid.identification import GainsFromPayload as GainsFromPayload
    from dynid.identification import GravityEstimate as GravityEstimate
    from dynid.identification import IdentificationProblem as IdentificationProblem
    from dynid.identification import Payload as Payload
    from dynid.identification import TemperatureModel as TemperatureModel
    from dynid.identification import identify_gravity as identify_gravity
    from dynid.identification import read_estimate as read_estimate
    from dynid.identification import read_temperature as read_temperature
    from dynid.identification import write_estimate as write_estimate
    from dynid.identification import write_temperature as write_temperature
    from dynid.recording import ExperimentRecord as ExperimentRecord
    from dynid.recording import RecordMetadata as RecordMetadata
    from dynid.recording import RecordWriter as RecordWriter
    from dynid.recording import read_record as read_record
    from dynid.recording import read_recording as read_recording
    from dynid.recording import write_record as write_record
    from dynid.reduction import BaseParametrization as BaseParametrization
    from dynid.reduction import reduce_model as reduce_model
    from dynid.regressor import FrictionTerms as FrictionTerms
    from dynid.regressor import InverseDynamicModel as InverseDynamicModel
    from dynid.regressor import parse_terms as parse_terms
    from dynid.robot import BuiltinRobot as BuiltinRobot
    from dynid.robot import RobotModel as RobotModel
    from dynid.robot import load_robot as load_robot
    from dynid.robot import robots as robots
    from dynid.signals import ProcessingSettings as ProcessingSettings
    from dynid.signals import Samples as Samples
    from dynid.signals import process as process
    from dynid.trajectory import FourierSeries as FourierSeries
    from dynid.trajectory import StoredTrajectory as StoredTrajectory
    from dynid.trajectory import random_excitation as random_excitation
    from dynid.trajectory import read_trajectory as read_trajectory
    from dynid.trajectory import write_trajectory as write_trajectory
    from dynid.validation import ContactThresholds as ContactThresholds
    from dynid.validation import MomentumObserver as MomentumObserver
    from dynid.validation import ParameterComparison as ParameterComparison
    from dynid.validation import ValidationResult as ValidationResult
    from dynid.validation import compare as compare
    from dynid.validation import contact_thresholds as contact_thresholds
    from dynid.validation import validate as validate
    from dynid.workflow import Analysis as Analysis
    from dynid.workflow import Check as Check
    from dynid.workflow import DesignSettings as DesignSettings
    from dynid.workflow import Fleet as Fleet
    from dynid.workflow import FleetSettings as FleetSettings
    from dynid.workflow import Identification as Identification
    from dynid.workflow import IdentifySettings as IdentifySettings
    from dynid.workflow import Imported as Imported
    from dynid.workflow import ImportOptions as ImportOptions
    from dynid.workflow import LimitSettings as LimitSettings
    from dynid.workflow import LogFit as LogFit
    from dynid.workflow import Run as Run
    from dynid.workflow import RunSettings as RunSettings
    from dynid.workflow import RunUntil as RunUntil
    from dynid.workflow import SharedIdentification as SharedIdentification
    from dynid.workflow import StoredDesign as StoredDesign
    from dynid.workflow import TemperatureIdentification as TemperatureIdentification
    from dynid.workflow import Verdict as Verdict
    from dynid.workflow import analyze as analyze
    from dynid.workflow import check as check
    from dynid.workflow import design as design
    from dynid.workflow import fit as fit
    from dynid.workflow import fleet as fleet
    from dynid.workflow import identify as identify
    from dynid.workflow import identify_gains as identify_gains
    from dynid.workflow import identify_gains_from_payload as identify_gains_from_payload
    from dynid.workflow import identify_payload as identify_payload
    from dynid.workflow import identify_shared as identify_shared
    from dynid.workflow import identify_temperature as identify_temperature
    from dynid.workflow import import_recording as import_recording
    from dynid.workflow import read_design as read_design
    from dynid.workflow import run_design as run_design
    from dynid.workflow import run_until as run_until
    from dynid.workflow import simulate_recording as simulate_recording
    from dynid.workflow import verdict as verdict
    from dynid.workflow import write_design as write_design

_NAMES = {
    "core": "DynidError Finding InputError JobError MissingExtraError RecordError RobotError",
    "excitation": "DesignOptimiser ExcitationDesign MotionSearch",
    "export": "ExportedFile write_model",
    "identification": (
        "DriveGains Estimate Estimator Fit GainsFromPayload GravityEstimate "
        "IdentificationProblem Payload TemperatureModel identify_gravity read_estimate "
        "read_temperature write_estimate write_temperature"
    ),
    "recording": (
        "ExperimentRecord RecordMetadata RecordWriter read_record read_recording write_record"
    ),
    "reduction": "BaseParametrization reduce_model",
    "regressor": "FrictionTerms InverseDynamicModel parse_terms",
    "robot": "BuiltinRobot RobotModel load_robot robots",
    "signals": "ProcessingSettings Samples process",
    "trajectory": (
        "FourierSeries StoredTrajectory random_excitation read_trajectory write_trajectory"
    ),
    "validation": (
        "ContactThresholds MomentumObserver ParameterComparison ValidationResult compare "
        "contact_thresholds validate"
    ),
    "workflow": (
        "Analysis Check DesignSettings Fleet FleetSettings Identification "
        "IdentifySettings ImportOptions Imported LimitSettings LogFit Run RunSettings RunUntil "
        "SharedIdentification StoredDesign TemperatureIdentification Verdict analyze check "
        "design fit fleet identify identify_gains identify_gains_from_payload identify_payload "
        "identify_shared identify_temperature import_recording read_design run_design run_until "
        "simulate_recording verdict write_design"
    ),
}
"""Package to its names that are loaded when they are first used."""
_PACKAGES = {name: package for package, names in _NAMES.items() for name in names.split()}
__all__ = sorted(["__version__", *_PACKAGES])  # pyright: ignore[reportUnsupportedDunderAll]

_RENAMED = {"Notice": "Finding"}
"""Names of release 0.1, for one release."""


def __getattr__(name: str) -> Any:
    if name in _RENAMED:
        new = _RENAMED[name]
        warnings.warn(f"dynid.{name} is now dynid.{new}", DeprecationWarning, stacklevel=2)
        return __getattr__(new)
    if name not in _PACKAGES:
        raise AttributeError(f"module 'dynid' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"dynid.{_PACKAGES[name]}"), name)
    if isinstance(value, FunctionType):
        value = importlib.import_module("dynid.core").checked(value)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
