"""What a report is about: results that were computed before."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from dynid.core.arrays import Array
from dynid.core.notices import Notice
from dynid.identification.estimate import Estimate
from dynid.reduction.base import BaseParametrization
from dynid.robot.model import RobotModel
from dynid.trajectory.bounds import MotionBounds
from dynid.trajectory.trajectory import Trajectory
from dynid.validation.comparison import ParameterComparison
from dynid.validation.prediction import ValidationResult


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedEstimate:
    """An estimate with its predictions and the judgement of it."""

    name: str
    """What the report calls it, such as its file's name."""
    estimate: Estimate
    level: str
    """`usable`, `care` or `do_not_use`."""
    headline: str
    """The verdict in one sentence."""
    warnings: tuple[Notice, ...]
    base: BaseParametrization | None = None
    """Which parameters motion can show, for the paper's Figure 1."""
    training: ValidationResult | None = None
    """Prediction of its own record, where that is at hand."""
    training_name: str = ""
    validation: ValidationResult | None = None
    """Prediction of another record, where there is one."""
    validation_name: str = ""
    positions: Array | None = None
    """(N, n) uniform positions of its record, for the spectrum."""
    rate_hz: float = 0.0
    """Their rate [Hz]."""
    cutoff_hz: float = 0.0
    """The cut-off that was used [Hz]."""
    temperature: Array | None = None
    """(N) mean joint temperature at the validation's samples [degC]."""

    @property
    def shown(self) -> ValidationResult | None:
        """The prediction that counts: of another record if there is one."""
        return self.validation or self.training


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedMotion:
    """Limits of the whole arm over time."""

    t: Array
    """(N) time [s]."""
    kinds: tuple[str, ...]
    shares: Array
    """(N, k) value over limit, NaN where not judged."""
    distance_kinds: tuple[str, ...]
    distances: Array
    """(N, d) signed distances [m], NaN where not judged."""
    clearance: float
    """Smallest value allowed for them [m]."""


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
    """All that a report shows."""

    title: str
    directory: Path
    estimates: tuple[ReportedEstimate, ...] = ()
    designs: tuple[ReportedDesign, ...] = ()
    comparisons: tuple[tuple[str, str, ParameterComparison], ...] = ()
    """Names of two estimates, and what changed between them."""
    skipped: tuple[tuple[str, str], ...] = field(default=())
    """Files that could not be used, and why."""
