"""What a report is about: results that were computed before."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dynid import diagnosis, identification, reduction, validation
from dynid.core import Array, Finding, MotionBounds
from dynid.robot import RobotModel
from dynid.trajectory import Trajectory
from dynid.validation import DecidingErrors, ParameterComparison, ValidationResult


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownTruth:
    """What a simulated arm was made of, in the frames of the estimate."""

    inertials: Array
    """(n, 10) as `RobotModel.inertias`."""
    coulomb: Array
    """(n) Coulomb friction [N.m or N]."""
    viscous: Array
    """(n) viscous friction [N.m.s/rad or N.s/m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Events:
    """Stretches of time in the prediction that is shown [s]."""

    contacts: tuple[tuple[float, float], ...] = ()
    left_out: tuple[tuple[float, float], ...] = ()
    """Without samples: dropped or damaged rows, and what a window left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedEstimate:
    """An estimate with its predictions and the judgement of it."""

    name: str
    """Its file's name."""
    estimate: identification.Estimate
    label: str = ""
    """What the report calls it, such as `cold, preset best`."""
    verdict: diagnosis.Verdict | None = None
    """None without any recording to judge it by."""
    warnings: tuple[Finding, ...] = ()
    base: reduction.BaseParametrization | None = None
    links: identification.StandardParameters | None = None
    """Masses and inertias of the links, with how much of them is data."""
    training: ValidationResult | None = None
    """Prediction of its own record, where that is at hand."""
    training_name: str = ""
    validation: ValidationResult | None = None
    """Prediction of another record, where there is one."""
    validation_name: str = ""
    conditions: tuple[str, ...] = ()
    """Of its recording, in words: duration, rate, temperature, payload."""
    tested: tuple[str, ...] = ()
    """Of the recording that was predicted, in words."""
    truth: KnownTruth | None = None
    events: Events = field(default_factory=Events)

    @property
    def shown(self) -> ValidationResult | None:
        """The prediction that counts: of another record if there is one."""
        return self.validation or self.training

    @property
    def errors(self) -> DecidingErrors | None:
        """Errors of that prediction, as the verdict counts them."""
        if (shown := self.shown) is None:
            return None
        slides = self.estimate.model.robot.prismatic
        return validation.deciding_errors(shown.measured, shown.predicted, shown.moves, slides)

    @property
    def level(self) -> str:
        """`usable`, `care` or `do_not_use`."""
        return "care" if self.verdict is None else self.verdict.level

    @property
    def headline(self) -> str:
        """The verdict in one sentence."""
        if self.verdict is None:
            return "Not judged: its recording is not in the folder."
        return self.verdict.headline


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedMotion:
    """Limits of the whole arm over time."""

    t: Array
    """(N) time [s]."""
    shares: Mapping[str, Array]
    """Kind of limit to (N) value over limit, NaN where not judged."""
    distances: Mapping[str, Array]
    """Kind to (N) distances beyond the clearance of the pair [m], infinite where not judged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedDesign:
    """An excitation trajectory."""

    name: str
    trajectory: Trajectory
    robot: RobotModel
    bounds: MotionBounds
    facts: tuple[tuple[str, str], ...] = ()
    """What is known of its making, in words."""
    search: tuple[Array, Array] | None = None
    """(k) evaluations and (k) best criterion so far."""
    judged: JudgedMotion | None = None
    """The limits of the whole arm over time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportContents:
    """All that a report shows; the first estimate is the one that decides."""

    robot: str
    """The robot's name for people."""
    date: str
    """When it was recorded or identified."""
    directory: Path
    estimates: tuple[ReportedEstimate, ...]
    designs: tuple[ReportedDesign, ...] = ()
    comparisons: tuple[tuple[str, str, ParameterComparison], ...] = ()
    """Labels of two estimates, and what changed between them."""
    models: tuple[str, ...] = ()
    """Names of the exported models in the folder."""
    skipped: tuple[tuple[str, str], ...] = ()
    """Files that could not be used, and why."""
