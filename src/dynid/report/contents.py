"""What a report is about: results that were computed before.

A section of the report, and what it may hold.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path

from dynid.core import Array, Finding
from dynid.identification import Estimate
from dynid.reduction import BaseParametrization
from dynid.report.theme import Canvas
from dynid.robot import RobotModel
from dynid.trajectory import MotionBounds, Trajectory
from dynid.validation import ParameterComparison, ValidationResult


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
    warnings: tuple[Finding, ...]
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of text below a heading."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    folded: bool = False
    """Shown only on request: long tables."""

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Which columns hold numbers alone, and stand right below each other."""
        cells = zip(*self.rows, strict=True) if any(self.columns) else ()
        found = tuple(any(column) and all(map(_is_number, column)) for column in cells)
        return found or (False,) * len(self.columns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A stretch of a section: words, then tables, then figures."""

    heading: str = ""
    words: tuple[str, ...] = ()
    """Paragraphs, plain text."""
    mark: str = ""
    """`usable`, `care` or `do_not_use`: the part is painted as a verdict."""
    tables: tuple[Table, ...] = field(default=())
    figures: tuple[Canvas, ...] = field(default=())


class Section(ABC):
    """One chapter; it computes nothing."""

    anchor: str
    """Its address in the page."""
    title: str

    @abstractmethod
    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """What to show; nothing if it has nothing to say."""


def number(value: float | None, digits: int = 3) -> str:
    """A number for people; a dash where there is none."""
    if value is None or value != value:
        return "-"
    return f"{value:#.{digits}g}".rstrip(".") if value else "0"


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell in ("", "-")
    return True
